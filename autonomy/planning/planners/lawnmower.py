"""Back and forth over all the water: what a survey team would sail, and what every other planner has to beat."""

from autonomy.planning.assembly import affordable, information_of_spots, reachable_sites, start_of, verify
from autonomy.planning.passage import passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.spacing import lane_spacing_m
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import Sweep, lawnmowers, sweeps

NAME = "lawnmower"


def plan(request: PlanRequest, survey: SurveyArea) -> Plan:
    """One cover of the water by parallel lanes, begun at the nearest corner; its spots are the ends of lanes.

    Lanes are as dense as the budget allows; without a budget, as the learned length-scale asks for. They run along that
    side of the area along which they come to lie closest. A budget too small for one lane is spent on part of one.

    Raises:
        PlanningError: no water can be reached, the way home is longer than the budget, or a leg of the finished route
            is not over navigable water.
    """
    start, passage = start_of(request), passage_of(survey)
    sites, unreachable = reachable_sites(request, survey, passage)
    sweep = _chosen(request, survey)
    route, is_spot = affordable(request, sweep.route_m, sweep.is_lane_end, passage)
    verify(start, route, survey, request.home_m)
    information = information_of_spots(request, route[is_spot], sites)
    return Plan(start, route, is_spot, information, NAME, request.reason, unreachable)


def _chosen(request: PlanRequest, survey: SurveyArea) -> Sweep:
    start = start_of(request)
    candidates = []
    if request.budget_m is not None:
        candidates = lawnmowers(survey, start, request.budget_m, home_m=request.home_m, nearest_corner=True)
    if not candidates:
        spacing = lane_spacing_m(request.model.kernel) if request.budget_m is None else survey.span_m
        candidates = sweeps(survey, start, spacing, nearest_corner=True)
    return min(candidates, key=lambda sweep: (sweep.spacing_m, sweep.length_m))
