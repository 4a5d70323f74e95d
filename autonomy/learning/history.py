"""The bounded memory that lets the model be rebuilt under new hyperparameters: space-time cell sums.

A cell knows Σx, Σy, n and Σt of its readings and no hyperparameter. Its mean is absorbed as one observation
with noise σn²/n.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.learning.kernel import FloatArray

CELLS_PER_SPAN = 30
SAMPLES_PER_SLICE = 50

_Key = tuple[int, ...]


@dataclass(frozen=True)
class HistoryCells:
    """Averages, oldest first: `points` (n, d) m, `means` (n,) sensor units, `counts` and `times_s` (n,)."""

    points: FloatArray
    means: FloatArray
    counts: FloatArray
    times_s: FloatArray

    def __len__(self) -> int:
        return len(self.means)

    def take(self, index: NDArray[np.intp]) -> "HistoryCells":
        """The cells with these indices."""
        return HistoryCells(self.points[index], self.means[index], self.counts[index], self.times_s[index])


class History:
    """Sums of all readings in cells span/30 wide and 50 samples long, at most `maximum_cells`. Picklable.

    When it is full, neighbouring time slices of one place are merged, the oldest (relative to the time
    between them) first: a field that does not move loses nothing, and on one that does the remaining ages
    stay log-spaced. Only when every place has a single slice left are the cells made twice as wide.
    """

    def __init__(self, span_m: float, maximum_cells: int = 2000, dimensions: int = 2) -> None:
        if not (math.isfinite(span_m) and span_m > 0):
            raise ValueError(f"span_m must be positive and finite, not {span_m!r}")
        if maximum_cells < 10:
            raise ValueError(f"maximum_cells must be at least 10, not {maximum_cells!r}")
        self.side_m = span_m / CELLS_PER_SPAN
        self.maximum_cells = maximum_cells
        self.dimensions = dimensions
        self.samples = 0
        self._mean, self._squares = 0.0, 0.0
        # Key: the place's indices, then the slice. Row: Σx (d), Σy, Σt, n.
        self._cells: dict[_Key, list[float]] = {}

    def __len__(self) -> int:
        return len(self._cells)

    def add(self, x: ArrayLike, value: float, time_s: float) -> None:
        """Count a reading at `x` (d,) metres and model time `time_s`; ValueError if they are not finite."""
        point = np.asarray(x, dtype=np.float64)
        if point.shape != (self.dimensions,):
            raise ValueError(f"x must have shape ({self.dimensions},), not {point.shape}")
        row = [*point.tolist(), float(value), float(time_s), 1.0]
        if not all(map(math.isfinite, row)):
            raise ValueError(f"position, value and time must be finite, not {row[:-1]}")
        place = tuple(math.floor(c / self.side_m) for c in row[: self.dimensions])
        key = (*place, self.samples // SAMPLES_PER_SLICE)
        self.samples += 1
        deviation = row[self.dimensions] - self._mean
        self._mean += deviation / self.samples
        self._squares += deviation * (row[self.dimensions] - self._mean)
        self._accumulate(key, row)
        if len(self._cells) > self.maximum_cells:
            self._shrink(now_s=float(time_s))

    @property
    def variance(self) -> float:
        """Variance of all readings ever counted (Welford 1962); 0 before the first."""
        return self._squares / self.samples if self.samples else 0.0

    def cells(self) -> HistoryCells:
        """Averages of all cells, oldest first."""
        table = np.array(list(self._cells.values())).reshape(-1, self.dimensions + 3)
        counts = table[:, -1]
        averages = table[:, :-1] / counts[:, None]
        order = np.argsort(averages[:, -1], kind="stable")
        averages, counts = averages[order], counts[order]
        d = self.dimensions
        return HistoryCells(averages[:, :d].copy(), averages[:, d].copy(), counts, averages[:, d + 1].copy())

    def _accumulate(self, key: _Key, row: list[float]) -> None:
        cell = self._cells.get(key)
        if cell is None:
            self._cells[key] = row
        else:
            for i, value in enumerate(row):
                cell[i] += value

    def _shrink(self, now_s: float) -> None:
        """Merge until a tenth is free, so that the sorting is paid once in many readings."""
        target = self.maximum_cells - self.maximum_cells // 10
        while len(self._cells) > target:
            if not self._merge_slices(now_s, len(self._cells) - target):
                self._coarsen()

    def _merge_slices(self, now_s: float, wanted: int) -> bool:
        """Merge up to `wanted` disjoint pairs of neighbouring slices; False if no place has two."""
        keys = sorted(self._cells)
        ranked = []
        for first, second in pairwise(keys):
            if first[:-1] == second[:-1]:
                early, late = self._time(first), self._time(second)
                gap, age = abs(late - early), max(now_s - min(early, late), 0.0)
                ranked.append((gap / age if age > 0 else math.inf, first, second))
        merged: set[_Key] = set()
        for _, first, second in sorted(ranked):
            if wanted == 0:
                break
            if first in merged or second in merged:
                continue
            merged.update((first, second))
            self._accumulate(second, self._cells.pop(first))
            wanted -= 1
        return bool(ranked)

    def _time(self, key: _Key) -> float:
        row = self._cells[key]
        return row[-2] / row[-1]

    def _coarsen(self) -> None:
        """Double the side of the cells."""
        cells, self._cells = self._cells, {}
        self.side_m *= 2.0
        for key, row in cells.items():
            self._accumulate(cast(_Key, (*(c // 2 for c in key[:-1]), key[-1])), row)
