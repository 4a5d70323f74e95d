"""What every reading costs: a few plain functions on arrays, in place, all O(D²).

The filter's state is one matrix (D + 1, D) in column order: S, and below it, as the last row, μ. Its
coordinates come in blocks of n, one block for each state of each group, block after block; the last
coordinate of a block is spare: it belongs to no basis vector, has its prior N(0, 1), independent of all
others, and waits for the next one. Factors L_g (n, n) are lower triangular, in column order, and end in the
row (0 … 0, 1) of the spare coordinate. So a replacement needs no fresh memory.

What `plain` has is taken from `_compiled` if a compiler was there when the package was installed; `COMPILED` tells.
`covariances` is compiled or None: `members` can do without.
"""

import math

import numpy as np
from scipy.linalg.blas import ddot, dgemv
from scipy.linalg.lapack import dtrtri

from autonomy.learning import plain
from autonomy.learning.numbers import FloatArray
from autonomy.learning.plain import free_spare
from autonomy.learning.spatial import Matern32, SquaredExponential

try:
    from autonomy.learning import _compiled
except ImportError:
    COMPILED = False
    whiten, unwhiten, condition = plain.whiten, plain.unwhiten, plain.condition
    drop_precision, remove = plain.drop_precision, plain.remove
    covariances = None
else:
    COMPILED = True
    whiten, unwhiten, condition = _compiled.whiten, _compiled.unwhiten, _compiled.condition
    drop_precision, remove = _compiled.drop_precision, _compiled.remove
    covariances = _compiled.covariances

KINDS = {SquaredExponential.name: 0.0, Matern32.name: 1.0}
"""How a recipe of the compiled `covariances` names a spatial kernel."""

__all__ = [
    "COMPILED",
    "KINDS",
    "condition",
    "covariances",
    "drop_precision",
    "free_spare",
    "precision_diagonal",
    "product",
    "remove",
    "spread",
    "take_spare",
    "unwhiten",
    "whiten",
]


def spread(state: FloatArray, a: FloatArray) -> FloatArray:
    """(S a, μᵀa), shape (D + 1,), for `a` (D,)."""
    result: FloatArray = dgemv(1.0, state, a)
    return result


def product(a: FloatArray, b: FloatArray) -> float:
    """aᵀb over the length of `a`; `b` may be longer."""
    return float(ddot(a, b, n=len(a)))


def take_spare(factor: FloatArray, a: FloatArray, gamma: float) -> None:
    """Give the spare coordinate to a basis vector whose whitened covariance with the others is `a` (n,)."""
    last = len(a) - 1
    factor[last] = a
    factor[last, last] = math.sqrt(gamma)


def precision_diagonal(factor: FloatArray) -> FloatArray:
    """The diagonal (n,) of (L Lᵀ)⁻¹. O(n³)."""
    inverse, _ = dtrtri(factor, lower=1)
    diagonal: FloatArray = np.square(np.tril(inverse)).sum(axis=0)
    return diagonal
