"""The truth on a map of one survey, by which beliefs are judged."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.planning.survey import SurveyArea
from sim.field import Field
from sim.field_grid import BoolArray


@dataclass(frozen=True, eq=False)
class TruthMap:
    """A field on the cells of a map.

    Attributes:
        field: the truth.
        survey: the area as the vessel's software knows it.
        x_axis_m: middles of the cells to the east, ascending, shape (nx,), local metres.
        y_axis_m: to the north, shape (ny,).
    """

    field: Field
    survey: SurveyArea
    x_axis_m: FloatArray
    y_axis_m: FloatArray

    @cached_property
    def positions_deg(self) -> FloatArray:
        """Latitude and longitude of every cell, shape (ny, nx, 2)."""
        x, y = np.meshgrid(self.x_axis_m, self.y_axis_m)
        return self.survey.frame.to_geodetic(np.stack([x, y], axis=-1))

    @cached_property
    def is_water(self) -> BoolArray:
        """Which cells lie in the survey's water, shape (ny, nx)."""
        x, y = np.meshgrid(self.x_axis_m, self.y_axis_m)
        shapely.prepare(self.survey.water)
        return np.asarray(shapely.contains_xy(self.survey.water, x, y))

    def truth(self, time_s: float) -> FloatArray:
        """The field on the map, shape (ny, nx), NaN outside the survey's water."""
        if self._is_still:
            return self._first
        return self._at(time_s)

    def judge(self, model: FieldModel, time_s: float) -> tuple[float, float]:
        """RMSE of a belief against the truth at its moment, and the truth's standard deviation, over the water."""
        truth = self.truth(time_s)
        mean = model.mean_grid(self.x_axis_m, self.y_axis_m)
        return float(np.sqrt(np.nanmean((mean - truth) ** 2))), float(np.nanstd(truth))

    def crosses_land(self, a_deg: ArrayLike, b_deg: ArrayLike) -> bool:
        """Whether the leg between two positions (latitude, longitude) touches a land cell of the field, every 10 m.

        This asks the truth itself and shares nothing with the planner's polygons and rasters.
        """
        length_m = math.hypot(*np.subtract(*self.survey.frame.to_local(*np.transpose([a_deg, b_deg]))))
        share = np.linspace(0.0, 1.0, max(2, math.ceil(length_m / 10.0)))[:, None]
        points = np.asarray(a_deg) * (1.0 - share) + np.asarray(b_deg) * share
        return bool(self.field.is_land(points[:, 0], points[:, 1]).any())

    @property
    def _is_still(self) -> bool:
        first_s, last_s = self.field.times_s
        return first_s == last_s

    @cached_property
    def _first(self) -> FloatArray:
        return self._at(self.field.times_s[0])

    def _at(self, time_s: float) -> FloatArray:
        values = self.field.value(self.positions_deg[..., 0], self.positions_deg[..., 1], time_s)
        return np.where(self.is_water, values, np.nan)
