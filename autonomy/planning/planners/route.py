"""Whole routes that spend a budget where the field is rough, readings all along the way."""

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.learning.roughness import local_roughness
from autonomy.planning.assembly import affordable, start_of, verify
from autonomy.planning.passage import passage_of
from autonomy.planning.plan import NO_SPOTS, Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.route_candidates import Draft, Drafting, route_of
from autonomy.planning.route_search import Found, RouteSearch
from autonomy.planning.survey import SurveyArea
from autonomy.planning.water_lattice import WaterLattice, shore_distance, water_lattice_of
from autonomy.planning.weighted_variance import NOISE, WeightedVariance, conditioned, planning_covariance

NAME = "route"

_ROUNDS_PER_SIDE, _FEWEST_ROUNDS, _MOST_ROUNDS = 12.0, 40, 120
"""Of the search, for each side of budget: long routes have more corners to put right."""
_READINGS_PER_SIDE = 50
"""Readings along the way where the request does not say how dense they are, and never denser."""
_HORIZON = 6.0
"""Of the side: how far a plan looks if there is no end."""
_FARTHEST = 40.0
"""Of the side: a plan looks no farther than this, whatever the budget; what comes after is planned when it is near."""
_SATURATING_LAG = 0.06
"""Differences at a longer lag than this, which small budgets bring, say less about the error between tracks."""
_SATURATED = 4.0
"""More readings in one cell than this say nothing new about the water around it."""


def plan(request: PlanRequest, survey: SurveyArea) -> Plan:
    """The route within the budget whose readings leave the least roughness-weighted variance over the water.

    No corner is a sampling spot: readings are taken all along. With a home the route ends there.

    The search begins with what is left of the previous plan, or with lawnmowers in two directions if there is
    none; the best of what comes of them is taken.

    Raises:
        PlanningError: no water can be reached, the way home is longer than the budget or nothing is left beside it, or
            a leg of the finished route is not over navigable water.
    """
    problem = _Problem(request, survey)
    drafts = problem.drafts()
    rounds = problem.rounds()
    searched = [problem.searched(draft, -(-rounds // len(drafts)), k) for k, draft in enumerate(drafts)]
    found = [(draft, one) for draft, one in zip(drafts, searched, strict=True) if one is not None]
    found.sort(key=lambda pair: pair[1].objective)
    route = route_of(problem.lattice, found[0][0], found[0][1].chain) if found else problem.start_m[:0]
    if not len(route):
        return problem.short_plan()
    verify(problem.start_m, route, survey, request.home_m)
    return Plan(
        problem.start_m,
        route,
        np.zeros(len(route), dtype=bool),
        NO_SPOTS,
        NAME,
        request.reason,
        objective_before=problem.before,
        objective_after=found[0][1].objective,
        home_corners=found[0][0].home_corners,
        rejected=tuple((draft.name, one.objective) for draft, one in found[1:]),
    )


class _Problem:
    """What all candidates of one request share."""

    def __init__(self, request: PlanRequest, survey: SurveyArea) -> None:
        self.request, self.survey = request, survey
        self.start_m = start_of(request)
        self.lattice = water_lattice_of(survey)
        side_m = self.lattice.side_m
        self.budget_m = _HORIZON * side_m
        if request.budget_m is not None:
            self.budget_m = min(float(request.budget_m), self._farthest_m(side_m))
        self.spacing_m = max(request.sample_spacing_m, side_m / _READINGS_PER_SIDE)
        self.before: float | None = None
        home = self._home_m()
        self.drafting = Drafting(survey, self.lattice, self.start_m, self.budget_m, home)
        self._weights = weights(request, survey, self.lattice)
        self._K = planning_covariance(self.lattice.points_m / side_m)
        self._measured = _measured(request, self.lattice)

    def rounds(self) -> int:
        """How long to search, all drafts together."""
        if self.request.iterations is not None:
            return self.request.iterations
        wanted = round(_ROUNDS_PER_SIDE * self.budget_m / self.lattice.side_m)
        return min(max(wanted, _FEWEST_ROUNDS), _MOST_ROUNDS)

    def _home_m(self) -> FloatArray | None:
        home = self.request.home_m
        return None if home is None else np.asarray(home, dtype=float).reshape(2)

    def _farthest_m(self, side_m: float) -> float:
        """Never so near that a far home could not be reached."""
        home = self._home_m()
        return _FARTHEST * side_m + (0.0 if home is None else 2.0 * float(np.hypot(*(home - self.start_m))))

    def drafts(self) -> list[Draft]:
        """Where searches begin; none if the budget is too short for any cell."""
        remainder = np.asarray(self.request.remainder_m, dtype=float).reshape(-1, 2)
        continued = self.drafting.along("remainder", remainder) if len(remainder) else None
        if continued is not None:
            return [continued]
        direct = self.drafting.direct()
        return self.drafting.sweeps() or ([direct] if direct is not None else [])

    def searched(self, draft: Draft, rounds: int, number: int) -> Found | None:
        """The best route that `rounds` of search from a draft lead to; None if none is within the budget."""
        objective = WeightedVariance(conditioned(self._K, self._precision(draft, draft.chain)), self._weights)
        if draft.name == "remainder":
            self.before = objective.value
        room_m = self.budget_m - draft.fixed_m
        if room_m <= 0.0:
            return self._cut(draft)
        search = RouteSearch(
            self.lattice,
            objective,
            draft.chain,
            room_m,
            self.spacing_m,
            self.request.home_m is not None,
            self.request.seed + 7919 * number,
        )
        return search.run(rounds) or self._cut(draft)

    def short_plan(self) -> Plan:
        """Towards the nearest cell as far as the budget allows, and home.

        Raises:
            PlanningError: it allows nothing.
        """
        request, passage = self.request, passage_of(self.survey)
        way = self.drafting.way_in()[1:]
        route, _ = affordable(request, way, np.zeros(len(way), dtype=bool), passage)
        back = np.empty((0, 2)) if request.home_m is None else passage.path(route[-1], request.home_m)[1:]
        route = np.concatenate([route, back])
        verify(self.start_m, route, self.survey, request.home_m)
        S = conditioned(self._K, self._along(np.concatenate([self.start_m[None], route])) / NOISE)
        return Plan(
            self.start_m,
            route,
            np.zeros(len(route), dtype=bool),
            NO_SPOTS,
            NAME,
            request.reason,
            objective_after=float(self._weights @ np.diagonal(S)),
            home_corners=len(back),
        )

    def _cut(self, draft: Draft) -> Found | None:
        """The draft itself, cut to the budget."""
        fitted = self.drafting.fitted(draft)
        if fitted is None:
            return None
        chain = fitted.chain
        legs = self.lattice.leg_number[list(chain[:-1]), list(chain[1:])]
        S = conditioned(self._K, self._precision(draft, chain))
        length_m = float(self.lattice.leg_length_m[legs].sum())
        return Found(chain, length_m, float(self._weights @ np.diagonal(S)))

    def _precision(self, draft: Draft, chain: tuple[int, ...]) -> FloatArray:
        readings = self._along(draft.head_m) + self.lattice.readings(chain, self.spacing_m)
        if len(draft.tail_m) > 1:
            readings += self.lattice.readings_along(draft.tail_m, self.spacing_m)
        return readings / NOISE

    def _along(self, way_m: FloatArray) -> FloatArray:
        """Readings in each cell: those taken, and those on a way (k, 2); shape (N,)."""
        return self._measured + self.lattice.readings_along(way_m, self.spacing_m)


def weights(request: PlanRequest, survey: SurveyArea, lattice: WaterLattice) -> FloatArray:
    """Expected local variance of each cell, shape (N,), sum 1: where the field is rough or may well be, an error
    counts more.
    """
    readings = request.roughness
    places = np.empty((0, 2)) if readings is None else readings.points_m
    mean, variance = local_roughness(
        readings,
        request.model.kernel.noise_variance,
        shore_distance(survey, places),
        lattice.points_m,
        lattice.shore,
        lattice.side_m,
    )
    # Where tracks are far apart the field has differed as much as it ever does between them, rough or not.
    lag = 0.0 if readings is None else readings.lag_m / lattice.side_m
    logarithm = (mean + 0.5 * variance) * min(1.0, _SATURATING_LAG / max(lag, _SATURATING_LAG))
    weight = np.exp(logarithm - logarithm.max())
    return np.asarray(weight / weight.sum())


def _measured(request: PlanRequest, lattice: WaterLattice) -> FloatArray:
    """Readings taken in each cell so far, shape (N,)."""
    cells = request.measured
    if cells is None or not len(cells):
        return np.zeros(len(lattice))
    count = np.bincount(lattice.cells_at(cells.points[:, :2]), cells.counts, len(lattice))
    return np.minimum(count, _SATURATED)
