"""Water narrowed by fences and stalls; fences come from vehicles, so their polygons may be anything."""

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autonomy.geometry import LocalFrame
from autonomy.planning.restrictions import UNRESTRICTED, Region, Restrictions, restricted
from autonomy.planning.survey import SurveyArea, SurveyError

SURVEY = SurveyArea.from_geometry(
    LocalFrame(33.0, -119.0),
    shapely.box(0, 0, 1000, 800),
    land=shapely.box(450, 350, 550, 450),
    standoff_m=20.0,
)
WEST = Region(((-100.0, -100.0), (500.0, -100.0), (500.0, 900.0), (-100.0, 900.0)))
DISC = Region(((500.0, 400.0),), 300.0)


def water_of(**restrictions):
    return restricted(SURVEY, Restrictions(**restrictions))


def test_without_restrictions_it_is_the_survey_itself():
    assert restricted(SURVEY, UNRESTRICTED) is SURVEY
    assert water_of(margin_m=50.0) is SURVEY


def test_equal_restrictions_make_one_object():
    assert water_of(inside=((WEST,),)) is water_of(inside=((Region(WEST.corners_m),),))


def test_an_inclusion_keeps_its_margin_and_the_land_its_own():
    water = water_of(inside=((WEST,),), margin_m=30.0)
    assert water.navigable.bounds[2] == pytest.approx(470.0, abs=0.5)
    assert water.navigable.distance(shapely.box(450, 350, 550, 450)) >= 20.0 - 1e-9
    assert not water.leg_is_clear((100, 100), (600, 100))
    assert not water.approach_is_clear((600, 100), (100, 100)), "the way in keeps inside, too"
    assert water.water is SURVEY.water, "maps and readings keep all of it"


def test_inside_one_of_a_group_and_one_of_each_group():
    east = Region(((400.0, -100.0), (1100.0, -100.0), (1100.0, 900.0), (400.0, 900.0)))
    either, both = water_of(inside=((WEST, east),)), water_of(inside=((WEST,), (east,)))
    assert either.navigable.area == pytest.approx(SURVEY.navigable.area)
    assert both.navigable.bounds == pytest.approx((400.0, 0.0, 500.0, 800.0))


def test_a_disc_is_never_larger_than_its_circle():
    angles = np.linspace(0.0, 2 * np.pi, 999)
    corners = np.array(DISC.shape.exterior.coords)
    assert np.hypot(*(corners - [500.0, 400.0]).T).max() <= 300.0 + 1e-9
    inside = water_of(inside=((DISC,),)).navigable
    rim = np.stack([500 + 301 * np.cos(angles), 400 + 301 * np.sin(angles)], axis=1)
    assert not shapely.contains_xy(inside, rim[:, 0], rim[:, 1]).any()


def test_outside_a_disc_the_margin_covers_the_arcs_straight_pieces():
    water = water_of(outside=(Region(((200.0, 200.0),), 100.0),), margin_m=20.0)
    assert shapely.Point(200.0, 200.0).distance(water.navigable) >= 119.0


def test_water_given_up_may_be_left_but_not_sailed_to():
    given_up = Region(((200.0, 200.0),), 50.0)
    water = water_of(given_up=(given_up,))
    assert not water.is_navigable([[200.0, 200.0]])[0]
    assert water.approach_is_clear((200.0, 200.0), (300.0, 200.0))
    assert water.obstacles.area == pytest.approx(SURVEY.obstacles.area)


@pytest.mark.parametrize(
    "nothing",
    [
        {"inside": ((Region(((5e3, 5e3), (6e3, 5e3), (6e3, 6e3))),),)},
        {"inside": ((WEST,),), "margin_m": 400.0},
        {"outside": (Region(((500.0, 400.0),), 5e3),)},
        {"outside": (Region(((500.0, 400.0),), 3e38),)},
        {"given_up": (Region(((500.0, 400.0),), 5e3),)},
        {"inside": ((Region(((0.0, 0.0),) * 3),),)},
        {"inside": ((Region(((0.0, 0.0), (500.0, 0.0), (900.0, 0.0))),),)},
    ],
)
def test_where_no_water_is_left_it_is_said(nothing):
    with pytest.raises(SurveyError, match="no navigable water is left"):
        water_of(**nothing)


PLACES = st.tuples(st.integers(-3, 13).map(lambda k: 100.0 * k), st.integers(-3, 11).map(lambda k: 100.0 * k))
POLYGONS = st.lists(PLACES, min_size=3, max_size=8).map(lambda corners: Region(tuple(corners)))
DISCS = st.builds(
    lambda place, radius_m: Region((place,), radius_m), PLACES, st.sampled_from([1e-38, 40.0, 300.0, 1e9])
)
REGIONS = POLYGONS | DISCS


@settings(max_examples=60)
@given(
    st.lists(st.lists(REGIONS, min_size=1, max_size=2).map(tuple), max_size=2).map(tuple),
    st.lists(REGIONS, max_size=3).map(tuple),
    st.sampled_from([0.0, 20.0]),
    st.lists(REGIONS, max_size=2).map(tuple),
)
@example(
    # Nothing but points and lines, which an overlay may refuse together.
    inside=((Region(((0.0, 0.0),) * 3),), (Region(((0.0, 0.0),), 1e-38),)),
    outside=(),
    margin_m=0.0,
    given_up=(Region(((0.0, 0.0),) * 3), Region(((0.0, 100.0), (0.0, 100.0), (0.0, 200.0)))),
)
def test_any_polygons_leave_water_that_keeps_to_them_or_none(inside, outside, margin_m, given_up):
    """Corners on a lattice: crossing, touching, doubled and collinear edges are the rule."""
    try:
        water = restricted(SURVEY, Restrictions(inside, outside, margin_m, given_up)).navigable
    except SurveyError:
        return
    assert water.is_valid
    assert water.geom_type in ("Polygon", "MultiPolygon")
    assert water.difference(SURVEY.navigable).area < 1e-3
    for group in inside:
        allowed = shapely.union_all([region.shape for region in group])
        assert water.difference(allowed).area < 1e-3
    for region in (*outside, *given_up):
        assert water.intersection(region.shape).area < 1e-3
