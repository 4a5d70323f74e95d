"""Planners by name. Each is a pure, slow function of the request and the survey: it runs in the worker."""

from collections.abc import Callable
from dataclasses import replace

from autonomy.planning.errors import PlanningError
from autonomy.planning.expectation import along_route
from autonomy.planning.plan import Plan
from autonomy.planning.planners import lawnmower, paper, patrol, route, spots
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea

__all__ = ["PLANNERS", "PlanRequest", "PlanningError", "make_plan"]

PLANNERS: dict[str, Callable[[PlanRequest, SurveyArea], Plan]] = {
    planner.NAME: planner.plan for planner in (paper, spots, route, patrol, lawnmower)
}


def make_plan(name: str, request: PlanRequest, survey: SurveyArea) -> Plan:
    """The plan of the planner called `name`, and with it what it came from and promises: see `Plan`.

    Raises:
        KeyError: there is no such planner.
        PlanningError: it finds no plan.
    """
    plan = PLANNERS[name](request, survey)
    rmse = None if request.model_version is None else along_route(plan, request, survey).rmse
    return replace(plan, seed=request.seed, model_version=request.model_version, expected_rmse=rmse)
