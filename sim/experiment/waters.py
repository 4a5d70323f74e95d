"""Where experiments are sailed: a field, its survey as the vessel's software reads it from files, and a map."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import ArrayLike

from autonomy.config import SurveySection
from autonomy.geometry import FloatArray
from autonomy.planning.passage import passage_of
from autonomy.planning.survey import SurveyArea, SurveyError, read_survey
from sim.field import Field, FieldError, MaskedField
from sim.land import feature_collection, land_polygons, water_outline
from sim.truth_map import TruthMap


class StillField(MaskedField):
    """A field held at one instant, without a current."""

    def __init__(self, inner: Field, time_s: float = 0.0) -> None:
        super().__init__(inner.info, inner.mask, (0.0, 0.0))
        self._inner = inner
        self._time_s = time_s

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""
        return self._inner.value(lat_deg, lon_deg, self._time_s)


def waters_of(
    field: Field,
    rows: int,
    columns: int,
    standoff_m: float = 0.0,
    passage_cells: int = 200,
) -> TruthMap:
    """All of a field's water as a survey, and a map of `rows` x `columns` cells over its bounds.

    The survey goes through GeoJSON files, which is how a vessel learns of a coast.

    Raises:
        FieldError: no survey can be made of this field.
    """
    survey = _survey_of(field, standoff_m, passage_cells)
    x_min, y_min, x_max, y_max = survey.bounds
    x_axis_m, y_axis_m = cell_middles(x_min, x_max, columns), cell_middles(y_min, y_max, rows)
    return TruthMap(field, survey, x_axis_m, y_axis_m)


def cell_middles(first: float, last: float, count: int) -> FloatArray:
    """Middles of `count` equal cells between two ends, shape (count,)."""
    return np.asarray(first + (np.arange(count) + 0.5) * ((last - first) / count))


def nearest_water(waters: TruthMap, point_m: ArrayLike) -> FloatArray:
    """The middle of the map's cell nearest to a place from which most of the water can be reached; shape (2,).

    Raises:
        FieldError: no cell is navigable.
    """
    survey, wanted = waters.survey, np.asarray(point_m, dtype=float)
    rows, columns = np.nonzero(waters.is_water)
    cells = np.column_stack([waters.x_axis_m[columns], waters.y_axis_m[rows]])
    cells = cells[survey.is_navigable(cells)]
    if not len(cells):
        raise FieldError(f"{waters.field.info.description}: the vessel can go nowhere")
    order = np.argsort(np.hypot(*(cells - wanted).T), kind="stable")
    sites = survey.candidate_sites(20, 20)
    passage = passage_of(survey)
    for cell in cells[order]:
        if not len(sites) or 2 * passage.reachable(cell, sites).sum() >= len(sites):
            return np.asarray(cell)
    raise FieldError(f"{waters.field.info.description}: no water leads to most of the rest")


def _survey_of(field: Field, standoff_m: float, passage_cells: int) -> SurveyArea:
    with TemporaryDirectory() as folder:
        area, land = Path(folder) / "area.geojson", Path(folder) / "land.geojson"
        area.write_text(json.dumps(feature_collection(water_outline(field), "area")), encoding="utf-8")
        land.write_text(json.dumps(feature_collection(land_polygons(field), "land")), encoding="utf-8")
        section = SurveySection(area=area, land=land, standoff_m=standoff_m, passage_cells=passage_cells)
        try:
            return read_survey(section)
        except SurveyError as error:
            raise FieldError(f"no survey can be made of this field: {error}") from error
