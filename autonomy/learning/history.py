"""The bounded memory that lets the model be rebuilt under new hyperparameters: space-time cell sums.

A cell knows Σx, Σy, n and Σt of its readings and no hyperparameter. Its mean is absorbed as one observation
with noise σn²/n.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.learning.numbers import FloatArray

CELLS_PER_SPAN = 30
SAMPLES_PER_SLICE = 50
# A place needs two cells at least, the present and the past: with less memory places are larger.
_CELLS_PER_PLACE = 2.2
# No index of a place is larger: it has to fit 64 bits.
_FARTHEST = 2.0**62

_NONE = -1
_Index = NDArray[np.intp]


@dataclass(frozen=True)
class HistoryCells:
    """Averages, oldest first: `points` (n, d) m, `means` (n,) in the units of what was added, `counts`, `times_s`."""

    points: FloatArray
    means: FloatArray
    counts: FloatArray
    times_s: FloatArray

    def __len__(self) -> int:
        return len(self.means)

    def take(self, index: _Index) -> "HistoryCells":
        """The cells with these indices."""
        return HistoryCells(self.points[index], self.means[index], self.counts[index], self.times_s[index])


class History:
    """Sums of all readings in cells span/30 wide and 50 samples long, at most `maximum_cells`. Picklable.

    With fewer than 2000 cells they are wider, so that a square of side `span_m` still has two a place.
    A place's cells form a chain in the order in which they were begun. When the memory is full, a new cell
    is paid for by merging the two neighbours in one chain whose ages differ by the smallest factor: a field
    that does not move loses nothing, and on one that does the ages that remain are log-spaced, so that the
    old never blurs the recent. Only when every place is down to one cell are the cells made twice as wide.
    No call takes more than one pass over the cells.
    """

    def __init__(self, span_m: float, maximum_cells: int = 2000, dimensions: int = 2) -> None:
        if not (math.isfinite(span_m) and span_m > 0):
            raise ValueError(f"span_m must be positive and finite, not {span_m!r}")
        if maximum_cells < 10:
            raise ValueError(f"maximum_cells must be at least 10, not {maximum_cells!r}")
        self.side_m = span_m / min(CELLS_PER_SPAN, math.isqrt(int(maximum_cells / _CELLS_PER_PLACE)))
        self.maximum_cells = int(maximum_cells)
        self.dimensions = int(dimensions)
        self.samples = 0
        self._mean, self._squares = 0.0, 0.0
        self._used = 0
        # One row a cell: Σx (d), Σy, Σt, n; the place's indices (d) and the slice; the next younger cell there.
        self._sums = np.zeros((self.maximum_cells, self.dimensions + 3))
        self._keys = np.zeros((self.maximum_cells, self.dimensions + 1), dtype=np.int64)
        self._younger = np.full(self.maximum_cells, _NONE, dtype=np.intp)
        self._youngest: dict[tuple[int, ...], int] = {}

    def __len__(self) -> int:
        return self._used

    @property
    def places(self) -> int:
        """How many places there are readings of, whenever they were taken."""
        return len(self._youngest)

    def add(self, x: ArrayLike, value: float, time_s: float) -> None:
        """Count a reading at `x` (d,) metres and model time `time_s`; ValueError if they are not finite."""
        point = np.asarray(x, dtype=np.float64)
        if point.shape != (self.dimensions,):
            raise ValueError(f"x must have shape ({self.dimensions},), not {point.shape}")
        row = [*point.tolist(), float(value), float(time_s), 1.0]
        if not all(map(math.isfinite, row)):
            raise ValueError(f"position, value and time must be finite, not {row[:-1]}")
        if max(map(abs, row[: self.dimensions])) > _FARTHEST * self.side_m:
            raise ValueError(
                f"position must be within {_FARTHEST:.0e} cells of the origin, not {row[: self.dimensions]}"
            )
        part = self.samples // SAMPLES_PER_SLICE
        self._count(row[self.dimensions])
        place = self._place(row)
        cell = self._youngest.get(place, _NONE)
        if cell == _NONE or self._keys[cell, -1] != part:
            cell = self._begin(row, part)
        self._sums[cell] += row

    @property
    def variance(self) -> float:
        """Variance of all readings ever counted (Welford 1962); 0 before the first."""
        return self._squares / self.samples if self.samples else 0.0

    def cells(self) -> HistoryCells:
        """Averages of all cells, oldest first."""
        counts = self._sums[: self._used, -1]
        averages = self._sums[: self._used, :-1] / counts[:, None]
        order = np.argsort(averages[:, -1], kind="stable")
        averages, d = averages[order], self.dimensions
        return HistoryCells(
            averages[:, :d].copy(), averages[:, d].copy(), counts[order], averages[:, d + 1].copy()
        )

    def state(self) -> dict[str, Any]:
        """All there is to remember, as numbers and arrays (copies): what `restore` takes."""
        return {
            "side_m": self.side_m,
            "maximum_cells": self.maximum_cells,
            "samples": self.samples,
            "mean": self._mean,
            "squares": self._squares,
            "sums": self._sums[: self._used].copy(),
            "keys": self._keys[: self._used].copy(),
            "younger": self._younger[: self._used].copy(),
        }

    @classmethod
    def restore(cls, state: Mapping[str, Any]) -> "History":
        """The history that gave this `state`, to the last bit; ValueError, saying what, if it cannot be one."""
        sums = np.array(state["sums"], dtype=np.float64)
        keys = np.array(state["keys"], dtype=np.int64)
        younger = np.array(state["younger"], dtype=np.intp)
        maximum, used = int(state["maximum_cells"]), len(sums)
        if sums.ndim != 2 or sums.shape[1] < 4 or not np.isfinite(sums).all() or (sums[:, -1] < 1).any():
            raise ValueError("sums must be finite rows of Σx, Σy, Σt, n with n at least 1")
        if keys.shape != (used, sums.shape[1] - 2) or younger.shape != (used,) or used > maximum:
            raise ValueError(
                f"{used} sums, {len(keys)} keys and {len(younger)} links do not fit {maximum} cells"
            )
        links = younger[younger != _NONE]
        if ((links < 0) | (links >= used)).any() or len(set(links.tolist())) != len(links):
            raise ValueError("a link must name another cell, and no two the same")
        history = cls(1.0, maximum, sums.shape[1] - 3)
        history.side_m = float(state["side_m"])
        history.samples = int(state["samples"])
        history._mean, history._squares = float(state["mean"]), float(state["squares"])
        history._used = used
        history._sums[:used], history._keys[:used], history._younger[:used] = sums, keys, younger
        history._find_youngest()
        return history

    def _count(self, value: float) -> None:
        self.samples += 1
        deviation = value - self._mean
        self._mean += deviation / self.samples
        self._squares += deviation * (value - self._mean)

    def _place(self, row: list[float]) -> tuple[int, ...]:
        return tuple(math.floor(c / self.side_m) for c in row[: self.dimensions])

    def _begin(self, row: list[float], part: int) -> int:
        """An empty cell at the young end of its place's chain."""
        while self._used == self.maximum_cells:
            if not self._merge(now_s=row[self.dimensions + 1]):
                self._widen()
        place = self._place(row)
        before = self._youngest.get(place, _NONE)
        if before != _NONE and self._keys[before, -1] == part:
            # Wider cells may have brought one of this slice.
            return before
        cell = self._used
        self._used += 1
        self._sums[cell] = 0.0
        self._keys[cell, :-1], self._keys[cell, -1] = place, part
        self._younger[cell] = _NONE
        if before != _NONE:
            self._younger[before] = cell
        self._youngest[place] = cell
        return cell

    def _merge(self, now_s: float) -> bool:
        """Merge the two neighbours whose ages are the most alike; False if no place has two cells."""
        younger = self._younger[: self._used]
        first = np.flatnonzero(younger != _NONE)
        if not len(first):
            return False
        times = self._sums[: self._used, -2] / self._sums[: self._used, -1]
        early, late = times[first], times[younger[first]]
        # 1 − the ratio of their ages; a pair of which nothing is past yet comes last.
        gap, age = np.abs(late - early), np.maximum(now_s - np.minimum(early, late), 0.0)
        alike = np.divide(gap, age, out=np.full(len(first), np.inf), where=age > 0)
        old = int(first[alike.argmin()])
        young = int(younger[old])
        # The older cell's row stays, with the younger one's slice: whoever names it need not be found.
        self._sums[old] += self._sums[young]
        self._keys[old, -1] = self._keys[young, -1]
        self._younger[old] = younger[young]
        if self._younger[old] == _NONE:
            self._youngest[tuple(self._keys[old, :-1].tolist())] = old
        self._vacate(young)
        return True

    def _vacate(self, row: int) -> None:
        """Move the last row into this one."""
        last = self._used - 1
        self._used = last
        if row == last:
            return
        self._sums[row], self._keys[row] = self._sums[last], self._keys[last]
        self._younger[row] = self._younger[last]
        self._younger[: self._used][self._younger[: self._used] == last] = row
        if self._younger[row] == _NONE:
            self._youngest[tuple(self._keys[row, :-1].tolist())] = row

    def _widen(self) -> None:
        """Double the side of the cells; those of one slice that now share a place become one."""
        self.side_m *= 2.0
        keys, sums = self._keys[: self._used].copy(), self._sums[: self._used].copy()
        keys[:, :-1] //= 2
        order = np.lexsort(keys.T[[-1, *range(self.dimensions)]])
        keys, sums = keys[order], sums[order]
        starts = np.flatnonzero(np.append(True, (np.diff(keys, axis=0) != 0).any(axis=1)))
        self._used = used = len(starts)
        self._keys[:used], self._sums[:used] = keys[starts], np.add.reduceat(sums, starts)
        same = (self._keys[1:used, :-1] == self._keys[: used - 1, :-1]).all(axis=1)
        self._younger[:used] = np.append(np.where(same, np.arange(1, used), _NONE), _NONE)
        self._find_youngest()

    def _find_youngest(self) -> None:
        last = np.flatnonzero(self._younger[: self._used] == _NONE)
        places = self._keys[last, :-1].tolist()
        self._youngest = {tuple(place): int(cell) for place, cell in zip(places, last, strict=True)}
