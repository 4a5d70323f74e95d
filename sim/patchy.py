"""A made-up sea for any survey: patches of one size all over its own water, and its own land.

The field is a sum of plane waves whose wave numbers are drawn from the spectrum of a Matérn-3/2 process, a
multivariate t distribution with three degrees of freedom (Rasmussen & Williams 2006, section 4.2.1). That is rougher
than the squared exponential that a model begins with, as real seas are.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry import Polygon

from autonomy.config import SensorSection
from autonomy.geometry import FloatArray
from autonomy.learning.transform import Transform, transform_of
from autonomy.planning.survey import SurveyArea
from sim.field import FieldInfo, MaskedField
from sim.field_grid import BoolArray, LandMask, RectilinearGrid, near

_WAVES = 128
_FREEDOM = 3.0
"""Twice the smoothness of a Matérn-3/2 process."""

_CELLS = 100
_RANGE_SHARE = 0.05
"""Standard deviation of the field, as a share of what the sensor's limits allow: no value gets near them."""

_FROM_LIMIT = 5.0
"""Standard deviations between the only limit that there is and the field's mean."""


@dataclass(frozen=True)
class Levels:
    """Mean and standard deviation of a field, in the units that `transform` makes of the sensor's."""

    mean: float
    deviation: float
    transform: Transform

    @classmethod
    def within(cls, sensor: SensorSection, deviation: float | None = None) -> "Levels":
        """Such that the sensor's limits hold, with room to spare.

        Args:
            sensor: whose minimum, maximum and transform count.
            deviation: where it is known; None: what suits the limits, or 1 where there are none.
        """
        transform = transform_of(sensor)
        low, high = (
            float(transform.forward(limit)) if transform.refusal(limit) is None else None
            for limit in (sensor.minimum, sensor.maximum)
        )
        if low is not None and high is not None:
            spread = _RANGE_SHARE * (high - low)
            return cls(0.5 * (low + high), min(spread, deviation or spread), transform)
        spread = deviation or 1.0
        if low is not None:
            return cls(low + _FROM_LIMIT * spread, spread, transform)
        return cls(0.0 if high is None else high - _FROM_LIMIT * spread, spread, transform)


class PatchyField(MaskedField):
    """Stands still; has a value everywhere but on land, and knows no current.

    Args:
        survey: whose land is the field's.
        length_m: of the kernel: patches are about twice as large.
        levels: mean and standard deviation.
        sensor: what is measured.
        rng: what the field is drawn from.
    """

    def __init__(
        self,
        survey: SurveyArea,
        length_m: float,
        levels: Levels,
        sensor: SensorSection,
        rng: np.random.Generator,
    ) -> None:
        self._frame = survey.frame
        self._land = survey.land if survey.land is not None else Polygon()
        shapely.prepare(self._land)
        self._levels = levels
        stretch = np.sqrt(_FREEDOM / rng.chisquare(_FREEDOM, _WAVES))
        self._number = rng.normal(0.0, 1.0 / length_m, (_WAVES, 2)) * stretch[:, None]
        self._phase = rng.uniform(0.0, 2.0 * math.pi, _WAVES)
        name = sensor.variable.replace("_", " ")
        said = f"made up, Matérn-3/2 with a length of {length_m / 1e3:.3g} km"
        info = FieldInfo(sensor.variable, name, sensor.units, said)
        super().__init__(info, self._masked(survey), (0.0, 0.0))

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land."""
        points_m = self._frame.to_local(lat_deg, lon_deg)
        waves = np.cos(points_m @ self._number.T + self._phase)
        latent = self._levels.mean + self._levels.deviation * math.sqrt(2.0 / _WAVES) * waves.sum(axis=-1)
        return np.where(self._on_land(points_m), np.nan, self._levels.transform.inverse(latent))

    def is_land(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> BoolArray:
        """Whether positions lie in the survey's polygons of land."""
        return self._on_land(self._frame.to_local(lat_deg, lon_deg))

    def _on_land(self, points_m: FloatArray) -> BoolArray:
        return np.asarray(shapely.intersects_xy(self._land, points_m[..., 0], points_m[..., 1]))

    def _masked(self, survey: SurveyArea) -> LandMask:
        """The land on a lattice over the survey, for who asks for the field's extent."""
        x_min, y_min, x_max, y_max = survey.bounds
        corners = survey.frame.to_geodetic([(x_min, y_min), (x_min, y_max), (x_max, y_min), (x_max, y_max)])
        # On one side of the date line, as grids have it.
        corners[:, 1] = near(corners[:, 1], survey.frame.origin_lon_deg)
        (south, west), (north, east) = corners.min(axis=0), corners.max(axis=0)
        grid = RectilinearGrid(np.linspace(south, north, _CELLS), np.linspace(west, east, _CELLS))
        lat, lon = grid.positions(*np.indices((_CELLS, _CELLS)))
        return LandMask(grid, self.is_land(lat, lon))
