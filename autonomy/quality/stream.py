"""Quality control of the probe's readings as they come in: QARTOD's tests, one reading behind the probe.

Whether a reading is a spike can only be told once the next one is in. So the newest reading is always held back;
what is judged comes out in the order in which it went in. That delays learning by one interval of the probe (at 1 Hz
and 2 m/s, by two metres of a track), and at the beginning and after every gap by `WARM_UP` of them: until a stream
has shown how its readings differ from one to the next, nothing can be called unusual, and the first of them has only
those after it to be compared with. When the probe falls silent, `release` lets go of what is held back.

Everything is pure: times are the vehicle's, and come with the readings.
"""

import math
from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

from autonomy.config import QualitySection
from autonomy.quality.checks import above, gross_range, spike_height, syntax
from autonomy.quality.flags import Flag, Flags, Tally, aggregate
from autonomy.quality.flat_line import FlatLine
from autonomy.quality.location import Location, Waters
from autonomy.quality.scale import Scale

_MOST_MISSING = 1e9
"""A gap counts as no more missing readings than this, however close together two of them once came."""

WARM_UP = 12
"""Readings held back at the beginning of a stream."""

SPIKE_NOISES = 5.0
"""A scaled limit of a spike's height: so many standard deviations of `Scale.noise`."""

STEP_NOISES, STEP_SPREADS = 10.0, 1.0
"""A scaled limit of a step: so many standard deviations of `Scale.noise`, but no less than this share of
`Scale.spread`; the water itself can be stepped through no faster."""

FAIL_RATIO = 2.0
"""Twice a scaled limit fails."""

CONSISTENT_READINGS = 30
"""So many readings in a row that follow from each other are right, however they differ from what was before: the
step was the water's, or what was before was wrong."""

MOST_HELD = 256
"""So many readings at most wait for a usable one: a sender whose clock stands still, or who sends nothing but NaN
faster than a gap ends it, shall neither fill the memory nor have ever more looked through for each."""

T = TypeVar("T")


@dataclass(frozen=True)
class Reading:
    """A value, not necessarily finite, with the vehicle's time and the place in local metres."""

    model_time_s: float
    x_m: float
    y_m: float
    value: float


@dataclass(frozen=True)
class Judged(Generic[T]):
    """A reading, its flags test by test, and what was handed in with it."""

    reading: Reading
    flags: Flags
    subject: T

    @property
    def flag(self) -> Flag:
        """Of the reading as a whole."""
        return aggregate(self.flags)


@dataclass(frozen=True)
class _Arrival(Generic[T]):
    """A reading with the flags that are known when it comes in."""

    reading: Reading
    subject: T
    timing: Flag
    syntax: Flag
    gross_range: Flag
    location: Flag
    flat_line: Flag
    usable: bool
    """Whether its value can be compared with those of others."""


class QualityControl(Generic[T]):
    """Judges one stream of readings; `T` is the type of what travels with a reading through the tests."""

    def __init__(self, section: QualitySection, fail_span: tuple[float, float], waters: Waters) -> None:
        """Begin a stream.

        Args:
            section: limits, in the sensor's unit; those that are None are scaled to the stream.
            fail_span: smallest and largest value that the probe can measure.
            waters: where readings can come from.
        """
        self._section = section
        self._fail_span = fail_span
        self._location = Location(waters, section.maximum_speed_mps)
        self._flat_line = FlatLine(section.flat_suspect_s, section.flat_fail_s, section.flat_tolerance)
        self._scale = Scale()
        self._queue: deque[_Arrival[T]] = deque()
        self._newest_s = self._usable_s = -math.inf
        self._before: Reading | None = None
        self._reference: Reading | None = None
        self._before_gap: Reading | None = None
        self._consistent = 0
        self._warm = False
        self._tally = Tally()

    @property
    def counts(self) -> dict[str, tuple[int, ...]]:
        """Readings flagged 1, 2, 3, 4 and 9, by the test's name in small letters, and as `aggregate`."""
        return self._tally.counts

    def add(self, reading: Reading, subject: T) -> list[Judged[T]]:
        """Take in a reading; returns those that can be judged now, oldest first."""
        judged = self._break_off(reading.model_time_s)
        self._queue.append(self._arrive(reading, subject))
        self._warm = self._warm or len(self._queue) > WARM_UP
        while self._warm and self._queue and self._may_judge():
            judged.append(self._judge())
        return judged

    def release(self, model_time_s: float) -> list[Judged[T]]:
        """What is held back, when no reading has come for longer than a gap until this time."""
        return self.flush() if model_time_s - self._newest_s > self._gap_s else []

    def flush(self) -> list[Judged[T]]:
        """Everything that is held back, now."""
        return [self._judge() for _ in range(len(self._queue))]

    # Arrival ----------------------------------------------------------------------------------------------------

    @property
    def _gap_s(self) -> float:
        return self._scale.gap_s if self._section.gap_s is None else self._section.gap_s

    def _break_off(self, time_s: float) -> list[Judged[T]]:
        """After a pause, or when the clock is set back, what comes has nothing to do with what is held back."""
        set_back = time_s < self._newest_s - self._gap_s
        if not set_back and time_s <= self._usable_s + self._gap_s:
            return []
        judged = self.flush()
        self._before_gap, self._reference = self._reference or self._before_gap, None
        self._before = None
        self._warm, self._consistent = False, 0
        self._flat_line.interrupt()
        self._scale.interrupt()
        if set_back:
            self._newest_s, self._before_gap = -math.inf, None
            self._location.interrupt()
        return judged

    def _arrive(self, reading: Reading, subject: T) -> _Arrival[T]:
        time_s, value = reading.model_time_s, reading.value
        section = self._section
        timing = self._timing(time_s)
        written = syntax(value)
        spanned = location = flat_line = Flag.NOT_EVALUATED
        if written is Flag.GOOD:
            span = (section.suspect_minimum, section.suspect_maximum)
            spanned = gross_range(value, self._fail_span, span)
        elif written is Flag.MISSING:
            spanned = flat_line = Flag.MISSING
        if timing is Flag.GOOD:
            location = self._location.add(time_s, reading.x_m, reading.y_m)
        usable = timing is Flag.GOOD and spanned in (Flag.GOOD, Flag.SUSPECT)
        if usable:
            self._usable_s = time_s
            flat_line = self._flat_line.add(time_s, value)
            self._scale.add_value(value)
        return _Arrival(reading, subject, timing, written, spanned, location, flat_line, usable)

    def _timing(self, time_s: float) -> Flag:
        """SUSPECT for a reading that isn't later than the one before; gaps are counted as missing readings."""
        passed_s, self._newest_s = time_s - self._newest_s, max(self._newest_s, time_s)
        if passed_s <= 0.0:
            return Flag.SUSPECT
        if passed_s <= self._gap_s:
            self._scale.add_interval(passed_s)
        elif math.isfinite(passed_s) and self._scale.interval_s is not None:
            due = min(passed_s / self._scale.interval_s, _MOST_MISSING)
            self._tally.add_missing(max(1, round(due) - 1))
        return Flag.GOOD

    # Judgement --------------------------------------------------------------------------------------------------

    def _may_judge(self) -> bool:
        """Whether the oldest reading has what it is compared with, or has waited for long enough."""
        waits = self._queue[0].usable and self._next_usable() is None
        return not waits or len(self._queue) > MOST_HELD

    def _next_usable(self) -> Reading | None:
        return next((one.reading for one in islice(self._queue, 1, None) if one.usable), None)

    def _judge(self) -> Judged[T]:
        """Judge the oldest reading that is held back."""
        if self._reference is None:
            self._reference = self._first_reference()
        after = self._next_usable()
        one = self._queue.popleft()
        spike = rate = Flag.MISSING if one.syntax is Flag.MISSING else Flag.NOT_EVALUATED
        if one.usable:
            spike, rate = self._spike(one.reading, after), self._rate(one.reading, one.flat_line)
            if max(spike, rate, one.flat_line) < Flag.SUSPECT:
                self._reference = one.reading
            self._before = one.reading
        flags = (one.timing, one.syntax, one.gross_range, one.location, spike, rate, one.flat_line)
        self._tally.add(flags)
        return Judged(one.reading, flags, one.subject)

    def _first_reference(self) -> Reading | None:
        """What the first readings are compared with: that of median value among them.

        But if that can't be reached from the last good one before the gap, even along a steady gradient, it is that:
        a probe may come back from a gap with nothing but bad readings.
        """
        usable = sorted((one.reading for one in self._queue if one.usable), key=lambda reading: reading.value)
        if not usable:
            return None
        typical, before = usable[len(usable) // 2], self._before_gap
        if before is not None and self._step(before, typical, growth=1.0) >= Flag.SUSPECT:
            return before
        return typical

    def _spike(self, reading: Reading, after: Reading | None) -> Flag:
        before, time_s = self._before, reading.model_time_s
        if before is None or after is None:
            return Flag.NOT_EVALUATED
        if max(time_s - before.model_time_s, after.model_time_s - time_s) > self._gap_s:
            return Flag.NOT_EVALUATED
        noise = self._scale.noise
        scaled = math.inf if noise is None else SPIKE_NOISES * noise
        section = self._section
        suspect = scaled if section.spike_suspect is None else section.spike_suspect
        fail = FAIL_RATIO * scaled if section.spike_fail is None else section.spike_fail
        if math.isinf(suspect) and math.isinf(fail):
            return Flag.NOT_EVALUATED
        return above(spike_height(before.value, reading.value, after.value), suspect, fail)

    def _rate(self, reading: Reading, flat_line: Flag) -> Flag:
        """Against the last reading that was good, so that not even a row of bad ones makes the next bad one good."""
        if self._reference is None:
            return Flag.NOT_EVALUATED
        flag = self._step(self._reference, reading)
        follows = self._before is not None and self._step(self._before, reading) is Flag.GOOD
        # A stuck probe is consistent too.
        odd = flag >= Flag.SUSPECT and follows and flat_line is Flag.GOOD
        self._consistent = self._consistent + 1 if odd else 0
        return Flag.GOOD if self._consistent >= CONSISTENT_READINGS else flag

    def _step(self, start: Reading, end: Reading, growth: float = 0.5) -> Flag:
        """The flag of the step from one reading to another.

        A scaled limit grows with a power of the time: by default that of a random walk.
        """
        passed_s = abs(end.model_time_s - start.model_time_s) or 1.0
        noise, interval_s, section = self._scale.noise, self._scale.interval_s, self._section
        scaled = math.inf
        if noise is not None and interval_s is not None:
            scaled = max(STEP_NOISES * noise, STEP_SPREADS * self._scale.spread)
            scaled *= max(1.0, passed_s / interval_s) ** growth
        suspect = scaled / passed_s if section.rate_suspect_per_s is None else section.rate_suspect_per_s
        fail = FAIL_RATIO * scaled / passed_s if section.rate_fail_per_s is None else section.rate_fail_per_s
        if math.isinf(suspect) and math.isinf(fail):
            return Flag.NOT_EVALUATED
        return above(abs(end.value - start.value) / passed_s, suspect, fail)
