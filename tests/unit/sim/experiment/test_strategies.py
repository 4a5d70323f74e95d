"""Ways to choose where to sample: within the budget, over water, home in time, and each what it says it is."""

import numpy as np
import pytest
import shapely

from autonomy.geometry import FloatArray, LocalFrame, path_length_m
from autonomy.planning.errors import PlanningError
from autonomy.planning.selection import select_greedily
from autonomy.planning.survey import SurveyArea
from sim.experiment.compare_maps import Read
from sim.experiment.strategies import (
    GreedyEntropy,
    GreedyInformation,
    Lawnmower,
    RandomWaypoints,
    Strategy,
    Underway,
)

SIDE_M = 10_000.0
ISLAND = shapely.box(4000.0, 3000.0, 6500.0, 6000.0)
WATER = SurveyArea.from_geometry(
    LocalFrame(33.0, -119.0), shapely.box(0.0, 0.0, SIDE_M, 0.8 * SIDE_M), land=ISLAND, passage_cells=80
)
HOME_M = np.array([300.0, 400.0])
BUDGET_M = 45_000.0


def field(points_m: FloatArray) -> FloatArray:
    return np.asarray(np.sin(points_m[:, 0] / 2000.0) + np.cos(points_m[:, 1] / 1500.0))


def underway(track_m: FloatArray, budget_m: float = BUDGET_M, home_m: FloatArray | None = HOME_M) -> Underway:
    """Where a voyage stands after a track (k, 2) on which every 200 m were read."""
    steps = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track_m, axis=0).T))])
    along = np.arange(200.0, steps[-1], 200.0)
    places = np.column_stack([np.interp(along, steps, track_m[:, axis]) for axis in (0, 1)])
    read = Read(places, field(places), along, np.ones(len(along)))
    left_m = budget_m - float(steps[-1])
    return Underway(WATER, track_m[-1], home_m, left_m, float(steps[-1]), read, False, 0)


def sailed(strategy: Strategy, budget_m: float = BUDGET_M, home_m: FloatArray | None = HOME_M) -> FloatArray:
    """The whole track, corners (k, 2); without a home until the budget is spent."""
    track = HOME_M[None]
    while path_length_m(track) < budget_m - 1.0:
        corners = strategy.stretch(underway(track, budget_m, home_m))
        if not len(corners):
            break
        track = np.concatenate([track, corners])
    return track


STRATEGIES = {
    "along": lambda: Lawnmower(0),
    "across": lambda: Lawnmower(1),
    "random": lambda: RandomWaypoints(0),
    "entropy": GreedyEntropy,
    "information": GreedyInformation,
}


@pytest.mark.parametrize("name", STRATEGIES)
def test_a_voyage_uses_its_budget_and_comes_home_over_water(name: str) -> None:
    track = sailed(STRATEGIES[name]())
    assert path_length_m(track) <= BUDGET_M + 1e-6
    # None gives much away: lawnmowers fit whole lanes, the others another leg.
    assert path_length_m(track) >= 0.9 * BUDGET_M
    assert np.hypot(*(track[-1] - HOME_M)) <= 0.01 * np.sqrt(WATER.area_m2)
    assert WATER.legs_are_clear(track[:-1], track[1:]).all()
    # Over all the water, not in a corner of it.
    assert np.ptp(track, axis=0) == pytest.approx([SIDE_M, 0.8 * SIDE_M], rel=0.25)


def test_a_lawnmower_over_a_moving_sea_goes_to_and_fro() -> None:
    strategy = Lawnmower(0, cover_sides=4.0)
    first = strategy.stretch(underway(HOME_M[None], home_m=None))
    back = strategy.stretch(underway(np.vstack([HOME_M, first]), home_m=None))
    assert path_length_m(np.vstack([HOME_M, first])) <= 4.0 * np.sqrt(WATER.area_m2)
    assert back == pytest.approx(first[-2::-1])
    again = strategy.stretch(underway(np.vstack([HOME_M, first, back]), home_m=None))
    assert again == pytest.approx(first[1:])


def test_a_budget_without_room_for_a_lane_is_refused() -> None:
    with pytest.raises(PlanningError, match="too short for a single lane"):
        Lawnmower(0).stretch(underway(HOME_M[None], budget_m=500.0))


def test_random_waypoints_are_the_same_for_the_same_seed_only() -> None:
    here = underway(HOME_M[None])
    first = RandomWaypoints(3).stretch(here)
    assert RandomWaypoints(3).stretch(here) == pytest.approx(first)
    assert RandomWaypoints(4).stretch(here)[-1] != pytest.approx(first[-1])


def test_greedy_entropy_goes_where_a_reading_is_the_least_certain() -> None:
    here = underway(np.array([HOME_M, [9500.0, 400.0], [9500.0, 2000.0]]))
    goal = GreedyEntropy().stretch(here)[-1]
    sites, _ = here.affordable(here.sites())
    variance = here.map().predict(sites, here.time_s).variance
    chosen = int(np.argmin(np.hypot(*(sites - goal).T)))
    assert variance[chosen] >= variance.max() - 2e-3 * here.map().kernel.signal_variance


def test_greedy_information_tours_the_spots_that_greedy_selection_takes() -> None:
    here = underway(np.array([HOME_M, [9500.0, 400.0]]), budget_m=2.0 * BUDGET_M)
    corners = GreedyInformation().stretch(here)
    sites, _ = here.affordable(here.sites())
    S = here.map().covariance(sites, here.time_s)
    spots = sites[list(select_greedily(S, 20))]
    away = np.hypot(*(corners[:, None] - spots[None]).transpose(2, 0, 1)).min(axis=0)
    assert away.max() < 1e-6


def test_with_little_left_everybody_goes_home() -> None:
    far = np.array([HOME_M, [9500.0, 7500.0]])
    budget_m = path_length_m(far) + 12_500.0
    for strategy in (RandomWaypoints(0), GreedyEntropy(), GreedyInformation()):
        track = far
        while len(corners := strategy.stretch(underway(track, budget_m))):
            track = np.concatenate([track, corners])
        assert np.hypot(*(track[-1] - HOME_M)) <= 0.01 * np.sqrt(WATER.area_m2)
        assert path_length_m(track) <= budget_m
