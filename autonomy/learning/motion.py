"""How time passes for a whitened state: z ← A z for every group, S ← A S Aᵀ + I − A Aᵀ."""

import math
from collections.abc import Sequence

import numpy as np

from autonomy.learning.kernel import Group
from autonomy.learning.numbers import FloatArray

# Entries of one block copied at once: more would be fresh memory from the system every time, which costs more
# than the work.
_SCRATCH = 5_000


def advance(state: FloatArray, groups: Sequence[Group], dt_s: float) -> None:
    """Let `dt_s` seconds pass in `state` (D + 1, D): S, and below it μ, in column order; in place.

    Its coordinates: block after block of equal length, one block for each state of each group. Exact for
    the groups' temporal kernels. What does not move costs nothing. Raises ValueError for negative or
    non-finite times.
    """
    if not (math.isfinite(dt_s) and dt_s >= 0):
        raise ValueError(f"dt_s must be finite and not negative, not {dt_s!r}")
    size = state.shape[1]
    if dt_s == 0 or not size:
        return
    n = size // sum(group.time.states for group in groups)
    first = 0
    for group in groups:
        states = group.time.states
        if not math.isinf(group.time.timescale_s):
            A = group.time.transition(dt_s)
            _mix(state, slice(first, first + states * n), A)
            _add_noise(state, first, n, np.eye(states) - A @ A.T)
        first += states * n


def _mix(state: FloatArray, group: slice, A: FloatArray) -> None:
    """Apply A to the blocks of one group, which lie one after the other: to their columns, then to their rows."""
    if len(A) == 1:
        state[:, group] *= A[0, 0]
        state[group] *= A[0, 0]
        return
    columns = state.T[group].reshape(len(A), -1)
    for start in range(0, columns.shape[1], _SCRATCH):
        part = columns[:, start : start + _SCRATCH]
        part[...] = A @ part
    n = (group.stop - group.start) // len(A)
    width = max(1, _SCRATCH // n)
    for start in range(0, state.shape[1], width):
        blocks = [
            state.T[start : start + width, group.start + i * n : group.start + (i + 1) * n]
            for i in range(len(A))
        ]
        old = [block.copy() for block in blocks]
        for block, row in zip(blocks, A.tolist(), strict=True):
            np.multiply(old[0], row[0], out=block)
            for other, weight in zip(old[1:], row[1:], strict=True):
                block += weight * other


def _add_noise(state: FloatArray, first: int, n: int, noise: FloatArray) -> None:
    """Add noise ⊗ I to the blocks of one group, which begin at coordinate `first`."""
    rows, size = state.shape
    entries = state.ravel(order="K")
    for i, row in enumerate(noise):
        for j, amount in enumerate(row):
            start = (first + j * n) * rows + first + i * n
            entries[start : start + n * (size + 2) : size + 2][:n] += amount
