"""Ways to choose where to sample that people use today, leg by leg, for a vessel that sails what it is told.

Each is a function of where the voyage stands: the corners to sail next. None left, the vessel is done. All of them
know what the service on board knows beforehand: the water, where home is, and how far they may sail. All come home in
time, if there is a home. What is read on the way, they learn with the batch Gaussian process of `compare_maps`, whose
hyperparameters are fitted to all that was read so far every time that they plan.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.planning.detours import Detours
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import Passage, passage_of
from autonomy.planning.selection import select_greedily
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import Sweep, headings, lawnmowers
from autonomy.planning.tour import open_tour
from sim.experiment.compare_maps import BatchMap, Read

LATTICE = (12, 12)
SPOTS = 20
"""Candidate sites, and sampling spots on one path: as configured by default on board."""

_DRAWS = 50
_HERE_SIDES = 0.01
_EQUAL = 1e-3
"""Of the signal variance: sites that differ by less are as uncertain."""


@dataclass(frozen=True, eq=False)
class Underway:
    """Where a voyage stands when its next stretch is asked for.

    Attributes:
        survey: the water.
        here_m: shape (2,).
        home_m: shape (2,), where the voyage has to end; None: anywhere.
        left_m: what may still be sailed.
        time_s: since the field's start.
        read: all that was read so far, in the cells of the vessel's history.
        may_move: whether the field may.
        seed: of the voyage.
    """

    survey: SurveyArea
    here_m: FloatArray
    home_m: FloatArray | None
    left_m: float
    time_s: float
    read: Read
    may_move: bool
    seed: int

    @property
    def passage(self) -> Passage:
        """Ways over water."""
        return passage_of(self.survey)

    @property
    def side_m(self) -> float:
        """√(water area)."""
        return float(np.sqrt(self.survey.area_m2))

    def map(self) -> BatchMap:
        """What is known by now."""
        return BatchMap.fitted(self.read, self.survey.span_m, may_move=self.may_move, seed=self.seed)

    def way(self, goal_m: FloatArray) -> FloatArray:
        """Corners (k, 2) of the shortest way over water to a goal, the start excluded."""
        return self.passage.path(self.here_m, goal_m)[1:]

    def homeward(self) -> FloatArray:
        """The way home, (k, 2), the start excluded; nothing if there is no home, or it is here."""
        if self.home_m is None or self._is_here(self.home_m):
            return np.empty((0, 2))
        return self.way(self.home_m)

    def sites(self) -> FloatArray:
        """Candidate sites that can be reached, (n, 2)."""
        sites = self.survey.candidate_sites(*LATTICE)
        reachable: FloatArray = sites[self.passage.reachable(self.here_m, sites)]
        return reachable

    def affordable(self, goals_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The goals (n, 2) from which home can be reached in time and that are not here; and how far each is, (n,)."""
        away = self._distances(self.here_m, goals_m)
        fits = np.isfinite(away) & (away > _HERE_SIDES * self.side_m)
        if self.home_m is not None:
            fits &= away + self._distances(self.home_m, goals_m) <= self.left_m
        return goals_m[fits], away[fits]

    def _distances(self, end_m: FloatArray, goals_m: FloatArray) -> FloatArray:
        return Detours(self.survey, self.passage, end_m).distances(
            np.broadcast_to(end_m, goals_m.shape), goals_m
        )

    def _is_here(self, place_m: FloatArray) -> bool:
        return float(np.hypot(*(place_m - self.here_m))) <= _HERE_SIDES * self.side_m


class Strategy(Protocol):
    """One voyage's way to choose."""

    def stretch(self, underway: Underway) -> FloatArray:
        """The corners to sail next, (k, 2); none: the voyage is over."""


class Lawnmower:
    """Parallel lanes over all the water: a cover that uses up the budget, or a sparser one to and fro for ever.

    `direction` 0 has the lanes along the longer side of the area, 1 along the shorter. `cover_sides`: the length of
    one cover in √(water area); None: all that may be sailed. Lanes are clipped to the water; ways round land and the
    way home count.
    """

    def __init__(self, direction: int, cover_sides: float | None = None) -> None:
        self._direction, self._cover_sides = direction, cover_sides
        self._corners: FloatArray | None = None

    def stretch(self, underway: Underway) -> FloatArray:
        """All of one cover, then the way home; or the same lanes back again."""
        if self._corners is None:
            self._corners = self._cover(underway).route_m
            return self._corners
        if self._cover_sides is None:
            return underway.homeward()
        self._corners = self._corners[::-1]
        return self._corners[1:]

    def _cover(self, underway: Underway) -> Sweep:
        length_m = underway.left_m
        if self._cover_sides is not None:
            length_m = min(length_m, self._cover_sides * underway.side_m)
        heading = headings(underway.survey)[self._direction]
        found = lawnmowers(
            underway.survey, underway.here_m, length_m, home_m=underway.home_m, headings_rad=[heading]
        )
        if not found:
            raise PlanningError(f"{length_m:.0f} m are too short for a single lane")
        return min(found, key=lambda sweep: (sweep.spacing_m, sweep.inset_m))


class RandomWaypoints:
    """From one place, drawn evenly over the water, to the next."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def stretch(self, underway: Underway) -> FloatArray:
        """The way to another place; home when none of some draws can be afforded."""
        x_min, y_min, x_max, y_max = underway.survey.bounds
        drawn = self._rng.uniform((x_min, y_min), (x_max, y_max), (_DRAWS, 2))
        places = drawn[underway.survey.is_navigable(drawn)]
        places = places[underway.passage.reachable(underway.here_m, places)]
        places, _ = underway.affordable(places)
        return underway.way(places[0]) if len(places) else underway.homeward()


class GreedyEntropy:
    """Always to the site whose reading would be the least certain: the largest predictive entropy.

    The map is fitted anew at every site; among equals the nearest is taken.
    """

    def stretch(self, underway: Underway) -> FloatArray:
        """The way to one site; home when none can be afforded."""
        sites, away_m = underway.affordable(underway.sites())
        if not len(sites):
            return underway.homeward()
        belief = underway.map()
        variance = belief.predict(sites, underway.time_s).variance
        equal = variance >= variance.max() - _EQUAL * belief.kernel.signal_variance
        nearest = np.flatnonzero(equal)[np.argmin(away_m[equal])]
        return underway.way(sites[nearest])


class GreedyInformation:
    """Spots of high mutual information, greedily (Krause, Singh & Guestrin 2008), on a short tour; then others.

    The map is fitted anew, and the next spots are chosen, when a tour is sailed. Of spots that cannot all be afforded
    the first ones are taken.
    """

    def stretch(self, underway: Underway) -> FloatArray:
        """One whole tour; home when not even one spot can be afforded."""
        sites, _ = underway.affordable(underway.sites())
        if len(sites) < 2:
            return underway.homeward()
        S = underway.map().covariance(sites, underway.time_s)
        spots = sites[list(select_greedily(S, min(SPOTS, len(sites) - 1)))]
        ends = [] if underway.home_m is None else [underway.home_m]
        ways = underway.passage.ways(np.array([underway.here_m, *spots, *ends]))
        for count in range(len(spots), 0, -1):
            nodes = list(range(count + 1))
            D = ways.distances_m[np.ix_(nodes, nodes)]
            homeward_m = None if not ends else ways.distances_m[nodes, -1]
            order = open_tour(D, 0, ends=homeward_m, seed=underway.seed)
            length_m = float(np.sum(D[order[:-1], order[1:]]))
            if homeward_m is None or length_m + float(homeward_m[order[-1]]) <= underway.left_m:
                return np.concatenate([ways.path(a, b)[1:] for a, b in pairwise(order)])
        return underway.homeward()
