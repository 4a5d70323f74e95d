"""Which planner the name `auto` stands for."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from autonomy import jobs
from autonomy.geometry import LocalFrame
from autonomy.learning import Hyperparameters
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck
from autonomy.planning.planners import AUTO, PLANNERS, PlanningError, PlanRequest, make_plan
from autonomy.planning.survey import SurveyArea

SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0.0, 0.0, 3000.0, 3000.0))
STILL = Hyperparameters(1.0, 0.01, (600.0, 600.0)).kernel
MOVING = Kernel((Component(1.0, SquaredExponential((600.0, 600.0)), OrnsteinUhlenbeck(20_000.0)),), 0.01)


def request_for(kernel, **values):
    start_m = np.array([100.0, 100.0])
    request = PlanRequest(FieldModel.prior(kernel), start_m, 5, (6, 6), "first plan", iterations=4)
    return replace(request, **values)


@pytest.mark.parametrize(
    ("kernel", "budget_m", "planner"),
    [
        (STILL, None, "spots"),
        (MOVING, None, "patrol"),
        (STILL, 12_000.0, "route"),
        (MOVING, 12_000.0, "route"),
    ],
)
def test_auto_asks_whether_there_is_an_end_and_whether_the_field_moves(kernel, budget_m, planner):
    request = PlanRequest(
        FieldModel.prior(kernel), np.array([100.0, 100.0]), 5, (6, 6), "first plan", iterations=4
    )
    plan = make_plan(AUTO, replace(request, budget_m=budget_m), SURVEY)
    assert plan.planner == planner
    assert SURVEY.legs_are_clear([plan.start_m, *plan.route_m[:-1]], plan.route_m).all()


@pytest.mark.parametrize("planner", PLANNERS)
@pytest.mark.parametrize("budget_m", [None, 5000.0])
def test_water_narrower_than_the_raster_is_planned_or_refused(planner, budget_m):
    ditch = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0.0, 0.0, 15_000.0, 55.0))
    request = request_for(STILL, start_m=np.array([100.0, 20.0]), budget_m=budget_m)
    try:
        plan = make_plan(planner, request, ditch)
    except PlanningError:
        return
    assert ditch.legs_are_clear([plan.start_m, *plan.route_m[:-1]], plan.route_m).all()


def test_a_route_looks_forty_sides_ahead_at_most():
    """Its cost grows with the square of its length."""
    plan = make_plan("route", request_for(STILL, budget_m=1e7), SURVEY)
    assert plan.length_m <= 40.0 * 3000.0


def test_a_broken_planner_does_not_cost_the_reestimate(monkeypatch):
    def broken(request, survey):
        raise ZeroDivisionError("nothing to divide by")

    monkeypatch.setitem(PLANNERS, "paper", broken)
    result = jobs.explore(jobs.ExploreRequest(None, "paper", request_for(STILL)), SURVEY)
    assert result.plan is None
    assert result.problem == "the planner is broken: ZeroDivisionError: nothing to divide by"


def test_a_start_at_the_other_end_of_the_world_is_a_mistake():
    with pytest.raises(PlanningError, match=r"the start is 1\d\d\d km from a survey area 3.0 km wide"):
        make_plan("paper", request_for(STILL, start_m=np.array([-1e6, 1e6])), SURVEY)
