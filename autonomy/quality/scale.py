"""What is usual in a stream: robust running estimates from which limits are scaled."""

import math

from autonomy.quality.running import RunningMedian

_STEPS, _VALUES, _INTERVALS = 61, 601, 31
_NOISE_PER_STEP = 1.0 / (0.6745 * math.sqrt(2.0))
"""Standard deviation of white noise over the median of the absolute steps that it makes."""
_SPREAD_PER_QUARTILES = 1.0 / 1.349
_FLOAT32 = 2.0**-23
_GAP_INTERVALS, _SHORTEST_GAP_S, _UNKNOWN_GAP_S = 5.0, 2.0, 60.0


class Scale:
    """Follows one stream's usable readings. All of them count, whatever is thought of them later.

    Medians stand nearly half of the readings being wrong; and a scale that only learnt from what it accepts would
    never get over a change that it does not.
    """

    def __init__(self) -> None:
        self._steps = RunningMedian(_STEPS)
        self._values = RunningMedian(_VALUES)
        self._intervals_s = RunningMedian(_INTERVALS)
        self._last: float | None = None

    def add_interval(self, interval_s: float) -> None:
        """The time from one reading to the next, no gap between them."""
        self._intervals_s.add(interval_s)

    def add_value(self, value: float) -> None:
        """A value. A step of zero tells nothing: coarse rounding hides the steps that are usual."""
        if self._last is not None and value != self._last:
            self._steps.add(abs(value - self._last))
        self._values.add(value)
        self._last = value

    def interrupt(self) -> None:
        """The next value does not follow from the last one."""
        self._last = None

    @property
    def noise(self) -> float | None:
        """Standard deviation of the white noise that would explain the usual step; None for want of any step.

        Never below the resolution of the readings, which travel as 32-bit numbers.
        """
        if not len(self._steps):
            return None
        return max(self._steps.median * _NOISE_PER_STEP, _FLOAT32 * abs(self._values.median))

    @property
    def spread(self) -> float:
        """Standard deviation of the last values, from their quartiles; 0 before the first."""
        if not len(self._values):
            return 0.0
        return (self._values.quantile(0.75) - self._values.quantile(0.25)) * _SPREAD_PER_QUARTILES

    @property
    def interval_s(self) -> float | None:
        """The usual time between readings; None before the second."""
        return self._intervals_s.median if len(self._intervals_s) else None

    @property
    def gap_s(self) -> float:
        """A pause that is longer than this is not usual."""
        if self.interval_s is None:
            return _UNKNOWN_GAP_S
        return max(_GAP_INTERVALS * self.interval_s, _SHORTEST_GAP_S)
