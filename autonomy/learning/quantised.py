"""A posterior in few bits, so that its standard deviation, not its covariance, is off by little.

With a = L⁻¹k(B, x), |a|² ≤ σf², a map is mean = aᵀμ and variance = σf² − |a|² + aᵀSa. Rounding the entries of S, or of
I − S, to a step Δ makes the *variance* wrong by about Δ·σf², which is nothing where little is known and everything
where the map is good. So S = R Rᵀ is factored and the triangle R rounded: then aᵀSa = |Rᵀa|², and the standard
deviation is wrong by at most |ΔRᵀa| ≤ ‖ΔR‖·σf everywhere, however small it is. What is rounded remains a
covariance by itself; only eigenvalues above 1, the prior's, must be brought back to it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh, qr
from scipy.linalg.lapack import dpotrf

from autonomy.learning.numbers import FloatArray
from autonomy.learning.packing import Integers

# How far the factor of a state that is not quite positive may be from it, as a share of the step.
_NUDGE = 2.0**-4


class Bits(NamedTuple):
    """Bits, sign included, of an entry of μ, the largest of which sets the scale, and of R, which reaches from −1 to 1.

    An error of the mean is seen everywhere, in a field whose range may be a fraction of σf, and costs little: there
    are n of its entries, and n²/2 of R's.
    """

    mean: int
    root: int


@dataclass(frozen=True, eq=False)
class Quantised:
    """μ ≈ `mean` × `mean_step` (n,), S ≈ R Rᵀ with R the lower triangle `root` (n(n + 1)/2,) × `root_step`.

    Row by row. Steps are powers of two, so that both ends get the very same numbers.
    """

    mean: Integers
    mean_step: float
    root: Integers
    root_step: float

    def state(self) -> tuple[FloatArray, FloatArray]:
        """μ (n,) and S (n, n), symmetric, its eigenvalues between 0 and 1."""
        n = len(self.mean)
        root = np.zeros((n, n))
        root[np.tril_indices(n)] = self.root * self.root_step
        return np.asarray(self.mean * self.mean_step, dtype=np.float64), _within_prior(root @ root.T)


def quantised(mean: FloatArray, covariance: FloatArray, bits: Bits) -> Quantised:
    """μ (n,) and S (n, n), eigenvalues between 0 and 1, in so many bits."""
    n = len(mean)
    step = root_step(bits)
    most = 2 ** (bits.root - 1) - 1
    root = np.rint(_root(covariance, step)[np.tril_indices(n)] / step).clip(-most, most)
    widest = float(np.abs(mean).max(initial=0.0))
    mean_step = 2.0 ** (np.frexp(widest)[1] - (bits.mean - 1)) if widest else 1.0
    return Quantised(np.rint(mean / mean_step).astype(np.int64), mean_step, root.astype(np.int64), step)


def root_step(bits: Bits) -> float:
    """The step of R, whose entries lie between −1 and 1."""
    return 2.0 ** (1 - bits.root)


def _root(S: FloatArray, step: float) -> FloatArray:
    """A lower triangle R with R Rᵀ = S, or as near as a `step` cannot tell."""
    n = len(S)
    if not n:
        return np.zeros((0, 0))
    root, failed = dpotrf(S + (_NUDGE * step) ** 2 * np.eye(n), lower=1, clean=1)
    if not failed:
        return np.asarray(root)
    # Rounding has left an eigenvalue below zero: the nearest covariance there is.
    values, vectors = eigh(S)
    (triangle,) = qr((vectors * np.sqrt(values.clip(0.0, 1.0))).T, mode="r")
    return np.asarray(triangle.T)


def _within_prior(S: FloatArray) -> FloatArray:
    """S without what its eigenvalues have above 1."""
    _, above = dpotrf(np.eye(len(S)) - S, lower=1) if len(S) else (None, 0)
    if not above:
        return S
    values, vectors = eigh(S, subset_by_value=(1.0, np.inf))
    S -= (vectors * (values - 1.0)) @ vectors.T
    return 0.5 * (S + S.T)
