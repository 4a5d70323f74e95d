"""What planners share: sites that can be reached, a route put together from ways over water, its last check."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray, advance_along, path_length_m
from autonomy.planning.errors import PlanningError
from autonomy.planning.information import measurement_covariance, mutual_information
from autonomy.planning.passage import Passage, Ways
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import ROUND_OFF_M, SurveyArea

_CUTS = 12
"""Bisections for where to cut a route."""

_ROUND_OFF_M = 1e-3


def start_of(request: PlanRequest) -> FloatArray:
    """Where the plan begins, shape (2,), float64."""
    return np.asarray(request.start_m, dtype=float).reshape(2)


def reachable_sites(request: PlanRequest, survey: SurveyArea, passage: Passage) -> tuple[FloatArray, int]:
    """The candidate sites of the request's lattice that the vessel can reach, shape (n, 2), and how many it cannot.

    Raises:
        PlanningError: none can be reached.
    """
    start = start_of(request)
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


def assemble(ways: Ways, order: Sequence[int]) -> tuple[FloatArray, NDArray[np.bool_]]:
    """A route along the ways between points, in order: corners (k, 2), the first point excluded, and which are points.

    The corners between two points only round the land; they are marked False in the second array, shape (k,).

    Raises:
        Unreachable: there is no way between two points that follow each other.
    """
    corners, marks = [np.empty((0, 2))], [np.empty(0, dtype=bool)]
    for a, b in pairwise(order):
        leg = ways.path(a, b)[1:]
        corners.append(leg)
        marks.append(np.arange(len(leg)) == len(leg) - 1)
    return np.concatenate(corners), np.concatenate(marks)


def way_home_m(request: PlanRequest, point_m: ArrayLike, passage: Passage) -> float:
    """Metres over water from a point to the request's home; 0 if it has none.

    Raises:
        Unreachable: there is no way.
    """
    if request.home_m is None:
        return 0.0
    return path_length_m(passage.path(point_m, np.asarray(request.home_m, dtype=float).reshape(2)))


def affordable(
    request: PlanRequest, route_m: FloatArray, is_spot: NDArray[np.bool_], passage: Passage
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """As much of a route, corners (k, 2) without the start, as the request's budget allows, the way home kept.

    Where it is cut it ends in a spot.

    Raises:
        PlanningError: the way home alone is longer than the budget, or nothing is left for any other.
        Unreachable: there is no way home.
    """
    start, budget = start_of(request), request.budget_m
    whole = np.concatenate([start[None], route_m])
    length = path_length_m(whole)
    if budget is None or length + way_home_m(request, whole[-1], passage) <= budget:
        return route_m, is_spot
    home = way_home_m(request, start, passage)
    if home > budget:
        raise PlanningError(
            f"the way home is {home:.0f} m long, more than the {budget:.0f} m that may be sailed"
        )
    # Sailing on never shortens what has been sailed plus the way home: it is at most as much shorter.
    low, high = 0.0, min(length, budget)
    usable = budget - _ROUND_OFF_M
    for _ in range(_CUTS):
        middle = 0.5 * (low + high)
        fits = middle + way_home_m(request, advance_along(whole, middle), passage) <= usable
        low, high = (middle, high) if fits else (low, middle)
    if low <= _ROUND_OFF_M:
        beside = "" if request.home_m is None else f" beside the way home, {home:.1f} m"
        raise PlanningError(f"{budget:.1f} m are too short to get anywhere{beside}")
    sailed = np.cumsum(np.hypot(*np.diff(whole, axis=0).T))
    kept = np.count_nonzero(sailed < low)
    cut = np.concatenate([route_m[:kept], advance_along(whole, low)[None]])
    return cut, np.concatenate([is_spot[:kept], [True]])


def information_of_spots(request: PlanRequest, spots_m: FloatArray, sites_m: FloatArray) -> float:
    """True mutual information of measurements at spots (n, 2) with those at the candidate sites (N, 2), in nats.

    For planners whose spots are not candidate sites.

    Raises:
        PlanningError: the model's covariance is unusable.
    """
    try:
        S = measurement_covariance(request.model, np.concatenate([spots_m, sites_m]))
        return mutual_information(S, range(len(spots_m)))
    except ValueError as error:
        raise PlanningError(f"the model's covariance cannot be planned with: {error}") from error


def along(places_m: ArrayLike, passage: Passage) -> tuple[FloatArray, NDArray[np.bool_]]:
    """A route from each of the places, shape (n, 2), to the next: as `assemble`, for many places in a known order.

    Raises:
        Unreachable: there is no way between two places that follow each other.
    """
    corners, marks = [np.empty((0, 2))], [np.empty(0, dtype=bool)]
    for a, b in pairwise(np.asarray(places_m, dtype=float).reshape(-1, 2)):
        leg = passage.path(a, b)[1:]
        corners.append(leg)
        marks.append(np.arange(len(leg)) == len(leg) - 1)
    return np.concatenate(corners), np.concatenate(marks)


def verify(
    start_m: ArrayLike, route_m: ArrayLike, survey: SurveyArea, home_m: ArrayLike | None = None
) -> None:
    """Check every leg of a route, corners (k, 2) without the start, against the polygons themselves.

    The raster on which routes are found has no part in this. A start outside navigable water is allowed, and so is
    an end at `home_m`, (2,): the leg from there, or to it, must be free of land and keep-out.

    Raises:
        PlanningError: a leg is not clear.
    """
    start = np.asarray(start_m, dtype=float).reshape(1, 2)
    corners = np.concatenate([start, np.asarray(route_m, dtype=float).reshape(-1, 2)])
    clear = survey.legs_are_clear(corners[:-1], corners[1:])
    if len(clear) and not survey.is_navigable(start)[0]:
        clear[0] = survey.approach_is_clear(corners[0], corners[1])
    if len(clear) and home_m is not None and np.allclose(corners[-1], home_m, rtol=0.0, atol=ROUND_OFF_M):
        clear[-1] = clear[-1] or survey.approach_is_clear(corners[-1], corners[-2])
    for k in np.flatnonzero(~clear):
        a, b = survey.frame.to_geodetic(corners[k : k + 2])
        raise PlanningError(
            f"leg {k} of the route, from {a[0]:.6f}, {a[1]:.6f} to {b[0]:.6f}, {b[1]:.6f}, "
            "is not over navigable water"
        )
