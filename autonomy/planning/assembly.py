"""What planners share: sites that can be reached, a route put together from ways over water, its last check."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import Passage, Ways
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea


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


def verify(start_m: ArrayLike, route_m: ArrayLike, survey: SurveyArea) -> None:
    """Check every leg of a route, corners (k, 2) without the start, against the polygons themselves.

    The raster on which routes are found has no part in this. A start outside navigable water is allowed: its first
    leg must be free of land and keep-out.

    Raises:
        PlanningError: a leg is not clear.
    """
    start = np.asarray(start_m, dtype=float).reshape(1, 2)
    corners = np.concatenate([start, np.asarray(route_m, dtype=float).reshape(-1, 2)])
    clear = survey.legs_are_clear(corners[:-1], corners[1:])
    if len(clear) and not survey.is_navigable(start)[0]:
        clear[0] = survey.approach_is_clear(corners[0], corners[1])
    for k in np.flatnonzero(~clear):
        a, b = survey.frame.to_geodetic(corners[k : k + 2])
        raise PlanningError(
            f"leg {k} of the route, from {a[0]:.6f}, {a[1]:.6f} to {b[0]:.6f}, {b[1]:.6f}, "
            "is not over navigable water"
        )
