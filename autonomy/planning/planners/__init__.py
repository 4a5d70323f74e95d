"""Planners by name. Each is a pure, slow function of the request and the survey: it runs in the worker."""

from collections.abc import Callable
from dataclasses import replace

from autonomy.planning.errors import PlanningError
from autonomy.planning.expectation import expected_rmse
from autonomy.planning.plan import Plan
from autonomy.planning.planners import paper
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea

__all__ = ["PLANNERS", "PlanRequest", "PlanningError", "make_plan"]

PLANNERS: dict[str, Callable[[PlanRequest, SurveyArea], Plan]] = {paper.NAME: paper.plan}
