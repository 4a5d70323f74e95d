"""The paper's planner: spots of high mutual information by dynamic programming, then a short tour of them."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray
from autonomy.planning.errors import PlanningError
from autonomy.planning.information import measurement_covariance
from autonomy.planning.passage import Passage, Ways, passage_of
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
    start = np.asarray(request.start_m, dtype=float).reshape(2)
    passage = passage_of(survey)
    sites, unreachable = _reachable_sites(request, start, survey, passage)
    chosen = _select(request, sites)
    ways = passage.ways(np.concatenate([start[None], sites[list(chosen)]]))
    try:
        order = open_tour(ways.distances_m, 0, seed=request.seed)
    except ValueError as error:
        raise PlanningError(f"no tour through the sampling spots: {error}") from error
    route, is_spot = _route(ways, order)
    _verify(start, route, survey)
    return Plan(start, route, is_spot, chosen.mutual_information, NAME, request.reason, unreachable)


def _reachable_sites(
    request: PlanRequest, start: FloatArray, survey: SurveyArea, passage: Passage
) -> tuple[FloatArray, int]:
    """The sites that can be reached, shape (n, 2), and how many cannot."""
    nx, ny = request.lattice
    sites = survey.candidate_sites(nx, ny)
    reachable: FloatArray = sites[passage.reachable(start, sites)]
    if not len(reachable):
        lat_deg, lon_deg = survey.frame.to_geodetic(start)
        raise PlanningError(
            f"none of the {len(sites)} candidate sites of the {nx} × {ny} lattice can be reached over "
            f"navigable water from {lat_deg:.5f}, {lon_deg:.5f}; the vessel may be on land, outside the area "
            f"or in water that is cut off, or {survey.passage_cells} passage cells too coarse for channels"
        )
    return reachable, len(sites) - len(reachable)


def _select(request: PlanRequest, sites: FloatArray) -> Selection:
    n = max(1, min(request.spots, len(sites) - 1))
    try:
        return select_by_dynamic_programming(measurement_covariance(request.model, sites), n)
    except ValueError as error:
        raise PlanningError(f"the model's covariance cannot be planned with: {error}") from error


def _route(ways: Ways, order: tuple[int, ...]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The corners of all ways in order, and which of them are spots."""
    corners, marks = [], []
    for a, b in pairwise(order):
        leg = ways.path(a, b)[1:]
        corners.append(leg)
        marks.append(np.arange(len(leg)) == len(leg) - 1)
    return np.concatenate(corners), np.concatenate(marks)


def _verify(start: FloatArray, route: FloatArray, survey: SurveyArea) -> None:
    """Check every leg against the polygons themselves, which the raster knows nothing of.

    Raises:
        PlanningError: a leg is not clear.
    """
    corners = np.concatenate([start[None], route])
    clear = survey.legs_are_clear(corners[:-1], corners[1:])
    if not survey.is_navigable(start)[0]:
        clear[0] = survey.approach_is_clear(corners[0], corners[1])
    for k in np.flatnonzero(~clear):
        a, b = survey.frame.to_geodetic(corners[k : k + 2])
        raise PlanningError(
            f"leg {k} of the route, from {a[0]:.6f}, {a[1]:.6f} to {b[0]:.6f}, {b[1]:.6f}, "
            "is not over navigable water"
        )
