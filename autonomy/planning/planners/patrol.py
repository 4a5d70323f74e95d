"""Round and round for ever over a field that moves: every place is seen again after the same time."""

from functools import lru_cache

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.planning.assembly import (
    affordable,
    along,
    information_of_spots,
    reachable_sites,
    start_of,
    verify,
)
from autonomy.planning.detours import Detours
from autonomy.planning.nowcast import nowcast_variance
from autonomy.planning.passage import passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.spacing import leading_component
from autonomy.planning.survey import SurveyArea
from autonomy.planning.tour import closed_tour

NAME = "patrol"

_FEWEST_SITES = 4
_MOST_SITES = 300

_SPACINGS = (0.8, 1.0, 1.2, 1.45, 1.75, 2.1)
"""Of the length-scale: lattices compared. A denser one sees nothing more, a coarser one loses what lies between."""

_LOYALTY = 1.1
"""A round is gone on with while no other promises a variance that is smaller by more than this factor."""

_SEARCHED = np.geomspace(0.5, 3.5, 200)
"""Of the length-scale: where the lattice of a round under way is looked for."""

_RECOGNISED = 0.8
"""Share of the remainder's spots that must lie on a lattice for it to be theirs; obstacles may have come up."""

_READINGS_PER_SIDE = 50
"""Readings along the way where the request does not say how dense they are."""

_SAME_SITE = 1e-6
_HERE_M = 1.0


def plan(request: PlanRequest, survey: SurveyArea) -> Plan:
    """One round over a lattice of sites, from where the vessel is back to where it joined.

    The round is a short closed tour of the sites over water, always in the same direction. Of several lattices, around
    the length-scale of what moves, that one is taken whose round promises the least variance of the nowcast, given how
    fast the field forgets and the vessel sails. What is left of a previous round is gone on with, on its own lattice,
    while that is nearly as good. A new round is joined at its nearest site. Of a round longer than the budget the first
    part is sailed.

    Raises:
        PlanningError: no water can be reached, the way home is longer than the budget, the model's covariance is
            unusable, or a leg of the finished route is not over navigable water.
    """
    start, passage = start_of(request), passage_of(survey)
    known, unreachable = reachable_sites(request, survey, passage)
    spots = _left_over(request)
    places = _best_round(request, survey, spots, known)
    if len(spots):
        joined = int(np.argmin(np.hypot(*(places - spots[0]).T)))
    else:
        away = Detours(survey, passage, start).distances(np.broadcast_to(start, places.shape), places)
        joined = int(np.argmin(away))
    places = np.concatenate([places[joined:], places[: joined + 1]])
    if len(places) > 2 and np.hypot(*(places[0] - start)) <= _HERE_M:
        places = places[1:]
    route, is_spot = along(np.concatenate([start[None], places]), passage)
    route, is_spot = affordable(request, route, is_spot, passage)
    verify(start, route, survey)
    information = information_of_spots(request, np.unique(route[is_spot], axis=0), known)
    return Plan(start, route, is_spot, information, NAME, request.reason, unreachable)


def _left_over(request: PlanRequest) -> FloatArray:
    """The remainder's spots, shape (n, 2)."""
    corners = np.asarray(request.remainder_m, dtype=float).reshape(-1, 2)
    left: FloatArray = corners[np.asarray(request.remainder_is_spot, dtype=bool)]
    return left


def _best_round(
    request: PlanRequest, survey: SurveyArea, spots: FloatArray, points: FloatArray
) -> FloatArray:
    """The sites of the round to sail in their order, shape (n, 2)."""
    scale_m = min(leading_component(request.model.kernel).space.lengthscales_m)
    lattices = dict.fromkeys(_lattice(survey, share * scale_m) for share in _SPACINGS)
    searched = dict.fromkeys(_lattice(survey, share * scale_m) for share in _SEARCHED)
    under_way = [each for each in searched if len(spots) and _is_on(spots, survey, each)]
    spacing_m = max(request.sample_spacing_m, survey.span_m / _READINGS_PER_SIDE)
    rounds, variances = [], []
    for lattice in [*under_way[:1], *lattices]:
        sites = _sites(request, survey, lattice)
        places = sites[list(_order(survey, sites.tobytes()))]
        variance = nowcast_variance(request.model.kernel, places, request.speed_mps, spacing_m, points)
        rounds.append(places)
        variances.append(variance)
    if under_way and variances[0] <= _LOYALTY * min(variances):
        return rounds[0]
    return rounds[int(np.argmin(variances))]


def _sites(request: PlanRequest, survey: SurveyArea, lattice: tuple[int, int]) -> FloatArray:
    """The lattice's sites that can be reached; those of a finer one if they are too few for a round."""
    sites = _reachable(request, survey, lattice)
    while len(sites) < _FEWEST_SITES and max(lattice) < survey.passage_cells:
        lattice = (2 * lattice[0], 2 * lattice[1])
        sites = _reachable(request, survey, lattice)
    return sites


def _lattice(survey: SurveyArea, spacing_m: float) -> tuple[int, int]:
    """Sites to the east and to the north, close to a spacing; coarser if there would be too many on the water."""
    x_min, y_min, x_max, y_max = survey.bounds
    spacing_m = max(spacing_m, float(np.sqrt(survey.navigable.area / _MOST_SITES)))
    return max(1, round((x_max - x_min) / spacing_m)), max(1, round((y_max - y_min) / spacing_m))


def _is_on(spots: FloatArray, survey: SurveyArea, lattice: tuple[int, int]) -> bool:
    """Whether spots are sites of a lattice, nearly all of them."""
    x_min, y_min, x_max, y_max = survey.bounds
    cells = (spots - [x_min, y_min]) / [x_max - x_min, y_max - y_min] * lattice - 0.5
    return bool(np.mean(np.all(np.abs(cells - np.round(cells)) < _SAME_SITE, axis=1)) >= _RECOGNISED)


def _reachable(request: PlanRequest, survey: SurveyArea, lattice: tuple[int, int]) -> FloatArray:
    sites = survey.candidate_sites(*lattice)
    reachable: FloatArray = sites[passage_of(survey).reachable(start_of(request), sites)]
    return reachable


@lru_cache(maxsize=16)
def _order(survey: SurveyArea, sites: bytes) -> tuple[int, ...]:
    """The order of a closed tour over water of sites (n, 2), given as bytes; the same for the same sites."""
    places = np.frombuffer(sites).reshape(-1, 2)
    return closed_tour(Detours(survey, passage_of(survey), places[0]).between(places))
