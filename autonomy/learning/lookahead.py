"""Whether the map's uncertainty can be trusted: what an older model says of a place it had no reading near.

One step ahead a reading is predicted from its neighbour a few metres back, which nobody needs a map for. Here the
model is put aside, and asked for a reading only after the vessel has gone `distance_m` from where that was; then the
next one is put aside. Nothing learnt in between takes part, so the residuals are about the map at that distance from
the end of the track (or nearer to older tracks, where the vessel comes by them), and hardly depend on one another.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from autonomy.learning.calibration import Calibration, CalibrationFigures
from autonomy.learning.field_model import FieldModel
from autonomy.learning.numbers import FloatArray, positive

WINDOW = 100
# In a survey of ten lanes the nearest reading is, on average, a fortieth of the span away.
DISTANCES_PER_SPAN = 40


@dataclass(frozen=True, eq=False)
class _Aside:
    model: FieldModel
    point: FloatArray
    time_s: float


class Lookahead:
    """Residuals of readings `distance_m` from where the model that predicts them was put aside. Picklable."""

    def __init__(self, distance_m: float, window: int = WINDOW) -> None:
        self._distance_m = positive("distance_m", distance_m)
        self._aside: _Aside | None = None
        self.calibration = Calibration(window)

    def restart(self) -> None:
        """Forget all residuals, and the model put aside: another one is believed now."""
        self._aside = None
        self.calibration.restart()

    @property
    def figures(self) -> CalibrationFigures:
        """Of the readings in the window."""
        return self.calibration.figures

    @property
    def distance_m(self) -> float:
        """How far the vessel goes between two predictions."""
        return self._distance_m

    def look(
        self,
        point: FloatArray,
        value: float,
        time_s: float,
        model: Callable[[], FieldModel],
        log_slope: float = 0.0,
    ) -> None:
        """A reading `value` (latent units) at `point` (d,) metres and model time `time_s`, before it is learnt.

        `model()` is what is believed at that moment without it; it is asked for once in `distance_m`: a copy of the
        state, 2 ms for one of 600 coordinates, and 1 ms for the forecast. `log_slope`: see
        `Calibration.add`.
        """
        aside = self._aside
        if aside is not None:
            if math.dist(point.tolist(), aside.point.tolist()) < self._distance_m:
                return
            mean, variance = _forecast(aside.model, point, max(0.0, time_s - aside.time_s))
            noise = aside.model.kernel.noise_variance
            # A state that had broken without being noticed yet says nothing of the uncertainty.
            if math.isfinite(mean) and math.isfinite(variance):
                self.calibration.add(value - mean, max(variance, 0.0) + noise, log_slope)
        self._aside = _Aside(model(), point.copy(), time_s)


def _forecast(model: FieldModel, point: FloatArray, dt_s: float) -> tuple[float, float]:
    """Latent mean and variance at one place, `dt_s` after the model's moment, in O(D²).

    `model.advanced(dt_s).predict` would say the same, after work for a whole map.
    """
    kernel, parts = model.kernel, []
    for group, factor in zip(kernel.groups, model.factors, strict=True):
        a = np.zeros(0)
        if len(model):
            k = group.covariance(model.basis, point[None])[:, 0]
            # Unchecked: a model that was put aside broken is to give NaN, not to stop the reading.
            a = solve_triangular(factor, k, lower=True, check_finite=False)
        # The field later is the first row of A times its state now (and noise).
        parts += [weight * a for weight in group.time.transition(dt_s)[0]]
    c = np.concatenate(parts)
    gained = float(c @ c) - float(c @ (model.whitened_covariance @ c))
    return model.prior_mean + float(c @ model.whitened_mean), kernel.signal_variance - gained
