"""Still fields of the sea as planners meet them: a survey whose land is the cells without water."""

from pathlib import Path

import numpy as np
import shapely
from examinations import field_named
from sea_fields import SeaField

from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from sim.trials import Sea


def sea_named(name: str, directory: Path) -> Sea:
    """A field of `examinations.field_named`."""
    return sea_of(field_named(name, directory))


def sea_of(field: SeaField) -> Sea:
    """The field's box without the cells that are not water."""
    x, y, half = field.x_axis_m, field.y_axis_m, 0.5 * field.step_m
    row, column = np.nonzero(~field.water)
    cells = shapely.box(x[column] - half, y[row] - half, x[column] + half, y[row] + half)
    land = shapely.union_all(cells) if len(cells) else None
    box = shapely.box(x[0] - half, y[0] - half, x[-1] + half, y[-1] + half)
    survey = SurveyArea.from_geometry(LocalFrame(33, -119), box, land=land)
    return Sea(field.name, survey, field.at, field.points, field.truth)
