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
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from autonomy.geometry import FloatArray


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
        self._intervals = _Intervals()

    def restart(self) -> None:
        """See `Correction`."""
        self._last, self._begun_s = None, math.inf
        self._intervals = _Intervals()

    def add(self, time_s: float, value: float) -> Timed | None:
        """See `Correction`."""
        if self._last is not None and time_s - self._last[0] > max(self._window_s, self._response_s):
            self.restart()
        before, self._last = self._last, (time_s, value)
        if before is None:
            self._begun_s = time_s
            return None
        start_s = before[0]
        self._intervals.append(start_s, time_s, *self._undo(*before, time_s, value))
        # An interval may be longer than the window: then it is all that there is to it.
        begin_s = min(time_s - self._window_s, start_s)
        self._intervals.forget(begin_s)
        if self._begun_s > begin_s + 1e-6:
            return None
        return self._mean(begin_s, time_s)

    def _undo(self, start_s: float, start: float, end_s: float, end: float) -> tuple[float, float]:
        """The mean of the water's value between two readings, and when that is the value of."""
        passed_s = end_s - start_s
        kept, gone = math.exp(-passed_s / self._response_s), -math.expm1(-passed_s / self._response_s)
        return start + (end - start) / gone, end_s - self._response_s + passed_s * kept / gone

    def _mean(self, begin_s: float, end_s: float) -> Timed:
        middle_s, half_s = 0.5 * (begin_s + end_s), 0.5 * (end_s - begin_s)
        starts_s, ends_s, values, centres_s = self._intervals.rows

        def below(times_s: FloatArray) -> FloatArray:
            """The parabola's integral up to each time, but for a constant."""
            share = (np.maximum(begin_s, times_s) - middle_s) / half_s
            return share * (1.0 - share * share / 3.0)

        weights = below(ends_s) - below(starts_s)
        weights /= weights.sum()
        return Timed(float(weights @ values), float(weights @ centres_s) - self._delay_s)


class _Intervals:
    """Those between readings, oldest first: start, end, value and centre of each; appending is O(1) on average.

    In arrays, since a burst of readings that all came at once has thousands of them in a window.
    """

    def __init__(self) -> None:
        self._kept = np.empty((4, 64))
        self._first, self._end = 0, 0

    @property
    def rows(self) -> FloatArray:
        """(4, n)."""
        return self._kept[:, self._first : self._end]

    def append(self, start_s: float, end_s: float, value: float, centre_s: float) -> None:
        if self._end == self._kept.shape[1]:
            rows = self.rows
            self._kept = np.hstack([rows, np.empty((4, max(64, rows.shape[1])))])
            self._first, self._end = 0, rows.shape[1]
        self._kept[:, self._end] = start_s, end_s, value, centre_s
        self._end += 1

    def forget(self, before_s: float) -> None:
        """Those that have ended by then."""
        while self._kept[1, self._first] <= before_s:
            self._first += 1
