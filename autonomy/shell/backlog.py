"""Observations on their way ashore: kept until they have probably arrived, in forty bytes each, the oldest dropped."""

from collections import deque
from collections.abc import Iterable

import numpy as np

from autonomy.quality import Check
from autonomy.wire import MAXIMUM_OBSERVATIONS, ObservationNotice

CONFIRMED_S = 15.0
"""What was handed over so long ago, and the way is still there, has arrived: zenoh misses a dead link after ten."""

IN_FLIGHT = 2 * MAXIMUM_OBSERVATIONS
"""Handed over and not yet counted as arrived, at most: what a week has gathered drains in twenty minutes, and what is
sent twice over a broken link is little."""

_ROW = np.dtype(
    [
        ("time", "f8"),
        ("lat", "f8"),
        ("lon", "f8"),
        ("value", "f8"),
        ("flag", "u1"),
        ("checks", "u1", (len(Check),)),
    ]
)


class Backlog:
    """A queue whose head may be handed over again: at least once, and in order, each observation gets ashore.

    Whoever is ashore may get the last of `IN_FLIGHT` twice when the way was lost. For one thread at a time.

    Args:
        capacity: of more than so many the oldest are dropped. Memory is taken as it is needed.
    """

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"at least one observation must be kept, not {capacity}")
        self._rows = np.zeros(capacity, _ROW)
        self._first = (
            0  # of all that were ever put in: the oldest kept, the next to hand over, the next to come
        )
        self._next = 0
        self._end = 0
        self._handed: deque[tuple[float, int]] = deque()  # when, and up to which
        self.dropped = 0

    def __len__(self) -> int:
        """How many have not been handed over, or may have to be once more."""
        return self._end - self._first

    def is_ready(self, now: float) -> bool:
        """Whether `take` would give anything."""
        self._confirm(now)
        return self._end > self._next and self._room > 0

    def add(self, notices: Iterable[ObservationNotice]) -> None:
        """Put observations in, oldest first."""
        capacity = len(self._rows)
        for one in notices:
            place = (one.model_time_s, one.lat_deg, one.lon_deg, one.value)
            self._rows[self._end % capacity] = (*place, one.flag, one.checks)
            self._end += 1
            if self._end - self._first > capacity:
                self._first += 1
                self.dropped += 1
        self._next = max(self._next, self._first)

    def take(self, now: float) -> list[tuple[ObservationNotice, ...]]:
        """Batches to hand over now, by any clock that only goes forward; empty if enough is in flight."""
        if not self.is_ready(now):
            return []
        count = min(self._end - self._next, self._room)
        numbers = np.arange(self._next, self._next + count) % len(self._rows)
        self._next += count
        self._handed.append((now, self._next))
        notices = [_notice(row) for row in self._rows[numbers].tolist()]
        return [tuple(notices[i : i + MAXIMUM_OBSERVATIONS]) for i in range(0, count, MAXIMUM_OBSERVATIONS)]

    def lost(self) -> None:
        """The way was lost: what is not counted as arrived is to be handed over again."""
        self._next = self._first
        self._handed.clear()

    @property
    def _room(self) -> int:
        """For how many more there is room on the way."""
        return IN_FLIGHT - (self._next - self._first)

    def _confirm(self, now: float) -> None:
        while self._handed and now - self._handed[0][0] >= CONFIRMED_S:
            self._first = max(self._first, self._handed.popleft()[1])


def _notice(row: tuple[float, float, float, float, int, list[int]]) -> ObservationNotice:
    time_s, lat_deg, lon_deg, value, flag, checks = row
    return ObservationNotice(time_s, lat_deg, lon_deg, value, flag, tuple(map(int, checks)))
