"""Lawnmowers: covers of the water that spend a budget, and the planner that sails them."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.learning import FieldModel, Hyperparameters
from autonomy.planning.assembly import verify
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import passage_of
from autonomy.planning.planners import lawnmower, patrol, route, spots
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import headings, lawnmowers, sweeps

FRAME = LocalFrame(33.0, -119.0)
SIDE = 10_000.0
ISLAND = shapely.Point(4000, 6000).buffer(1500)


def survey(land=None, area=None, **given):
    return SurveyArea.from_geometry(
        FRAME, box(0, 0, SIDE, SIDE) if area is None else area, land=land, **given
    )


def request(start=(100.0, 100.0), lengthscale_m=1000.0, **given):
    model = FieldModel.prior(Hyperparameters(1.0, 0.05, (lengthscale_m, lengthscale_m)))
    return PlanRequest(model, np.array(start), 20, (12, 12), "a test", **given)


def farthest_m(area, start, route):
    """How far any navigable cell of the water is from the route."""
    track = shapely.LineString([start, *route])
    cells = passage_of(area).raster.centres_m
    return float(shapely.distance(track, shapely.points(cells)).max())


@pytest.mark.parametrize("length", [3.0, 6.0, 10.0, 16.0])
def test_on_a_square_the_lanes_are_as_dense_as_the_length_allows(length):
    """n lanes of s = 1/n, s/2 short at both ends, take n (1 − s) + (n − 1) s = n − s, and the way to the first."""
    area, start = survey(), np.array([0.0, 0.0])
    found = lawnmowers(area, start, length * SIDE)
    assert len(found) == 8
    for sweep in found:
        assert 0.97 * length * SIDE <= sweep.length_m <= length * SIDE
        assert sweep.length_m == path_length_m([start, *sweep.route_m])
    nearest = min(found, key=lambda sweep: sweep.approach_m)
    lanes = round(SIDE / nearest.spacing_m)
    assert lanes - 1 / lanes + np.hypot(0.5, 0.5) / lanes <= length
    more = lanes + 1
    assert more - 1 / more + np.hypot(0.5, 0.5) / more > length
    assert farthest_m(area, start, nearest.route_m) <= np.hypot(0.5, 0.5) * nearest.spacing_m + 1.0


@pytest.mark.parametrize("length", [4.0, 9.0])
def test_round_an_island_all_of_it_is_over_water_and_all_the_water_is_covered(length):
    area, start = survey(ISLAND, standoff_m=100.0), np.array([100.0, 100.0])
    found = lawnmowers(area, start, length * SIDE)
    assert len(found) == 8
    for sweep in found:
        verify(start, sweep.route_m, area)
        assert 0.8 * length * SIDE <= sweep.length_m <= length * SIDE
        # Pieces shorter than half a spacing are left to their neighbours.
        assert farthest_m(area, start, sweep.route_m) <= 1.2 * sweep.spacing_m


def test_a_tilted_area_is_swept_along_its_own_sides():
    tilted = shapely.affinity.rotate(box(0, 0, 12_000, 4000), 30.0)
    area = survey(area=tilted)
    assert np.degrees(headings(area)) == pytest.approx([30.0, 120.0])
    start = np.array(tilted.centroid.coords[0])
    for sweep in sweeps(area, start, 1000.0):
        lanes = np.diff(sweep.route_m, axis=0)[::2]
        along = np.degrees(np.arctan2(lanes[:, 1], lanes[:, 0])) % 180.0
        assert along == pytest.approx(np.full(len(lanes), np.degrees(sweep.heading_rad)), abs=1e-6)
        assert sweep.spacing_m <= 1000.0


def test_the_way_home_is_part_of_the_length():
    area, start, home = survey(ISLAND), np.array([100.0, 100.0]), np.array([9000.0, 9000.0])
    for sweep in lawnmowers(area, start, 80_000.0, home_m=home):
        way = path_length_m(passage_of(area).path(sweep.route_m[-1], home))
        assert sweep.length_m + way <= 80_000.0


ISLANDS = shapely.union_all(
    [
        shapely.Point(x, y).buffer(r, quad_segs=3)
        for x, y, r in [(3100, 6300, 1400), (7200, 7600, 700), (6400, 2300, 1200)]
    ]
)


@pytest.mark.parametrize("home", [None, (600.0, 5000.0)])
@pytest.mark.parametrize("length", [3.0, 6.0, 10.0])
def test_among_islands_all_variants_spend_the_length(length, home):
    """Ways round islands make one lane more or less a leap; what is left over is spent all the same."""
    area, start = survey(ISLANDS, standoff_m=40.0, passage_cells=60), np.array([600.0, 5000.0])
    side_m = float(np.sqrt(area.area_m2))
    home = None if home is None else np.array(home)
    found = lawnmowers(area, start, length * side_m, home_m=home)
    assert len(found) == 8
    for sweep in found:
        verify(start, sweep.route_m, area)
        route = np.vstack([start, sweep.route_m])
        back = 0.0 if home is None else path_length_m(passage_of(area).path(route[-1], home))
        assert 0.9 * length * side_m <= path_length_m(route) + back <= length * side_m


def test_lanes_that_all_lie_over_an_island_are_made_closer():
    """The only lane along the middle is cut by an island into pieces shorter than half of its width."""
    area = survey(shapely.Point(5000, 5000).buffer(2000), area=box(2500, 0, 7500, SIDE))
    start = np.array([2600.0, 600.0])
    across = sweeps(area, start, SIDE, headings_rad=[0.0])
    assert across
    assert all(sweep.spacing_m < SIDE for sweep in across)
    made = lawnmower.plan(request(start, budget_m=1500.0), area)
    assert made.length_m == pytest.approx(1500.0, rel=1e-3)


def test_only_the_vessels_own_basin_is_swept():
    area = survey(box(4800, 0, 5200, SIDE))
    for sweep in lawnmowers(area, np.array([500.0, 500.0]), 60_000.0):
        assert np.all(sweep.route_m[:, 0] <= 4800.0)


def test_the_planner_begins_at_the_nearest_corner():
    for corner in ((100.0, 100.0), (9900.0, 100.0), (100.0, 9900.0), (9900.0, 9900.0)):
        made = lawnmower.plan(request(corner, budget_m=80_000.0), survey())
        assert np.hypot(*(made.route_m[0] - corner)) <= 1500.0
        assert made.length_m <= 80_000.0
        assert made.is_spot.all()


def test_without_a_budget_the_lanes_are_as_far_apart_as_the_field_allows():
    made = lawnmower.plan(request(lengthscale_m=1000.0), survey())
    levels = np.unique(
        np.round(made.route_m[:, 1 if abs(made.route_m[1, 0] - made.route_m[0, 0]) > 5000 else 0])
    )
    assert np.diff(levels) == pytest.approx(np.full(8, SIDE / 9), abs=1.0)
    assert made.mutual_information > 0.0


def test_a_budget_too_small_for_a_lane_is_spent_on_part_of_one():
    made = lawnmower.plan(request(budget_m=2000.0), survey())
    assert made.length_m == pytest.approx(2000.0, rel=0.01)
    home = np.array([100.0, 100.0])
    made = lawnmower.plan(request(budget_m=2000.0, home_m=home), survey())
    assert made.length_m + np.hypot(*(made.route_m[-1] - home)) <= 2000.0
    assert made.length_m >= 900.0
    with pytest.raises(PlanningError, match="the way home is"):
        lawnmower.plan(request(budget_m=2000.0, home_m=np.array([9000.0, 9000.0])), survey())


@pytest.mark.parametrize("planner", [spots, route, patrol, lawnmower], ids=lambda planner: planner.NAME)
@pytest.mark.parametrize("home", [None, (1800.0, 9100.0), (-60.0, 700.0)])
def test_with_a_budget_nearly_spent_there_is_a_short_plan_or_a_planning_error(planner, home):
    """Never a plan that leads nowhere, never one that is longer, and never another error."""
    area = survey(ISLANDS, standoff_m=40.0, passage_cells=60)
    start = np.array([1600.0, 600.0])
    home_m = None if home is None else np.array(home)
    home_length_m = 0.0 if home_m is None else path_length_m(passage_of(area).path(start, home_m))
    whole = replace(request(start, 4000.0, home_m=home_m, iterations=5), spots=5, lattice=(6, 6))
    for spare_m in (-1.0, 0.0, 1e-6, 0.3, 20.0, 800.0):
        asked = replace(whole, budget_m=home_length_m + spare_m)
        if spare_m <= 0.0:
            with pytest.raises(PlanningError, match=r"get anywhere|the way home is"):
                planner.plan(asked, area)
            continue
        try:
            made = planner.plan(asked, area)
        except PlanningError:
            assert spare_m <= 1.0 + 1e-3 * home_length_m
            continue
        back_m = 0.0 if home_m is None else path_length_m(passage_of(area).path(made.route_m[-1], home_m))
        assert 0.0 < made.length_m + back_m <= asked.budget_m + 1e-3
