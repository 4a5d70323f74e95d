"""Spots of high mutual information by exchange on a short tour, which is sailed to its end while it is worth it."""

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.planning.assembly import (
    affordable,
    assemble,
    information_of_spots,
    reachable_sites,
    start_of,
    verify,
)
from autonomy.planning.errors import PlanningError
from autonomy.planning.exchange import select_by_exchange
from autonomy.planning.information import measurement_covariance, mutual_information
from autonomy.planning.passage import Ways, passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from autonomy.planning.tour import open_tour

NAME = "spots"

_LOYALTY = 0.1
"""Of the mutual information of as many spots elsewhere: what is given up for sailing a tour to its end."""

_HERE_M = 1.0


def plan(request: PlanRequest, survey: SurveyArea) -> Plan:
    """Spots refined by exchange on an open tour over water; those left of the previous one while hardly any tell more.

    Every plan has all the water before it, and leaves what is far to its end: with a new tour at every re-estimate the
    vessel would never come there, nor back to where it has been, and would not see that the field moves.

    If the tour is longer than the budget allows, spots are dropped, those first that tell least for the metres they
    cost, until it fits.

    Raises:
        PlanningError: no candidate can be reached, the way home is longer than the budget, the model's covariance is
            unusable, or a leg of the finished route is not over navigable water.
    """
    start, passage = start_of(request), passage_of(survey)
    sites, unreachable = reachable_sites(request, survey, passage)
    S = measurement_covariance(request.model, sites)
    chosen = _select(request, survey, sites, S)
    home = [] if request.home_m is None else [np.asarray(request.home_m, dtype=float).reshape(2)]
    ways = passage.ways(np.array([start, *sites[list(chosen)], *home]))
    order = _Tour(request, ways, S[np.ix_(chosen, chosen)]).fitted()
    route, is_spot = assemble(ways, order)
    # A budget too small for any spot is spent on the way to the one that costs least.
    sailed, is_spot = affordable(request, route, is_spot, passage)
    verify(start, sailed, survey, request.home_m)
    if sailed is route:
        information = mutual_information(S, [chosen[k - 1] for k in order[1:]])
    else:
        information = information_of_spots(request, sailed[is_spot], sites)
    return Plan(start, sailed, is_spot, information, NAME, request.reason, unreachable)


def _select(request: PlanRequest, survey: SurveyArea, sites: FloatArray, S: FloatArray) -> list[int]:
    """The spots to visit: those that are left of the previous plan, or as many as are wanted."""
    n = max(1, min(request.spots, len(sites) - 1))
    left = _not_yet_visited(request, survey, sites)
    try:
        if 0 < len(left) <= n and _tell_enough(S, left, request.seed):
            return left
        selection = select_by_exchange(S, n, seed=request.seed, first=[left] if left else [])
    except ValueError as error:
        raise PlanningError(f"the model's covariance cannot be planned with: {error}") from error
    return list(selection.sites)


def _tell_enough(S: FloatArray, left: list[int], seed: int) -> bool:
    """Whether no other spots, of the same number, tell much more."""
    others = select_by_exchange(S, len(left), seed=seed, first=[left])
    return mutual_information(S, left) >= (1.0 - _LOYALTY) * others.mutual_information


def _not_yet_visited(request: PlanRequest, survey: SurveyArea, sites: FloatArray) -> list[int]:
    """The sites nearest to the remainder's spots, where there is one within a cell of the lattice."""
    corners = np.asarray(request.remainder_m, dtype=float).reshape(-1, 2)
    spots = corners[np.asarray(request.remainder_is_spot, dtype=bool)]
    x_min, y_min, x_max, y_max = survey.bounds
    cell = np.array([x_max - x_min, y_max - y_min]) / request.lattice
    kept: dict[int, None] = {}
    for spot in spots:
        away = np.abs(sites - spot) / cell
        nearest = int(np.argmin(np.sum(away**2, axis=1)))
        if away[nearest].max() <= 0.5 + 1e-9:
            kept[nearest] = None
    return list(kept)


class _Tour:
    """The tour through the chosen spots, nodes 1 … n of the ways; node 0 is the start, n + 1 the home, if any."""

    def __init__(self, request: PlanRequest, ways: Ways, S: FloatArray) -> None:
        self._request, self._S = request, S
        n = len(S)
        self._D = ways.distances_m[: n + 1, : n + 1]
        self._home = ways.distances_m[: n + 1, n + 1] if request.home_m is not None else np.zeros(n + 1)
        budget = request.budget_m
        self._budget_m = np.inf if budget is None else float(budget)

    def fitted(self) -> tuple[int, ...]:
        """The order of the nodes that are kept, the start first; one spot at least."""
        nodes = list(range(len(self._D)))
        order = self._shortest(nodes, homeward=False)
        if self._length(order) > self._budget_m:
            # What lies here costs nothing, and would be all that is left of a tour that leads nowhere.
            elsewhere = [k for k in nodes if k == 0 or self._D[0, k] > _HERE_M]
            nodes = elsewhere if len(elsewhere) > 1 else nodes
            order = self._shortest(nodes, homeward=True)
        while self._length(order) > self._budget_m and len(order) > 2:
            nodes = sorted(set(order) - {self._least(order)})
            order = self._shortest(nodes, homeward=True)
        return order

    def _shortest(self, nodes: list[int], *, homeward: bool) -> tuple[int, ...]:
        """The shortest order; with the way home, if it matters."""
        ends = self._home[nodes] if homeward else None
        try:
            tour = open_tour(self._D[np.ix_(nodes, nodes)], 0, ends=ends, seed=self._request.seed)
        except ValueError as error:
            raise PlanningError(f"no tour through the sampling spots: {error}") from error
        return tuple(nodes[k] for k in tour)

    def _length(self, order: tuple[int, ...]) -> float:
        return float(np.sum(self._D[order[:-1], order[1:]]) + self._home[order[-1]])

    def _least(self, order: tuple[int, ...]) -> int:
        """The spot that tells least, given the others, for each metre that leaving it out saves."""
        spots = np.array(order[1:]) - 1
        # ½ log(var(z_p | the others)/σn²), the information that is lost with p.
        precision = np.diag(np.linalg.inv(self._S[np.ix_(spots, spots)]))
        lost = -0.5 * np.log(precision * self._request.model.kernel.noise_variance)
        saved = [self._length(order) - self._length(order[:k] + order[k + 1 :]) for k in range(1, len(order))]
        worth = np.maximum(lost, 0.0) / np.maximum(saved, 1e-9)
        return order[1 + int(np.argmin(worth))]
