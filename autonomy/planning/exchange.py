"""Choosing sampling spots by exchange: swap one site at a time for a better one, from several first choices."""

from collections.abc import Sequence
from operator import index

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray
from autonomy.planning.information import precision
from autonomy.planning.selection import Selection, check_size, greedy_sites, selection_of

_RANDOM_STARTS = (5, 2)
"""Up to `_MANY` candidates, and beyond: there every one of them costs a tenth of a second."""

_MANY = 500
_LEAST_GAIN = 1e-10
"""Relative gain of the two determinants' product below which a swap is round-off."""

_TIE_NATS = 1e-11
_SWAPS_PER_SITE = 20
"""Far more than are ever needed; so that round-off cannot make an endless loop."""


def select_by_exchange(
    S: ArrayLike,
    n: int,
    *,
    seed: int = 0,
    first: Sequence[Sequence[int]] = (),
    noise_variance: float | None = None,
) -> Selection:
    """A set of n sites that no single swap improves: the best of several in true mutual information.

    From the greedy choice, several random ones, and those given, the best swap of one chosen site for one other is made
    until none raises I(P) = ½(log|S_PP| + log|Λ_PP|). With K = S_PP⁻¹ and A = S_XP K, taking p out and x in multiplies
    |S_PP| by K_pp var(x | P) + A_xp², and likewise |Λ_PP|: all n (N − n) swaps cost O(n²N) time after the inverse.

    Args:
        S: shape (N, N), posterior covariance of the measurements over the candidates, noise included.
        n: how many sites, 1 … N.
        seed: of the random first choices.
        first: more choices to begin from, each of distinct sites; short ones are filled up greedily, long ones cut.
        noise_variance: that S includes, for the selection's other figures.

    Raises:
        ValueError: S is no covariance matrix, n is out of range, or a first choice is no set of sites.
    """
    covariance, n = np.asarray(S, dtype=np.float64), index(n)
    Lambda = precision(covariance)
    check_size(n, len(covariance))
    rng = np.random.default_rng(seed)
    starts = [_completed(covariance, Lambda, sites, n) for sites in (*first, ())]
    random_starts = _RANDOM_STARTS[len(covariance) > _MANY]
    starts += [rng.permutation(len(covariance))[:n] for _ in range(random_starts)]
    refined = [np.sort(_refined(covariance, Lambda, start)).tolist() for start in starts]
    found = [selection_of(covariance, Lambda, sites, None, noise_variance) for sites in refined]
    best = max(each.mutual_information for each in found)
    # Of equals the first: a given choice, then the greedy one.
    return next(each for each in found if each.mutual_information >= best - _TIE_NATS)


def _completed(S: FloatArray, Lambda: FloatArray, sites: Sequence[int], n: int) -> NDArray[np.intp]:
    """The first n of the sites, and as many more as are wanting, taken greedily."""
    chosen = np.array(list(sites), dtype=np.intp)
    if len(np.unique(chosen)) != len(chosen) or not np.all((chosen >= 0) & (chosen < len(S))):
        raise ValueError(f"first choices must be distinct sites in 0 … {len(S) - 1}, not {chosen.tolist()}")
    return np.array(greedy_sites(S, Lambda, n, chosen[:n].tolist()), dtype=np.intp)


def _refined(S: FloatArray, Lambda: FloatArray, start: NDArray[np.intp]) -> NDArray[np.intp]:
    """The set to which best swaps lead."""
    P = start.copy()
    if len(P) == len(S):
        return P
    for _ in range(_SWAPS_PER_SITE * len(P)):
        factor = _swapped(S, P) * _swapped(Lambda, P)
        factor[:, P] = 0.0
        best = float(factor.max())
        if best <= 1.0 + _LEAST_GAIN:
            break
        out, into = np.unravel_index(int(np.argmax(factor >= best * (1.0 - _LEAST_GAIN))), factor.shape)
        P[out] = into
    return P


def _swapped(matrix: FloatArray, P: NDArray[np.intp]) -> FloatArray:
    """By what |matrix_PP| is multiplied if the p-th of P makes way for x: shape (n, N); anything for x in P."""
    K = np.linalg.inv(matrix[np.ix_(P, P)])
    rows = matrix[P]
    A = K @ rows
    variance = np.diag(matrix) - np.einsum("px,px->x", A, rows)
    np.multiply(A, A, out=A)
    A += np.diag(K)[:, None] * variance
    return A
