"""What every reading costs: a few plain functions on arrays, in place, all O(D²).

The filter's state is one matrix (D + 1, D) in column order: S, and below it, as the last row, μ. Its
coordinates come in blocks of n, one block for each state of each group, block after block; the last
coordinate of a block is spare: it belongs to no basis vector, has its prior N(0, 1), independent of all
others, and waits for the next one. Factors L_g (n, n) are lower triangular, in column order, and end in the
row (0 … 0, 1) of the spare coordinate. So a replacement needs no fresh memory.

`whiten`, `condition` and `remove` are compiled ones if a compiler was there when the package was installed, and
else those of `plain`; `COMPILED` tells which.
"""

import math

import numpy as np
from scipy.linalg.blas import ddot, dgemv, dtrsv
from scipy.linalg.lapack import dtrtri

from autonomy.learning import plain
from autonomy.learning.numbers import FloatArray
from autonomy.learning.plain import free_spare

try:
    from autonomy.learning import _compiled
except ImportError:
    COMPILED = False
    whiten, condition, remove = plain.whiten, plain.condition, plain.remove
else:
    COMPILED = True
    whiten, condition, remove = _compiled.whiten, _compiled.condition, _compiled.remove

__all__ = [
    "COMPILED",
    "condition",
    "free_spare",
    "precision_column",
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


def unwhiten(factor: FloatArray, a: FloatArray) -> FloatArray:
    """L⁻ᵀa, shape (n,)."""
    result: FloatArray = dtrsv(factor, a, lower=1, trans=1)
    return result


def precision_column(factor: FloatArray, index: int) -> FloatArray:
    """Column `index` (n,) of (L Lᵀ)⁻¹."""
    unit = np.zeros(len(factor))
    unit[index] = 1.0
    dtrsv(factor, unit, lower=1, overwrite_x=1)
    dtrsv(factor, unit, lower=1, trans=1, overwrite_x=1)
    return unit


def precision_diagonal(factor: FloatArray) -> FloatArray:
    """The diagonal (n,) of (L Lᵀ)⁻¹. O(n³)."""
    inverse, _ = dtrtri(factor, lower=1)
    diagonal: FloatArray = np.square(np.tril(inverse)).sum(axis=0)
    return diagonal
