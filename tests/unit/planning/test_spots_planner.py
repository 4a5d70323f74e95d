"""The planner of exchange-refined spots, warm-started, within a budget."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from shapely.geometry import box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.learning import FieldModel, Hyperparameters, SparseOnlineGP
from autonomy.planning.assembly import verify
from autonomy.planning.errors import PlanningError
from autonomy.planning.information import measurement_covariance, mutual_information
from autonomy.planning.passage import passage_of
from autonomy.planning.planners import paper, spots
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)
HYPERPARAMETERS = Hyperparameters(1.0, 0.05, (2000.0, 2000.0))
WALL = box(4800, 0, 5200, 9500)
NO_REMAINDER = {"remainder_m": np.empty((0, 2)), "remainder_is_spot": np.empty(0, dtype=bool)}


def survey(land=None, **given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, 10_000, 10_000), land=land, **given)


def request(start=(1000.0, 1000.0), n=12, lattice=(9, 9), model=None, **given):
    model = FieldModel.prior(HYPERPARAMETERS) if model is None else model
    return PlanRequest(model, np.array(start), n, lattice, "a test", **given)


def sail(gp, track, rng):
    """Read every 250 m or so along a track (n, 2)."""
    for a, b in pairwise(track):
        for share in np.linspace(0.0, 1.0, max(2, int(np.hypot(*(b - a)) / 250.0)))[1:]:
            gp.update(a + share * (b - a), float(rng.standard_normal()))


def places(plan):
    return {tuple(spot) for spot in plan.spots_m}


def test_its_spots_tell_more_than_the_papers_and_the_figure_is_true():
    area = survey(WALL, standoff_m=100.0)
    ours, papers = spots.plan(request(), area), paper.plan(request(), area)
    assert len(places(ours)) == 12
    assert ours.mutual_information >= papers.mutual_information
    sites = area.candidate_sites(9, 9)
    chosen = [int(np.flatnonzero((sites == spot).all(axis=1))[0]) for spot in ours.spots_m]
    S = measurement_covariance(FieldModel.prior(HYPERPARAMETERS), sites)
    assert ours.mutual_information == pytest.approx(mutual_information(S, chosen), abs=1e-9)
    verify(ours.start_m, ours.route_m, area)


@pytest.mark.parametrize("seed", range(3))
def test_a_tour_is_sailed_to_its_end_however_often_it_is_planned_anew(seed):
    """A new one at every re-plan would leave the same far spots to its end again and again."""
    area, rng = survey(), np.random.default_rng(seed)
    gp = SparseOnlineGP(HYPERPARAMETERS, capacity=150)
    whole = plan = spots.plan(request(tuple(rng.uniform(500, 9500, 2)), model=gp.model(), seed=seed), area)
    came_to = set()
    while len(plan.route_m) > 3:
        sail(gp, np.concatenate([plan.start_m[None], plan.route_m[:3]]), rng)
        came_to |= {tuple(spot) for spot in plan.route_m[:3][plan.is_spot[:3]]}
        rest = {"remainder_m": plan.route_m[3:], "remainder_is_spot": plan.is_spot[3:]}
        asked = request(tuple(plan.route_m[2]), model=gp.model(), seed=seed + len(came_to), **rest)
        plan = spots.plan(asked, area)
        others = spots.plan(replace(asked, spots=len(places(plan)), **NO_REMAINDER), area)
        assert plan.mutual_information >= 0.9 * others.mutual_information
    assert came_to | places(plan) == places(whole)


def test_where_other_spots_tell_much_more_there_is_a_new_tour():
    """What was left has been read meanwhile, by a detour say."""
    area, gp = survey(), SparseOnlineGP(HYPERPARAMETERS, capacity=150)
    before = spots.plan(request(), area)
    left, marks = before.route_m[6:], before.is_spot[6:]
    sail(gp, np.concatenate([left, left[::-1]]), np.random.default_rng(0))
    later = request(tuple(left[0]), model=gp.model(), remainder_m=left, remainder_is_spot=marks)
    made = spots.plan(later, area)
    assert len(places(made)) == 12
    assert not places(made) & {tuple(spot) for spot in left[marks]}


@pytest.mark.parametrize("marked", [0, 13])
def test_a_remainder_that_is_no_tour_of_spots_is_not_gone_on_with(marked):
    """Of no spots, or of more than are asked for: another planner's."""
    area = survey()
    sites = area.candidate_sites(9, 9)[:13]
    asked = request(remainder_m=sites, remainder_is_spot=np.arange(13) < marked)
    assert len(places(spots.plan(asked, area))) == 12


def test_the_same_belief_and_the_whole_remainder_give_the_same_spots():
    area = survey()
    before = spots.plan(request(), area)
    again = spots.plan(request(remainder_m=before.route_m, remainder_is_spot=before.is_spot, seed=9), area)
    assert places(again) == places(before)


@pytest.mark.parametrize("budget", [6_000.0, 15_000.0, 30_000.0])
def test_a_budget_is_kept_and_used(budget):
    area = survey(WALL, standoff_m=100.0)
    made = spots.plan(request(budget_m=budget), area)
    assert made.length_m <= budget
    home = np.array([1000.0, 1000.0])
    bound = spots.plan(request(budget_m=budget, home_m=home), area)
    assert bound.length_m + path_length_m(passage_of(area).path(bound.route_m[-1], home)) <= budget
    assert 1 <= len(bound.spots_m) <= len(made.spots_m)
    whole = spots.plan(request(), area)
    assert len(made.spots_m) < 12 or whole.length_m <= budget


def test_more_budget_tells_more():
    area = survey()
    told = [
        spots.plan(request(budget_m=budget), area).mutual_information for budget in (5e3, 1e4, 2e4, 4e4, 8e4)
    ]
    assert told == sorted(told)
    assert told[-1] == spots.plan(request(), area).mutual_information


def test_a_budget_for_no_spot_is_spent_on_the_way_to_one():
    asked, area = request((0.0, 0.0), budget_m=300.0), survey()
    made = spots.plan(asked, area)
    assert made.length_m == pytest.approx(300.0, rel=0.01)
    sites = area.candidate_sites(9, 9)
    S = measurement_covariance(asked.model, np.concatenate([made.spots_m, sites]))
    assert made.mutual_information == pytest.approx(mutual_information(S, [0]))
    with pytest.raises(PlanningError, match="the way home is"):
        spots.plan(request(budget_m=300.0, home_m=np.array([9000.0, 9000.0])), survey())


def test_an_unusable_model_is_a_planning_error():
    model = FieldModel.prior(Hyperparameters(1.0, 1e-30, (1e9, 1e9)))
    with pytest.raises(PlanningError, match="positive definite"):
        spots.plan(request(model=model), survey())


def test_a_spot_that_the_vessel_lies_at_is_not_all_that_is_left_of_a_tour():
    """It costs nothing, so that it would never be dropped, and the vessel would be sent nowhere for ever."""
    area = survey()
    whole = spots.plan(request(), area)
    here = whole.spots_m[0]
    made = spots.plan(request(start=here, budget_m=900.0), area)
    assert made.length_m == pytest.approx(900.0, rel=1e-3)
    assert made.mutual_information > 0.0
