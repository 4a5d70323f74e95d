"""Whole routes: legs over water, within the budget, home in time, the same for the same request."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.learning.field_model import FieldModel
from autonomy.learning.history import HistoryCells
from autonomy.learning.kernel import Hyperparameters
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import passage_of
from autonomy.planning.planners.route import plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from autonomy.planning.water_lattice import water_lattice_of

MODEL = FieldModel.prior(Hyperparameters(1.0, 0.01, (2000.0, 2000.0)))


@pytest.fixture(scope="module")
def bay():
    """10 km of water with a headland, an island and a long thin mole."""
    land = shapely.union_all(
        [
            shapely.Point(3000, 0).buffer(2200),
            shapely.Point(7000, 6500).buffer(900),
            box(4950, 5000, 5000, 10_000),
        ]
    )
    return SurveyArea.from_geometry(
        LocalFrame(33, -119), box(0, 0, 10_000, 10_000), land=land, standoff_m=80.0
    )


def asked(bay, **changes):
    side_m = float(np.sqrt(bay.area_m2))
    request = PlanRequest(
        MODEL, np.array([600.0, 3000.0]), 20, (12, 12), "test", budget_m=4 * side_m, iterations=24
    )
    return replace(request, **changes)


def clear_of_land(bay, made):
    corners = np.vstack([made.start_m, made.route_m])
    return shapely.LineString(corners).distance(bay.obstacles) >= bay.standoff_m - 0.01


@pytest.mark.parametrize("sides", [1.0, 3.0, 8.0])
def test_a_route_keeps_to_the_water_and_spends_its_budget(bay, sides):
    budget_m = sides * float(np.sqrt(bay.area_m2))
    made = plan(asked(bay, budget_m=budget_m), bay)
    assert clear_of_land(bay, made)
    assert 0.9 * budget_m <= made.length_m <= budget_m


def test_a_route_with_a_home_ends_there_in_time(bay):
    home_m = np.array([9000.0, 1000.0])
    made = plan(asked(bay, home_m=home_m), bay)
    np.testing.assert_allclose(made.route_m[-1], home_m)
    assert made.home_corners == 1
    assert made.length_m <= asked(bay).budget_m
    assert clear_of_land(bay, made)


def test_harbours_in_the_stand_off_are_left_and_made_for(bay):
    # The island's north shore and the headland: 30 m off the land, where the vessel is not sent.
    start_m, home_m = np.array([7000.0, 7430.0]), np.array([3000.0, 2230.0])
    made = plan(asked(bay, start_m=start_m, home_m=home_m), bay)
    assert bay.approach_is_clear(start_m, made.route_m[0])
    assert bay.legs_are_clear(made.route_m[:-2], made.route_m[1:-1]).all()
    assert bay.approach_is_clear(made.route_m[-1], made.route_m[-2])
    np.testing.assert_allclose(made.route_m[-1], home_m)
    assert made.length_m <= asked(bay).budget_m


def test_a_budget_that_does_not_lead_home_is_refused(bay):
    with pytest.raises(PlanningError, match="the way home is 8635 m long"):
        plan(asked(bay, home_m=np.array([9000.0, 1000.0]), budget_m=8000.0), bay)


@pytest.mark.parametrize("budget_m", [5.0, 100.0, 400.0, 1500.0])
def test_a_small_budget_allows_a_short_route(bay, budget_m):
    """Less than the way to the first cell, hardly more, and a leg or two: each of it is sailed."""
    away = plan(asked(bay, budget_m=budget_m), bay)
    assert 0.5 * min(budget_m, 140.0) <= away.length_m <= budget_m
    home_m = np.array([600.0, 3000.0])
    around = plan(asked(bay, budget_m=budget_m, home_m=home_m), bay)
    assert 0.5 * min(budget_m, 140.0) <= around.length_m <= budget_m
    np.testing.assert_allclose(around.route_m[-1], home_m)
    assert around.home_corners >= 1
    assert np.isfinite(around.objective_after)


def test_a_round_from_a_cell_back_to_it_is_searched(bay):
    """With the start and home in one cell the first draft of a short round is that cell alone."""
    cell_m = water_lattice_of(bay).points_m[100]
    made = plan(asked(bay, start_m=cell_m, home_m=cell_m, budget_m=1600.0, iterations=60), bay)
    assert 1000.0 <= made.length_m <= 1600.0
    assert clear_of_land(bay, made)


def test_a_budget_that_is_spent_is_refused(bay):
    with pytest.raises(PlanningError, match="too short to get anywhere"):
        plan(asked(bay, budget_m=0.0), bay)
    with pytest.raises(PlanningError, match="beside the way home"):
        plan(asked(bay, budget_m=0.0, home_m=np.array([600.0, 3000.0])), bay)


def test_it_has_no_spots_whose_information_could_be_known(bay):
    made = plan(asked(bay), bay)
    assert not made.is_spot.any()
    assert np.isnan(made.mutual_information)


def test_a_search_never_makes_a_remainder_worse(bay):
    first = plan(asked(bay), bay)
    again = plan(asked(bay, remainder_m=first.route_m, seed=1), bay)
    assert again.objective_after <= again.objective_before
    assert again.objective_before == pytest.approx(first.objective_after, rel=0.05)


def test_without_a_budget_it_plans_some_way_ahead(bay):
    made = plan(asked(bay, budget_m=None), bay)
    assert path_length_m(made.route_m) > 3 * float(np.sqrt(bay.area_m2))


def test_what_was_measured_is_left_alone(bay):
    # All readings in the west: of a short route nearly all readings are elsewhere.
    axis = np.arange(200.0, 10_000.0, 400.0)
    points = np.stack(np.meshgrid(axis[axis < 4500.0], axis), axis=-1).reshape(-1, 2)
    cells = HistoryCells(points, np.zeros(len(points)), np.full(len(points), 3.0), np.zeros(len(points)))
    start_m = np.array([4600.0, 4000.0])
    made = plan(asked(bay, measured=cells, start_m=start_m, budget_m=20_000.0), bay)
    assert np.mean(made.route_m[:, 0] > 4500.0) > 0.9


def test_equal_requests_get_equal_plans_wherever_they_are_made(bay):
    request = asked(bay, seed=3)
    made = plan(request, bay)
    elsewhere = pickle.loads(pickle.dumps(bay))  # a worker's copy, with nothing cached
    passage_of.cache_clear()
    again = plan(pickle.loads(pickle.dumps(request)), elsewhere)
    assert made.route_m.tobytes() == again.route_m.tobytes()
    assert made.objective_after == again.objective_after
