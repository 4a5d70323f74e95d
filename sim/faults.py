"""What goes wrong with instruments: each fault turns a reading into what the instrument says instead."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Fault = Callable[[float, float], float]
"""`fault(time_s, value)` is what is said of a reading, in simulated seconds; NaN for nothing at all."""


@dataclass
class Spikes:
    """A share of the readings is off by ± `smallest` to `largest`, log-uniformly; in the field's unit."""

    rng: np.random.Generator
    share: float
    smallest: float
    largest: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.share <= 1.0:
            raise ValueError(f"share must be from 0 to 1, got {self.share}")
        if not 0.0 < self.smallest <= self.largest < math.inf:
            raise ValueError(f"spikes must be positive and finite, got {self.smallest} to {self.largest}")

    def __call__(self, time_s: float, value: float) -> float:
        """The reading, or a spike."""
        if self.rng.random() >= self.share:
            return value
        height = math.exp(self.rng.uniform(math.log(self.smallest), math.log(self.largest)))
        return value + (height if self.rng.random() < 0.5 else -height)


@dataclass
class Stuck:
    """From `period_s` on, and in every period after, the first reading is repeated for `duration_s`."""

    period_s: float
    duration_s: float
    _kept: float = field(default=math.nan, init=False)

    def __post_init__(self) -> None:
        _check_pattern(self.period_s, self.duration_s)

    def __call__(self, time_s: float, value: float) -> float:
        """The reading, or the one at which it got stuck."""
        if not _is_on(time_s, self.period_s, self.duration_s):
            self._kept = math.nan
            return value
        if math.isnan(self._kept):
            self._kept = value
        return self._kept


@dataclass
class Replaced:
    """From `period_s` on, and in every period after, readings are `value` for `duration_s`.

    NaN: the instrument has nothing to say; 0: a conductivity cell full of air; 3.4e38: a driver's error.
    """

    value: float
    period_s: float
    duration_s: float

    def __post_init__(self) -> None:
        _check_pattern(self.period_s, self.duration_s)

    def __call__(self, time_s: float, value: float) -> float:
        """The reading, or what stands for it."""
        return self.value if _is_on(time_s, self.period_s, self.duration_s) else value


def _check_pattern(period_s: float, duration_s: float) -> None:
    if not 0.0 < duration_s < period_s:
        raise ValueError(f"a fault must be shorter than its period, got {duration_s} s of {period_s} s")


def _is_on(time_s: float, period_s: float, duration_s: float) -> bool:
    return time_s >= period_s and time_s % period_s < duration_s
