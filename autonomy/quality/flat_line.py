"""The flat line test: a probe that is fouled, stuck or dead repeats itself.

QARTOD's test 8, over time instead of a count of readings: a reading's flag follows from how long all readings up to
it have stayed within the tolerance. A limit of None is scaled to the stream: `LONGEST_RATIO` times as many repeats as
the third longest of the last runs had. That asks for a probe that resolves its own noise and so hardly repeats itself.
Of one that sends each value four times, or rounds coarsely, nothing is known without a limit: in quiet water it stays
the same for as long as the water does.
"""

import math
from collections import deque
from dataclasses import dataclass

from autonomy.quality.flags import Flag

FEWEST_REPEATS = 4
"""However seldom a stream repeats itself, fewer repeats in a row are no flat line; it takes twice as many to fail.

Rounded to a tenth of its noise's standard deviation, a probe repeats itself four times once in a million readings.
"""

LONGEST_RATIO = 4.0

MOST_REPEATS = 0.5
"""A larger share of repeats among the last readings is no probe that resolves its noise."""

_RUNS = 61

_STUCK = 2
"""So many of the longest runs say nothing of what is usual: air in the cell must not excuse the fouling after it."""

_LONGEST_QUEUE = 20_000


@dataclass
class _Extreme:
    """A value, and where a run begins that starts right after it."""

    value: float
    next_s: float
    next_index: int


class _Run:
    """The longest run of readings, up to the newest, whose values differ by no more than the tolerance.

    Two monotonic queues hold what can still become the run's minimum and maximum; a reading costs amortised O(1).
    """

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self._index = 0
        self._start_s, self._start_index = math.nan, 0
        self._lowest: deque[_Extreme] = deque()
        self._highest: deque[_Extreme] = deque()

    def add(self, time_s: float, value: float) -> tuple[float, int]:
        """Take in a reading; returns how long the run has lasted, s, and how many readings follow its first."""
        self._index += 1
        if not self._lowest:
            self._start_s, self._start_index = time_s, self._index
        else:
            # The reading before is the last in both queues, and what follows it is known only now.
            for last in (self._lowest[-1], self._highest[-1]):
                last.next_s, last.next_index = time_s, self._index
        while self._lowest and self._lowest[-1].value >= value:
            self._lowest.pop()
        while self._highest and self._highest[-1].value <= value:
            self._highest.pop()
        self._lowest.append(_Extreme(value, time_s, self._index + 1))
        self._highest.append(_Extreme(value, time_s, self._index + 1))
        while self._highest[0].value - self._lowest[0].value > self._tolerance:
            self._drop(min(self._lowest, self._highest, key=lambda queue: queue[0].next_index))
        while max(len(self._lowest), len(self._highest)) > _LONGEST_QUEUE:
            self._drop(max(self._lowest, self._highest, key=len))
        return time_s - self._start_s, self._index - self._start_index

    def clear(self) -> None:
        """Begin anew with the next reading."""
        self._lowest.clear()
        self._highest.clear()

    def _drop(self, queue: deque[_Extreme]) -> None:
        gone = queue.popleft()
        self._start_s = max(self._start_s, gone.next_s)
        self._start_index = max(self._start_index, gone.next_index)


class FlatLine:
    """Follows one stream; gives the flag of each reading at once."""

    def __init__(
        self, suspect_s: float | None = None, fail_s: float | None = None, tolerance: float = 0.0
    ) -> None:
        self._suspect_s, self._fail_s = suspect_s, fail_s
        self._run = _Run(tolerance)
        self._repeats = 0
        self._runs: deque[int] = deque(maxlen=_RUNS)

    def add(self, time_s: float, value: float) -> Flag:
        """The flag of the next reading; a run exactly as long as a limit has reached it."""
        lasted_s, repeats = self._run.add(time_s, value)
        if repeats <= self._repeats:
            # Those of stuck probes too: coarse rounding looks the same at first, and is learnt when it goes on.
            self._runs.append(self._repeats)
        self._repeats = repeats
        usual = self._usual_repeats()
        if _reached(lasted_s, self._fail_s, repeats, 2.0 * usual):
            return Flag.FAIL
        if _reached(lasted_s, self._suspect_s, repeats, usual):
            return Flag.SUSPECT
        limits_s = (self._suspect_s or usual, self._fail_s or usual)
        return Flag.NOT_EVALUATED if min(limits_s) == math.inf else Flag.GOOD

    def _usual_repeats(self) -> float:
        """As many as should not come in a row; infinity where they may be as many as they will."""
        total = sum(self._runs)
        if total > MOST_REPEATS * (total + len(self._runs)):
            return math.inf
        longest = sorted(self._runs)[-1 - _STUCK :]
        return max(FEWEST_REPEATS, LONGEST_RATIO * longest[0]) if len(longest) > _STUCK else FEWEST_REPEATS

    def interrupt(self) -> None:
        """Readings are missing: nothing says that the value stayed the same meanwhile."""
        self._run.clear()


def _reached(lasted_s: float, limit_s: float | None, repeats: int, limit: float) -> bool:
    return repeats >= limit if limit_s is None else lasted_s >= limit_s
