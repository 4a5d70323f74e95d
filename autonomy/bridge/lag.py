"""What the way of the water and the slowness of a sensor do to a value, and how it is undone: by stamping it earlier.

A hose delays: the value at time t is of the water that was taken in at t - d. A sensor of first-order response follows
with dy/dt = (x - y) / τ: a steady gradient appears τ later, a step is smeared over a few τ. Two remedies:

shift    The value counts as of d + τ earlier. Right for gradients that are long against τ; of a step, which is half
         over after τ ln 2, it is 0.31 τ too early. The noise stays what it is.
sharpen  x = y + τ dy/dt (Fofonoff, Hayes & Millard 1974, WHOI-74-89). Between two readings that is, exactly, a mean of
         x over their interval: (y1 - a y0) / (1 - a), a = exp(-dt/τ), where what is nearer to its end counts more: with
         weights exp((t - t1)/τ), whose centre is τ - dt a / (1 - a) before its end. What it does to the noise is
         made bearable by a mean over a window, with weights of a parabola: nothing else of that length leaves less.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True)
class Timed:
    """A value, and when its water was taken in, in seconds of this computer's clock."""

    value: float
    taken_s: float


class Correction(Protocol):
    """Makes values of water of what a sensor says, in the order of its readings."""

    def add(self, time_s: float, value: float) -> Timed | None:
        """Take in what it said at a time later than all before; the newest value that is known now, if any."""

    def restart(self) -> None:
        """What comes has nothing to do with what was before."""


class Shift:
    """Stamps values earlier."""

    def __init__(self, lag_s: float) -> None:
        self._lag_s = lag_s

    def add(self, time_s: float, value: float) -> Timed:
        """See `Correction`."""
        return Timed(value, time_s - self._lag_s)

    def restart(self) -> None:
        """See `Correction`: nothing is remembered."""


@dataclass(frozen=True)
class _Interval:
    """Between two readings: the mean of the water's value over it, and when that is the value of."""

    start_s: float
    end_s: float
    value: float
    centre_s: float


class Sharpen:
    """Undoes a first-order response, smoothed over a window, and stamps the result earlier.

    Args:
        delay_s: of the hose.
        response_s: time constant τ of the sensor.
        window_s: over which it is smoothed. Nothing comes out before readings fill it; after a pause of more than
            both window and τ it has to be filled anew.
    """

    def __init__(self, delay_s: float, response_s: float, window_s: float) -> None:
        self._delay_s = delay_s
        self._response_s = response_s
        self._window_s = window_s
        self._last: tuple[float, float] | None = None
        self._begun_s = math.inf
        self._intervals: deque[_Interval] = deque()

    def restart(self) -> None:
        """See `Correction`."""
        self._last, self._begun_s = None, math.inf
        self._intervals.clear()

    def add(self, time_s: float, value: float) -> Timed | None:
        """See `Correction`."""
        if self._last is not None and time_s - self._last[0] > max(self._window_s, self._response_s):
            self.restart()
        before, self._last = self._last, (time_s, value)
        if before is None:
            self._begun_s = time_s
            return None
        self._intervals.append(self._undo(*before, time_s, value))
        # An interval may be longer than the window: then it is all that there is to it.
        begin_s = min(time_s - self._window_s, self._intervals[-1].start_s)
        while self._intervals[0].end_s <= begin_s:
            self._intervals.popleft()
        if self._begun_s > begin_s + 1e-6:
            return None
        return self._mean(begin_s, time_s)

    def _undo(self, start_s: float, start: float, end_s: float, end: float) -> _Interval:
        passed_s = end_s - start_s
        kept, gone = math.exp(-passed_s / self._response_s), -math.expm1(-passed_s / self._response_s)
        centre_s = end_s - self._response_s + passed_s * kept / gone
        return _Interval(start_s, end_s, start + (end - start) / gone, centre_s)

    def _mean(self, begin_s: float, end_s: float) -> Timed:
        middle_s, half_s = 0.5 * (begin_s + end_s), 0.5 * (end_s - begin_s)

        def below(time_s: float) -> float:
            """The parabola's integral up to a time, but for a constant."""
            share = (max(begin_s, time_s) - middle_s) / half_s
            return share - share**3 / 3.0

        weights = [below(each.end_s) - below(each.start_s) for each in self._intervals]
        total = sum(weights)
        pairs = list(zip(weights, self._intervals, strict=True))
        value = sum(weight * each.value for weight, each in pairs) / total
        taken_s = sum(weight * each.centre_s for weight, each in pairs) / total
        return Timed(value, taken_s - self._delay_s)
