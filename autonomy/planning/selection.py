"""Choosing sampling spots: the paper's dynamic programme, and a greedy choice."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import index

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray
from autonomy.planning.information import log_determinant, precision

_TIE_NATS = 1e-11
"""Values this close are equal: round-off must not decide between sites that symmetry makes equal."""


@dataclass(frozen=True)
class Selection:
    """Chosen sites, in the order in which the method took them; iterating over it gives the sites.

    Attributes:
        sites: distinct indices into the candidate sites.
        objective: the sum that the method maximised, in nats. The dynamic programme's is an upper bound of
            the mutual information; that of the others is the mutual information itself.
        mutual_information: true I(P) of the sites, in nats: the figure to report. It changes with the lattice.
        field_information: ½ log|S_PP/σn²|, what readings at the sites tell of the field itself, in nats. It does not
            depend on the other candidates: the figure for comparing lattices. None if σn² was not given.
        variance_drop: by how much readings at the sites lower the field's variance at the candidates on average,
            expected and in S's units. None if σn² was not given.
    """

    sites: tuple[int, ...]
    objective: float
    mutual_information: float
    field_information: float | None = None
    variance_drop: float | None = None

    def __iter__(self) -> Iterator[int]:
        return iter(self.sites)

    def __len__(self) -> int:
        return len(self.sites)


def selection_of(
    S: FloatArray,
    Lambda: FloatArray,
    sites: Sequence[int],
    objective: float | None = None,
    noise_variance: float | None = None,
) -> Selection:
    """The sites with their figures, given Λ = S⁻¹; the objective is the mutual information if none is given."""
    P = np.array(sites, dtype=np.intp)
    within = np.ix_(P, P)
    # Of all sites there is nothing left to know; round-off aside, I(P) is never negative.
    information = 0.0
    if len(P) < len(S):
        information = max(0.0, 0.5 * (log_determinant(S[within]) + log_determinant(Lambda[within])))
    if objective is None:
        objective = information
    chosen = tuple(P.tolist())
    if noise_variance is None:
        return Selection(chosen, objective, information)
    field_information = 0.5 * log_determinant(S[within] / noise_variance)
    cross = S[P].copy()
    cross[np.arange(len(P)), P] -= noise_variance
    drop = float(np.sum(cross * np.linalg.solve(S[within], cross))) / len(S)
    return Selection(chosen, objective, information, field_information, drop)


def select_by_dynamic_programming(S: ArrayLike, n: int, *, noise_variance: float | None = None) -> Selection:
    """The paper's dynamic programme over sequences of n distinct sites (Ma, Liu & Sukhatme 2017, sec. III-C).

    V_1(x) = I(Z_x; Z_rest); V_i(x) = max over the predecessor p of V_{i−1}(p) + I(Z_x; Z_rest | Z_path(p)),
    where path(p) is the best path that ends in p, and x is not on it. Every increment is
    ½ log(var(x | path)·Λ_xx), because H(Z_x | everything else) does not depend on the path. Ties go to the
    lowest index.

    The variances given every state's path are kept and downdated by rank one; states with the same
    predecessor share one solve. O(n²N²) time, O(N²) memory.

    Args:
        S: shape (N, N), posterior covariance of the measurements over the candidates, noise included.
        n: how many sites, 1 … N.
        noise_variance: σn², which S includes, for the selection's other figures.

    Raises:
        ValueError: S is no covariance matrix, or n is out of range.
    """
    covariance, n = np.asarray(S, dtype=np.float64), index(n)
    Lambda = precision(covariance)
    check_size(n, len(covariance))
    half_log_precision = 0.5 * np.log(np.diag(Lambda))
    states = _States.first(covariance, half_log_precision)
    for _ in range(1, n):
        states = states.extended(covariance, half_log_precision)
    last = _lowest_maximum(states.value[:, None])[0]
    sites = tuple(int(site) for site in states.paths[:, last])
    return selection_of(covariance, Lambda, sites, float(states.value[last]), noise_variance)


@dataclass(frozen=True, eq=False)
class _States:
    """Stage i of the dynamic programme, one state for every last site.

    Attributes:
        value: shape (N,), V_i; −inf where no path of i distinct sites ends in the site (a dead state).
        paths: shape (i, N), column x is the best path that ends in x; what back-tracing would give.
        variance: shape (N, N), row x: var(· | path of x).
        visited: shape (N, N), row x: which sites are on the path of x.
    """

    value: FloatArray
    paths: NDArray[np.intp]
    variance: FloatArray
    visited: NDArray[np.bool_]

    @classmethod
    def first(cls, S: FloatArray, half_log_precision: FloatArray) -> "_States":
        diagonal = np.diag(S)
        variance = diagonal[None, :] - S**2 / diagonal[:, None]
        paths = np.arange(len(S))[None, :]
        return cls(0.5 * np.log(diagonal) + half_log_precision, paths, variance, np.eye(len(S), dtype=bool))

    def extended(self, S: FloatArray, half_log_precision: FloatArray) -> "_States":
        """The next stage."""
        sites = np.arange(len(S))
        with np.errstate(divide="ignore", invalid="ignore"):
            increment = 0.5 * np.log(self.variance) + half_log_precision
        # A visited site's variance is round-off about 0 and its logarithm anything: it is never a successor.
        score = np.where(self.visited, -np.inf, self.value[:, None] + increment)
        predecessor = _lowest_maximum(score)
        value = score[predecessor, sites]
        variance = self.variance[predecessor]
        for p in np.unique(predecessor[np.isfinite(value)]):
            group = np.flatnonzero((predecessor == p) & np.isfinite(value))
            path = self.paths[:, p]
            given = np.linalg.solve(S[np.ix_(path, path)], S[np.ix_(path, group)])
            cross = S[group] - given.T @ S[path]
            variance[group] -= cross**2 / self.variance[p, group][:, None]
        visited = self.visited[predecessor]
        visited[sites, sites] = True
        paths = np.concatenate([self.paths[:, predecessor], sites[None, :]])
        return _States(value, paths, variance, visited)


def select_greedily(S: ArrayLike, n: int, *, noise_variance: float | None = None) -> Selection:
    """Take the site that raises the true mutual information most, n times (Krause et al. 2008).

    The gain of x is ½(log var(x | P) + log var_Λ(x | P)), with Schur complements of S and of Λ. It may be
    negative: mutual information is not monotone. Ties go to the lowest index. O(n²N) time after the inverse.

    Args:
        S: shape (N, N), posterior covariance of the measurements over the candidates, noise included.
        n: how many sites, 1 … N.
        noise_variance: σn², which S includes, for the selection's other figures.

    Raises:
        ValueError: S is no covariance matrix, or n is out of range.
    """
    covariance, n = np.asarray(S, dtype=np.float64), index(n)
    Lambda = precision(covariance)
    check_size(n, len(covariance))
    return selection_of(covariance, Lambda, greedy_sites(covariance, Lambda, n), None, noise_variance)


def greedy_sites(S: FloatArray, Lambda: FloatArray, n: int, first: Sequence[int] = ()) -> list[int]:
    """The sites of `select_greedily`, given Λ = S⁻¹; the first of them may be given."""
    sides = (_Conditioned(S, n), _Conditioned(Lambda, n))
    free = np.ones(len(S), dtype=bool)
    sites: list[int] = []
    for k in range(n):
        gain = np.full(len(S), -np.inf)
        gain[free] = 0.5 * sum(np.log(side.variance[free]) for side in sides)
        site = first[k] if k < len(first) else int(_lowest_maximum(gain[:, None])[0])
        for side in sides:
            side.condition_on(site)
        free[site] = False
        sites.append(site)
    return sites


class _Conditioned:
    """The diagonal of a positive definite matrix conditioned on a growing set of indices."""

    def __init__(self, matrix: FloatArray, capacity: int) -> None:
        self._matrix = matrix
        self._rows = np.empty((max(0, capacity), len(matrix)))
        self._count = 0
        self.variance = np.diag(matrix).copy()

    def condition_on(self, site: int) -> None:
        rows = self._rows[: self._count]
        row = (self._matrix[site] - rows[:, site] @ rows) / np.sqrt(self.variance[site])
        self._rows[self._count] = row
        self._count += 1
        self.variance = self.variance - row**2


def check_size(n: int, available: int) -> None:
    """ValueError unless n of so many sites can be chosen."""
    if not 1 <= n <= available:
        raise ValueError(f"the number of sites must be 1 … {available}, the number of candidates, not {n}")


def _lowest_maximum(score: FloatArray) -> NDArray[np.intp]:
    """Per column the lowest row whose score is the maximum, up to `_TIE_NATS`."""
    best = score.max(axis=0)
    # In a column of −inf alone every row ties: −inf ≥ −inf − tie.
    chosen: NDArray[np.intp] = np.argmax(score >= best - _TIE_NATS, axis=0)
    return chosen
