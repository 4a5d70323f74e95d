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
from autonomy.planning.passage import passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.spacing import round_spacing_m
from autonomy.planning.survey import SurveyArea
from autonomy.planning.tour import closed_tour

NAME = "patrol"

_FEWEST_SITES = 4
_MOST_SITES = 300
_MATERIAL = 1.25
"""A round goes on as it is while the spacing that the field asks for is within this factor of its own."""

_FACTORS = np.exp(np.linspace(-1.0, 1.0, 41) * np.log(_MATERIAL))
"""Spacings tried for the lattice of a round under way."""

_RECOGNISED = 0.8
"""Share of the remainder's spots that must lie on a lattice for it to be theirs; obstacles may have come up."""

_SAME_SITE = 1e-6
_HERE_M = 1.0


def plan(request: PlanRequest, survey: SurveyArea) -> Plan:
    """One round over a lattice of sites, from where the vessel is back to where it joined.

    The sites are as far apart as the learned field asks for (`round_spacing_m`); the round is a short closed tour of
    them over water, always in the same direction. What is left of a previous round is gone on with, on its own
    lattice, unless the field now asks for one that is finer or coarser by more than a quarter. A new round is joined
    at its nearest site. Of a round longer than the budget the first part is sailed.

    Raises:
        PlanningError: no water can be reached, the way home is longer than the budget, the model's covariance is
            unusable, or a leg of the finished route is not over navigable water.
    """
    start, passage = start_of(request), passage_of(survey)
    known, unreachable = reachable_sites(request, survey, passage)
    spots = _left_over(request)
    sites = _sites(request, survey, spots)
    detours = Detours(survey, passage, start)
    places = sites[list(_round(survey, sites.tobytes()))]
    if len(spots):
        joined = int(np.argmin(np.hypot(*(places - spots[0]).T)))
    else:
        joined = int(np.argmin(detours.distances(np.broadcast_to(start, places.shape), places)))
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


def _sites(request: PlanRequest, survey: SurveyArea, spots: FloatArray) -> FloatArray:
    """The sites of the round: those of the round under way if its lattice will still do."""
    wanted_m = round_spacing_m(request.model.kernel, survey.navigable.area, request.speed_mps)
    lattice = _lattice(survey, wanted_m)
    if len(spots):
        nearby = dict.fromkeys(_lattice(survey, wanted_m * factor) for factor in sorted(_FACTORS, key=_away))
        lattice = next((each for each in nearby if _is_on(spots, survey, each)), lattice)
    sites = _reachable(request, survey, lattice)
    while len(sites) < _FEWEST_SITES and max(lattice) < survey.passage_cells:
        lattice = (2 * lattice[0], 2 * lattice[1])
        sites = _reachable(request, survey, lattice)
    return sites


def _away(factor: float) -> float:
    return abs(float(np.log(factor)))


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


@lru_cache(maxsize=4)
def _round(survey: SurveyArea, sites: bytes) -> tuple[int, ...]:
    """The order of a closed tour over water of sites (n, 2), given as bytes; the same for the same sites."""
    places = np.frombuffer(sites).reshape(-1, 2)
    return closed_tour(Detours(survey, passage_of(survey), places[0]).between(places))
