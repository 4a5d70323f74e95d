"""Taking a basis vector out of the whitened state, without asking for fresh memory every time.

A replacement at m = 300 handles ten matrices of 0.7 MB. Fresh from the system they would cost several times
what the arithmetic does: every page is mapped and cleared first.
"""

import numpy as np
from scipy.linalg import qr_delete

from autonomy.learning.kernel import FloatArray


class Scratch:
    """Matrices that are used again; what was in one is overwritten by the next of its name. Pickles empty."""

    def __init__(self) -> None:
        self._memory: dict[str, FloatArray] = {}

    def __getstate__(self) -> dict[str, dict[str, FloatArray]]:
        return {"_memory": {}}

    def matrix(self, name: str, rows: int, columns: int) -> FloatArray:
        """An uninitialised (rows, columns) matrix in column order."""
        size = rows * columns
        memory = self._memory.get(name)
        if memory is None or len(memory) < size:
            memory = self._memory[name] = np.empty(size)
        return memory[:size].reshape((rows, columns), order="F")


def remove(
    L: FloatArray, state: FloatArray, index: int, scratch: Scratch, new_L: FloatArray, new_S: FloatArray
) -> FloatArray:
    """Marginalise basis vector `index` out of f_B = L v, v ~ N(μ, S); returns the new μ (n − 1,).

    Without row i, L (n, n) is lower Hessenberg from there on. Rotations G of v's coordinates make it
    triangular again, and no remaining basis vector depends on the last coordinate any more, which is
    dropped. `state` (n + 1, n) holds S and below it μ. All in column order; L and `state` are used up. `new_L`
    and `new_S` (n − 1, n − 1) receive the result; they may share no memory with L or `state`.
    """
    n = len(L)
    again = scratch.matrix("factor again", n, n)
    again[...] = L
    # qr_delete drops a column of R = Lᵀ and applies the rotations to the columns of whatever stands for Q.
    rotated, _ = qr_delete(state, L.T, index, which="col", overwrite_qr=True, check_finite=False)
    mean: FloatArray = rotated[n].copy()
    # As many rows as before: qr_delete takes no fewer than columns. The last two mean nothing.
    turned = scratch.matrix("turned", n + 1, n)
    turned[: n - 1] = rotated[:n].T
    turned[n - 1 :] = 0.0
    rotated, upper = qr_delete(turned, again.T, index, which="col", overwrite_qr=True, check_finite=False)
    S = rotated[: n - 1]
    np.add(S, S.T, out=new_S)
    np.multiply(new_S, 0.5, out=new_S)
    new_L[...] = upper.T
    return mean
