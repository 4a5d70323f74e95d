"""The paper's planner: spots of high mutual information by dynamic programming, then a short tour of them."""

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.planning.assembly import assemble, reachable_sites, start_of, verify
from autonomy.planning.errors import PlanningError
from autonomy.planning.information import measurement_covariance
from autonomy.planning.passage import passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.selection import Selection, select_by_dynamic_programming
from autonomy.planning.survey import SurveyArea
from autonomy.planning.tour import open_tour

NAME = "paper"


def plan(request: PlanRequest, survey: SurveyArea) -> Plan:
    """Spots by the paper's dynamic programme, visited on a short open tour over water (section III-C).

    Only sites that the vessel can reach from its start are candidates: land and cut-off water left among them
    would distort mutual information. At most all but one are taken, for a complete set has none.

    Raises:
        PlanningError: no candidate can be reached, the model's covariance is unusable, or a leg of the
            finished route is not over navigable water.
    """
    start = start_of(request)
    passage = passage_of(survey)
    sites, unreachable = reachable_sites(request, survey, passage)
    chosen = _select(request, sites)
    ways = passage.ways(np.concatenate([start[None], sites[list(chosen)]]))
    try:
        order = open_tour(ways.distances_m, 0, seed=request.seed)
    except ValueError as error:
        raise PlanningError(f"no tour through the sampling spots: {error}") from error
    route, is_spot = assemble(ways, order)
    verify(start, route, survey)
    return Plan(start, route, is_spot, chosen.mutual_information, NAME, request.reason, unreachable)


def _select(request: PlanRequest, sites: FloatArray) -> Selection:
    n = max(1, min(request.spots, len(sites) - 1))
    try:
        return select_by_dynamic_programming(measurement_covariance(request.model, sites), n)
    except ValueError as error:
        raise PlanningError(f"the model's covariance cannot be planned with: {error}") from error
