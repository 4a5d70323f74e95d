"""The slow, pure functions that the worker process runs: job name -> function."""

from dataclasses import dataclass, replace
from typing import Any

from autonomy.learning.rebuild import Reestimate, ReestimateRequest, reestimate
from autonomy.planning.plan import Plan
from autonomy.planning.planners import PlanningError, PlanRequest, make_plan
from autonomy.planning.restrictions import UNRESTRICTED, Restrictions, restricted
from autonomy.planning.survey import SurveyArea, SurveyError

EXPLORE = "explore"


@dataclass(frozen=True)
class ExploreRequest:
    """One pass of Algorithm 1's slow part.

    Attributes:
        reestimate: what the re-estimate needs, or None to plan with the model in `plan`.
        planner: name of the planner.
        plan: the planning problem; its model is replaced by the re-estimated one, if there is one. None: re-estimate
            only.
        restrictions: what narrows the survey's water for the plan.
    """

    reestimate: ReestimateRequest | None
    planner: str
    plan: PlanRequest | None
    restrictions: Restrictions = UNRESTRICTED


@dataclass(frozen=True)
class ExploreResult:
    """The re-estimated model, if one was asked for, and the plan, or why there is none."""

    reestimate: Reestimate | None
    plan: Plan | None
    problem: str | None


def explore(request: ExploreRequest, survey: SurveyArea) -> ExploreResult:
    """Re-estimate, rebuild the model, plan. A failed plan does not cost the re-estimate."""
    estimate = reestimate(request.reestimate) if request.reestimate is not None else None
    problem = request.plan
    if problem is None:
        return ExploreResult(estimate, None, None)
    if estimate is not None:
        problem = replace(problem, model=estimate.gp.model())
    try:
        water = restricted(survey, request.restrictions)
        return ExploreResult(estimate, make_plan(request.planner, problem, water), None)
    except (PlanningError, SurveyError) as error:
        return ExploreResult(estimate, None, str(error))
    except Exception as error:  # noqa: BLE001 -- a planner's bug is told like any failed plan: the estimate is kept
        return ExploreResult(estimate, None, f"the planner is broken: {type(error).__name__}: {error}")


_JOBS = {EXPLORE: explore}


def run(name: str, request: Any, survey: SurveyArea) -> Any:
    """Run the job called `name`.

    Raises:
        KeyError: there is no such job.
    """
    return _JOBS[name](request, survey)
