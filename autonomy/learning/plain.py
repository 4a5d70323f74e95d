"""The functions that every reading pays for, with numpy and scipy; _compiled.c does the same with fewer calls.

The layout of states and factors: see `arithmetic`.
"""

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr_delete
from scipy.linalg.blas import dger, dtrsv

from autonomy.learning.numbers import FloatArray

# Without the wrapper that lets it take stacks of matrices, which costs as much as the rotations.
_qr_delete = getattr(qr_delete, "__wrapped__", qr_delete)


def whiten(factor: FloatArray, k: FloatArray) -> None:
    """k ← L⁻¹k, in place; `k` (n,) contiguous."""
    dtrsv(factor, k, lower=1, overwrite_x=1)


def unwhiten(factor: FloatArray, a: FloatArray) -> None:
    """a ← L⁻ᵀa, in place; `a` (n,) contiguous."""
    dtrsv(factor, a, lower=1, trans=1, overwrite_x=1)


def condition(state: FloatArray, p: FloatArray, innovation: float, variance: float) -> None:
    """Condition on a reading whose `innovation` has this `variance`, in place.

    `p` (D + 1,), used up, is the covariance of the state with the reading; its last entry is ignored.
    """
    p *= 1.0 / math.sqrt(variance)
    p[-1] = -innovation / math.sqrt(variance)
    # The same vector twice keeps S symmetric to the last bit.
    dger(-1.0, p, p[:-1], a=state, overwrite_x=0, overwrite_y=0, overwrite_a=1)


def drop_precision(factor: FloatArray, precision: FloatArray, index: int, least: float) -> None:
    """Take basis vector `index` out of `precision` (n,) = diag (L Lᵀ)⁻¹, in place; the last entry becomes 0.

    With c its column of the inverse, the others lose c²/c_index. None falls below `least`, whatever rounding does.
    """
    column = np.zeros(len(factor))
    column[index] = 1.0
    whiten(factor, column)
    unwhiten(factor, column)
    precision -= column**2 / column[index]
    np.maximum(precision, least, out=precision)
    precision[index:-1] = precision[index + 1 :]
    precision[-1] = 0.0


def remove(
    state: FloatArray, other: FloatArray, factors: Sequence[FloatArray], blocks: Sequence[int], index: int
) -> None:
    """Marginalise basis vector `index` out: `other` receives the state, the factors change in place.

    Without its row, L is lower Hessenberg from there on. Rotations of the coordinates make it triangular
    again, and no remaining basis vector depends on the last coordinate any more: it becomes the spare one.
    `blocks` names the group of each block; all blocks of a group are rotated alike. `state` is used up.
    """
    size = state.shape[1]
    _rotate(state, [factors[group].copy(order="F") for group in blocks], index)
    np.copyto(other[:size], state[:size].T)
    # The last block of a group turns the factor itself; until then each needs it whole.
    turned = [
        factors[group] if group not in blocks[block + 1 :] else factors[group].copy(order="F")
        for block, group in enumerate(blocks)
    ]
    _rotate(other, turned, index)
    other[size] = state[size]
    free_spare(other, factors)


def free_spare(state: FloatArray, factors: Sequence[FloatArray]) -> None:
    """Marginalise the last coordinate of every block out and make it the spare one, in place."""
    n = len(factors[0])
    for spare in range(n - 1, state.shape[1], n):
        state[:, spare] = 0.0
        state[spare] = 0.0
        state[spare, spare] = 1.0
    for factor in factors:
        factor[:, n - 1] = 0.0
        factor[n - 1] = 0.0
        factor[n - 1, n - 1] = 1.0


def _rotate(state: FloatArray, factors: Sequence[FloatArray], index: int) -> None:
    """Rotate the columns of each block by what makes its factor without row `index` triangular; in place."""
    n = len(factors[0])
    for block, factor in enumerate(factors):
        # qr_delete drops a column of R = Lᵀ and applies the rotations to whatever stands for Q.
        columns = state[:, block * n : (block + 1) * n]
        _qr_delete(columns, factor.T, index, which="col", overwrite_qr=True, check_finite=False)
