"""Histories that never grow beyond a bound: the older, the thinner."""

from bisect import bisect_right

import numpy as np
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray

_FRESH_S = 60.0
"""Within the last minute all gaps count alike."""


class Stops:
    """Payloads by time, within a number of bytes: where there are too many, the older lose more.

    Args:
        maximum_bytes: of all payloads together; the newest is kept whatever its size.
    """

    def __init__(self, maximum_bytes: int) -> None:
        self._maximum_bytes = maximum_bytes
        self._times_s: list[float] = []
        self._payloads: list[bytes] = []
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._times_s)

    @property
    def times_s(self) -> list[float]:
        """When, ascending."""
        return list(self._times_s)

    @property
    def size_bytes(self) -> int:
        """Of all payloads together."""
        return self._bytes

    def add(self, time_s: float, payload: bytes) -> None:
        """Keep a payload; one of the same time is replaced."""
        at = bisect_right(self._times_s, time_s)
        if at and self._times_s[at - 1] == time_s:
            self._drop(at - 1)
            at -= 1
        self._times_s.insert(at, time_s)
        self._payloads.insert(at, payload)
        self._bytes += len(payload)
        self._thin()

    def limit(self, maximum_bytes: int) -> None:
        """Keep to another bound from now on."""
        self._maximum_bytes = maximum_bytes
        self._thin()

    def at(self, time_s: float) -> tuple[float, bytes]:
        """Time and payload of the newest that is no later, or else of the oldest. IndexError if there is none."""
        index = max(0, bisect_right(self._times_s, time_s) - 1)
        return self._times_s[index], self._payloads[index]

    def _thin(self) -> None:
        while self._bytes > self._maximum_bytes and len(self._times_s) > 1:
            self._drop(self._least_missed())

    def _least_missed(self) -> int:
        """Whose going leaves the smallest gap for its age; neither end of the history goes while there is another."""
        times = np.array(self._times_s)
        if len(times) == 2:
            return 0
        gap = times[2:] - times[:-2]
        return 1 + int(np.argmin(gap / (times[-1] - times[1:-1] + _FRESH_S)))

    def _drop(self, index: int) -> None:
        del self._times_s[index]
        self._bytes -= len(self._payloads.pop(index))


class Rows:
    """Rows of numbers in the order of their coming: all of them, then every second, every fourth, ….

    Args:
        width: numbers per row.
        limit: rows kept, at most.
    """

    def __init__(self, width: int, limit: int) -> None:
        self._rows = np.empty((limit, width))
        self._count = 0
        self._stride = 1
        self._heard = 0
        self._newest: FloatArray | None = None

    def add(self, row: ArrayLike) -> None:
        """Take another row."""
        self._newest = np.asarray(row, dtype=float)
        if self._heard % self._stride == 0:
            if self._count == len(self._rows):
                kept = self._rows[::2].copy()
                self._count = len(kept)
                self._rows[: self._count] = kept
                self._stride *= 2
            # After the halving this one may be of those left out.
            if self._heard % self._stride == 0:
                self._rows[self._count] = self._newest
                self._count += 1
        self._heard += 1

    def all(self) -> FloatArray:
        """What is kept, shape (n, width), the newest row always among it."""
        kept = self._rows[: self._count]
        if self._newest is None or (self._heard - 1) % self._stride == 0:
            return kept.copy()
        return np.vstack([kept, self._newest])
