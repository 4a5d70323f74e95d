"""Planners by name. Each is a pure, slow function of the request and the survey: it runs in the worker."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely

from autonomy.planning.errors import PlanningError
from autonomy.planning.expectation import along_route
from autonomy.planning.plan import Plan
from autonomy.planning.planners import lawnmower, paper, patrol, route, spots
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import ROUND_OFF_M, SurveyArea

__all__ = ["AUTO", "PLANNERS", "PlanRequest", "PlanningError", "make_plan"]

PLANNERS: dict[str, Callable[[PlanRequest, SurveyArea], Plan]] = {
    planner.NAME: planner.plan for planner in (paper, spots, route, patrol, lawnmower)
}

_FARTHEST_SPANS, _FARTHEST_M = 3.0, 20e3
"""Of the area's span and in metres: flat metres do not reach much farther, and no harbour is farther away."""

AUTO = "auto"
"""The name that leaves the choice to what is asked."""


def make_plan(name: str, request: PlanRequest, survey: SurveyArea) -> Plan:
    """The plan of the planner called `name`, and with it what it came from and promises: see `Plan`.

    `AUTO` is a whole route within a budget. Where no end is set it is rounds for ever if the field moves, and spots if
    it does not: a route would leave water that it has not come to yet unknown for as long as it likes.

    Raises:
        KeyError: there is no such planner.
        PlanningError: it finds no plan.
    """
    if name == AUTO:
        name = _chosen_for(request)
    away_m = shapely.distance(survey.ground, shapely.points(request.start_m))
    if away_m > _FARTHEST_SPANS * survey.span_m + _FARTHEST_M:
        raise PlanningError(
            f"the start is {away_m / 1e3:.0f} km from a survey area {survey.span_m / 1e3:.1f} km wide: "
            "is one of them wrong, perhaps latitude and longitude exchanged?"
        )
    plan = PLANNERS[name](request, survey)
    rmse = None if request.model_version is None else along_route(plan, request, survey).rmse
    return replace(
        plan,
        seed=request.seed,
        model_version=request.model_version,
        expected_rmse=rmse,
        home_corners=max(plan.home_corners, int(_ends_home(plan, request))),
    )


def _chosen_for(request: PlanRequest) -> str:
    if request.budget_m is not None:
        return route.NAME
    return spots.NAME if request.model.kernel.is_static else patrol.NAME


def _ends_home(plan: Plan, request: PlanRequest) -> bool:
    if request.home_m is None or not len(plan.route_m):
        return False
    return bool(np.allclose(plan.route_m[-1], request.home_m, rtol=0.0, atol=ROUND_OFF_M))
