"""What was told ashore in order, kept on board: whoever lacks a piece of it asks for it by its number."""

import threading
from collections import deque
from collections.abc import Iterable
from itertools import islice

from autonomy.observation_ring import ObservationRing, notices
from autonomy.wire import LogBatch, LogNotice, ObservationBatch, ObservationNotice
from autonomy.wire_rules import MAXIMUM_LINES, MAXIMUM_OBSERVATIONS


class _Numbers:
    """Which numbers are kept, which have been sent, and how many nobody has ever got. For any thread.

    Args:
        run: of the software; goes with every batch.
        capacity: of more than so many the oldest are dropped.
    """

    def __init__(self, run: int, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"at least one must be kept, not {capacity}")
        self._run = run
        self._capacity = capacity
        self._lock = threading.Lock()
        self.oldest = 0
        """Number of the oldest that is kept."""
        self.sent = 0
        """Number after the newest that has been sent; it need not have arrived."""
        self.end = 0
        """Number after the newest."""
        self._handed = 0
        self.dropped = 0
        """How many are gone that were never handed to anybody."""

    @property
    def is_behind(self) -> bool:
        """Whether there is something that has not been sent."""
        return self.sent < self.end

    def skip(self) -> None:
        """Nobody listens: what is there will be asked for, and only what comes from now on is sent by itself."""
        with self._lock:
            self.sent = self.end

    def _came(self) -> None:
        self.end += 1
        if self.end - self.oldest > self._capacity:
            self.dropped += self.oldest >= self._handed
            self.oldest += 1
            self.sent = max(self.sent, self.oldest)

    def _piece(self, first: int, count: int, most: int) -> tuple[int, int]:
        """Numbers of the first and after the last of at most so many, from a number on; they count as sent."""
        first = min(max(first if first >= 0 else self.end + first, self.oldest), self.end)
        last = min(first + min(max(count, 0), most), self.end)
        self._handed = max(self._handed, last)
        self.sent = max(self.sent, last)
        return first, last


class Observations(_Numbers):
    """The newest observations, in forty bytes each. Memory is taken as it is needed."""

    def __init__(self, run: int, capacity: int) -> None:
        super().__init__(run, capacity)
        self._ring = ObservationRing(capacity)

    def add(self, made: Iterable[ObservationNotice]) -> None:
        """Put observations in, oldest first."""
        with self._lock:
            for one in made:
                self._ring.append(one)
                self._came()

    def batch(self, first: int, count: int) -> ObservationBatch:
        """At most so many from a number on; from the oldest kept if that is newer. Negative ones count from the end."""
        with self._lock:
            start, last = self._piece(first, count, MAXIMUM_OBSERVATIONS)
            numbers = (self._run, start, self.oldest, self.sent)
            rows = self._ring.rows(start, last)
        return ObservationBatch(*numbers, notices(rows))


class Lines(_Numbers):
    """The newest lines of the log."""

    def __init__(self, run: int, capacity: int) -> None:
        super().__init__(run, capacity)
        self._lines: deque[LogNotice] = deque(maxlen=capacity)

    def add(self, line: LogNotice) -> None:
        """Put a line in."""
        with self._lock:
            self._lines.append(line)
            self._came()

    def batch(self, first: int, count: int) -> LogBatch:
        """At most so many from a number on; from the oldest kept if that is newer. Negative ones count from the end."""
        with self._lock:
            start, last = self._piece(first, count, MAXIMUM_LINES)
            numbers = (self._run, start, self.oldest, self.sent)
            lines = tuple(islice(self._lines, start - self.oldest, last - self.oldest))
        return LogBatch(*numbers, lines)
