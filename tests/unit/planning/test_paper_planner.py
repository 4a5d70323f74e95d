"""The paper's planner, from a belief to a route."""

import pickle

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from autonomy.geometry import LocalFrame
from autonomy.learning import FieldModel, Hyperparameters, SparseOnlineGP
from autonomy.planning.information import measurement_covariance, mutual_information
from autonomy.planning.passage import Passage
from autonomy.planning.planners import PLANNERS, PlanningError, PlanRequest, paper
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)
HYPERPARAMETERS = Hyperparameters(signal_variance=1.0, noise_variance=0.05, lengthscales_m=(2000.0, 2000.0))
WALL = box(4800, 0, 5200, 9500)


def survey(land=None, **given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, 10_000, 10_000), land=land, **given)


def request(start=(1000.0, 1000.0), spots=8, lattice=(8, 8), model=None):
    model = FieldModel.prior(HYPERPARAMETERS) if model is None else model
    return PlanRequest(model, np.array(start), spots, lattice, "a test")


def test_a_plan_visits_as_many_spots_as_asked_for_and_nothing_crosses_land():
    area = survey(WALL, standoff_m=100.0)
    plan = PLANNERS["paper"](request(), area)
    route = shapely.LineString([plan.start_m, *plan.route_m])
    assert route.distance(WALL) >= 99.9
    assert plan.spots_m.shape == (8, 2)
    assert plan.is_spot[-1]
    assert not plan.is_spot.all()
    sites = {tuple(site) for site in area.candidate_sites(8, 8)}
    assert {tuple(spot) for spot in plan.spots_m} <= sites
    assert len({tuple(spot) for spot in plan.spots_m}) == 8
    assert (plan.planner, plan.reason, plan.start_m.tolist()) == ("paper", "a test", [1000.0, 1000.0])


def test_the_information_reported_is_the_true_one_over_the_reachable_sites():
    area = survey(WALL)
    plan = paper.plan(request(), area)
    sites = area.candidate_sites(8, 8)
    S = measurement_covariance(FieldModel.prior(HYPERPARAMETERS), sites)
    chosen = [int(np.flatnonzero((sites == spot).all(axis=1))[0]) for spot in plan.spots_m]
    assert plan.mutual_information == pytest.approx(mutual_information(S, chosen), abs=1e-9)


def test_the_noise_is_in_the_covariance_once():
    sites = survey().candidate_sites(3, 3)
    S = measurement_covariance(FieldModel.prior(HYPERPARAMETERS), sites)
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    expected = np.exp(-0.5 * squared / 2000.0**2) + 0.05 * np.eye(9)
    assert np.allclose(S, expected, rtol=0, atol=1e-7)


def test_spots_go_where_nothing_has_been_learnt():
    gp = SparseOnlineGP(HYPERPARAMETERS, capacity=100)
    for x in range(500, 5000, 500):
        for y in range(500, 10_000, 500):
            gp.update(np.array([x, y], dtype=float), 1.0)
    plan = paper.plan(request(model=gp.model()), survey())
    assert np.all(plan.spots_m[:, 0] > 5000)


def test_only_the_vessels_own_basin_is_planned_for():
    area = survey(box(4800, 0, 5200, 10_000))
    west, east = paper.plan(request((500, 500)), area), paper.plan(request((9500, 500)), area)
    assert np.all(west.spots_m[:, 0] < 4800)
    assert np.all(east.spots_m[:, 0] > 5200)


def test_no_more_spots_than_all_but_one():
    area = survey()
    assert len(paper.plan(request(spots=50, lattice=(3, 3)), area).spots_m) == 8
    lonely = survey(box(0, 0, 10_000, 9_000) | box(1_500, 9_000, 10_000, 10_000))
    plan = paper.plan(request((200, 9_200), lattice=(10, 10)), lonely)
    assert plan.spots_m.tolist() == [[500, 9500]]
    assert plan.mutual_information == 0.0


def test_the_same_request_gives_the_same_plan_in_another_process():
    area = survey(WALL)
    first = paper.plan(request(spots=20, lattice=(12, 12)), area)
    problem, again = pickle.loads(pickle.dumps((request(spots=20, lattice=(12, 12)), area)))
    assert np.array_equal(paper.plan(problem, again).route_m, first.route_m)


def test_with_sites_that_know_nothing_of_each_other_the_lowest_are_taken():
    """The paper's lengths of a map cell on its lattice of thirty: all increments are equal."""
    model = FieldModel.prior(Hyperparameters(np.exp(2.0), np.exp(-2.0), (28.0, 28.0)))
    area = survey()
    plan = paper.plan(request(spots=20, lattice=(12, 12), model=model), area)
    lowest = {tuple(site) for site in area.candidate_sites(12, 12)[:20]}
    assert {tuple(spot) for spot in plan.spots_m} == lowest
    assert plan.mutual_information == pytest.approx(0.0, abs=1e-9)


def test_nothing_reachable_is_a_planning_error():
    with pytest.raises(PlanningError, match="none of the 64 candidate sites"):
        paper.plan(request((1e6, 1e6)), survey(box(10_001, 10_001, 20_000, 20_000)))


def test_an_unusable_model_is_a_planning_error():
    model = FieldModel.prior(Hyperparameters(1.0, 1e-30, (1e9, 1e9)))
    with pytest.raises(PlanningError, match="positive definite"):
        paper.plan(request(model=model), survey())


def test_a_leg_over_land_is_caught_whatever_the_raster_says(monkeypatch):
    class Careless(Passage):
        def ways(self, points_m):
            return Passage(survey()).ways(points_m)

    monkeypatch.setattr(paper, "passage_of", Careless)
    with pytest.raises(PlanningError, match=r"leg \d+ of the route"):
        paper.plan(request(), survey(WALL))
