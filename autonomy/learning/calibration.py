"""Whether the model's uncertainty can be trusted: what it said of each reading just before learning it.

Every reading is predicted before it is learnt: a Gaussian with a mean and a variance (of the field and of the
reading's noise). The innovation over its standard deviation is a residual z; if the model is right the z are
independent and standard normal (Dawid 1984, "the prequential approach"), so that 95 % of them lie within ±1.96
and their mean square is 1.

A stream along a track is predicted mostly from neighbours a few metres back: its residuals tell whether the noise
and the steps from one reading to the next are right, and little about the map between the tracks. That is what
`autonomy.learning.lookahead` is for.
"""

import math
from dataclasses import dataclass

import numpy as np

WINDOW = 500
_QUANTILE_975 = 1.959963984540054


@dataclass(frozen=True)
class CalibrationFigures:
    """What a window of residuals says; NaN while it is empty.

    Attributes:
        coverage_95: share of the readings within their central 95 % interval; .95 if the model is right.
        mean_square: mean of z²; 1 if the model is right, more if it is too sure, less if it is too cautious.
        log_score: mean log predictive density of a reading, in nats, density per sensor unit; higher is better,
            and only differences between models of the same readings mean anything.
        count: readings in the window.
    """

    coverage_95: float
    mean_square: float
    log_score: float
    count: int


class Calibration:
    """The residuals of the last `window` readings. Picklable; adding is O(1).

    Each reading is to be added once. Nothing is summed along the way, so nothing drifts: the figures are worked
    out over the window, microseconds, when they are asked for.
    """

    def __init__(self, window: int = WINDOW) -> None:
        if isinstance(window, bool) or int(window) != window or window < 1:
            raise ValueError(f"window must be a whole number of readings, at least 1, not {window!r}")
        self._z = np.zeros(int(window))
        self._scores = np.zeros(int(window))
        self._added = 0

    @property
    def window(self) -> int:
        """How many readings are looked back on."""
        return len(self._z)

    @property
    def count(self) -> int:
        """How many readings the figures are of."""
        return min(self._added, self.window)

    def add(self, innovation: float, variance: float, log_slope: float = 0.0) -> None:
        """A reading that was `innovation` above its predicted mean, its predicted variance being `variance`.

        `variance` is of the reading, noise included. Where the model works in transformed units, `log_slope` is
        the transform's `log_slope` at the reading: it makes the density one per sensor unit.
        ValueError, and no change, for what is not finite or a variance that is not positive.
        """
        if not (math.isfinite(innovation) and math.isfinite(log_slope)):
            raise ValueError(f"innovation and log_slope must be finite, not {innovation!r}, {log_slope!r}")
        if not (math.isfinite(variance) and variance > 0.0):
            raise ValueError(f"variance must be positive and finite, not {variance!r}")
        z = innovation / math.sqrt(variance)
        place = self._added % self.window
        self._z[place] = z
        self._scores[place] = log_slope - 0.5 * (z * z + math.log(2.0 * math.pi * variance))
        self._added += 1

    def restart(self) -> None:
        """Forget all residuals: those of a model that is believed no longer say nothing of its successor."""
        self._added = 0

    @property
    def figures(self) -> CalibrationFigures:
        """All figures at once, of the same window."""
        count = self.count
        if not count:
            return CalibrationFigures(math.nan, math.nan, math.nan, 0)
        z, scores = self._z[:count], self._scores[:count]
        return CalibrationFigures(
            coverage_95=float((np.abs(z) <= _QUANTILE_975).mean()),
            mean_square=float(z @ z) / count,
            log_score=float(scores.mean()),
            count=count,
        )

    @property
    def coverage_95(self) -> float:
        """Share of the window's readings within ±1.96 standard deviations; NaN while it is empty."""
        return self.figures.coverage_95

    @property
    def mean_square(self) -> float:
        """Mean of z² over the window; NaN while it is empty."""
        return self.figures.mean_square

    @property
    def log_score(self) -> float:
        """Mean log predictive density of the window's readings, per sensor unit; NaN while it is empty."""
        return self.figures.log_score
