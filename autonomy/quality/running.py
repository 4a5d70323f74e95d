"""A median over the last values, which one wild value in two doesn't move: what a stream itself says is usual."""

from bisect import bisect_left, insort
from collections import deque


class RunningMedian:
    """The median of the last `window` values."""

    def __init__(self, window: int) -> None:
        if window < 1:
            raise ValueError(f"window must be at least 1, not {window}")
        self._recent: deque[float] = deque()
        self._sorted: list[float] = []
        self._window = window

    def __len__(self) -> int:
        return len(self._recent)

    def add(self, value: float) -> None:
        """Take in a finite value; the oldest goes when there are more than `window`."""
        if len(self._recent) == self._window:
            del self._sorted[bisect_left(self._sorted, self._recent.popleft())]
        self._recent.append(value)
        insort(self._sorted, value)

    def quantile(self, share: float) -> float:
        """The value that a share (0 to 1) of the values lies below; ValueError before the first."""
        if not self._sorted:
            raise ValueError("no values yet")
        return self._sorted[min(len(self._sorted) - 1, int(share * len(self._sorted)))]

    @property
    def median(self) -> float:
        """The upper median; ValueError before the first value."""
        return self.quantile(0.5)
