"""What the shore draws its chart from: true to the survey, and small."""

import math

import numpy as np
import pytest
import shapely

from autonomy.charting import CORNERS, fence_rings, survey_notice
from autonomy.config import Configuration
from autonomy.effects import Topic
from autonomy.geometry import LocalFrame
from autonomy.mavlink.fence import Zone
from autonomy.mavlink.safeguards import Safeguards
from autonomy.planning.survey import SurveyArea
from autonomy.wire import decode, encode

FRAME = LocalFrame(33.5, -118.5)
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
CONFIGURATION = Configuration.model_validate(
    {"survey": {"area": AREA, "name": "the bay"}, "sensor": {"minimum": 0.0}}
)


def coast(corners: int) -> shapely.Polygon:
    """An island whose shore is as rough as one likes, with a lake in it."""
    turn = np.linspace(0.0, 2.0 * math.pi, corners, endpoint=False)
    rough = np.random.default_rng(1).normal(0.0, 3.0, corners)
    radius = 1500.0 + 200.0 * np.sin(9.0 * turn) + rough
    shore = np.column_stack([5000.0 + radius * np.cos(turn), 4000.0 + radius * np.sin(turn)])
    return shapely.Polygon(shore, [shapely.get_coordinates(shapely.Point(5000, 4000).buffer(300))])


def area_of(rings) -> shapely.Geometry:
    """What the even-odd rule makes of rings."""
    shape = shapely.Polygon()
    for ring in rings:
        shape = shape.symmetric_difference(shapely.Polygon(FRAME.to_local(*np.transpose(ring))))
    return shape


@pytest.mark.parametrize("corners", [CORNERS, 150])
def test_outlines_are_few_corners_and_where_they_were(corners: int) -> None:
    land = coast(4000)
    survey = SurveyArea.from_geometry(FRAME, shapely.box(0, 0, 10_000, 8_000), land=land, standoff_m=50.0)
    notice = survey_notice(CONFIGURATION, survey, corners)
    assert decode(Topic.SURVEY, encode(notice)) == notice
    every = [ring for rings in (notice.area, notice.land) for ring in rings]
    assert sum(map(len, every)) <= corners
    assert area_of(notice.land).symmetric_difference(land).area < 0.03 * land.area
    assert area_of(notice.area).symmetric_difference(survey.ground).area < 1e-3 * survey.ground.area
    south, west, north, east = notice.bounds_deg
    np.testing.assert_allclose(FRAME.to_local([south, north], [west, east])[1], (10_000, 8_000), atol=30.0)
    assert (notice.keep_in, notice.keep_out, notice.fence) == ((), (), ())
    assert (notice.name, notice.valid_range) == ("the bay", (0.0, None))
    assert notice.long_name == "sea water practical salinity"


def test_the_fence_is_drawn_as_the_autopilot_has_it() -> None:
    square = tuple((33.5 + dy, -118.5 + dx) for dx, dy in ((0, 0), (0.01, 0), (0.01, 0.01), (0, 0.01)))
    zones = Safeguards(((Zone(True, square),),), (Zone(False, ((33.52, -118.5),), 250.0),), (), {})
    inside, circle = fence_rings(FRAME, zones)
    assert inside == square
    distance = np.hypot(*(FRAME.to_local(*np.transpose(circle)) - FRAME.to_local(33.52, -118.5)).T)
    np.testing.assert_allclose(distance, 250.0, atol=0.2)
