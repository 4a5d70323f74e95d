"""First drafts of whole routes: polylines turned into chains of lattice cells that fit a budget."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from autonomy.geometry import FloatArray, advance_along, path_length_m
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import passage_of
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import lawnmowers
from autonomy.planning.water_lattice import WaterLattice

__all__ = ["Draft", "Drafting"]

_STEP = 0.08
"""Corners of a draft are at most about so far apart, as a share of the side."""
_ENTRY = 0.06
"""A route joins the lattice about so far from where it begins."""
_TRIED = 40


@dataclass(frozen=True, eq=False)
class Draft:
    """A route before the search.

    Attributes:
        name: for a person.
        head_m: shape (k, 2), the way from the start to the chain's first cell, both included.
        chain: cells, neighbours joined by legs.
        tail_m: shape (k, 2), the way from the chain's last cell home, both included; empty if the route may end
            anywhere.
    """

    name: str
    head_m: FloatArray
    chain: tuple[int, ...]
    tail_m: FloatArray

    @property
    def fixed_m(self) -> float:
        """Length of head and tail."""
        return path_length_m(self.head_m) + path_length_m(self.tail_m)

    @property
    def home_corners(self) -> int:
        """How many of the route's last corners are the way home."""
        return int(np.any(np.diff(self.tail_m, axis=0) != 0.0, axis=1).sum())


class Drafting:
    """Makes drafts for one start, budget and home.

    Raises:
        PlanningError: no cell can be reached from the start.
    """

    def __init__(
        self,
        survey: SurveyArea,
        lattice: WaterLattice,
        start_m: FloatArray,
        budget_m: float,
        home_m: FloatArray | None,
    ) -> None:
        self._survey, self._lattice = survey, lattice
        self._start_m, self._budget_m, self._home_m = start_m, budget_m, home_m
        passage = passage_of(survey)
        self._usable = np.flatnonzero(lattice.navigable)
        self._usable = self._usable[passage.reachable(start_m, lattice.points_m[self._usable])]
        if not len(self._usable):
            lat_deg, lon_deg = survey.frame.to_geodetic(start_m)
            raise PlanningError(
                f"none of the {len(lattice)} cells of the water can be reached from {lat_deg:.5f}, {lon_deg:.5f}; "
                "the vessel may be on land, outside the area or in water that is cut off"
            )
        self._tree = cKDTree(lattice.points_m[self._usable])
        # Reachable on the raster and along legs: the two may differ in the narrowest of channels.
        anchor = self._way_in(start_m, start_m)[1]
        self._usable = self._usable[np.isfinite(lattice.distances_m(anchor)[self._usable])]
        self._tree = cKDTree(lattice.points_m[self._usable])
        self._home = None if home_m is None else self._way_in(home_m, home_m)

    def along(self, name: str, corners_m: FloatArray) -> Draft | None:
        """A draft that follows a polyline (k, 2) from the start, which is not among its corners.

        It may be longer than the budget by a tenth; what is beyond is cut off. None if the budget is too short to get
        to a cell, and home.
        """
        lattice, way = self._lattice, np.concatenate([self._start_m[None], corners_m])
        first_m = float(np.hypot(*(way[1] - way[0])))
        joined_m = first_m if first_m <= 2.0 * _ENTRY * lattice.side_m else _ENTRY * lattice.side_m
        head_m, entry = self._way_in(self._start_m, advance_along(way, joined_m))
        chain = [entry]
        for cell in self._cells_along(way)[1:]:
            if cell != chain[-1]:
                chain += lattice.path(chain[-1], cell)[1:]
        return self.fitted(Draft(name, head_m, tuple(chain), self._tail()), 1.1)

    def sweeps(self) -> list[Draft]:
        """Lawnmowers that fit the budget: of each heading the one from the nearest corner."""
        found = lawnmowers(
            self._survey, self._start_m, self._budget_m, home_m=self._home_m, nearest_corner=True
        )
        drafts = [
            self.along(f"lawnmower along {np.degrees(sweep.heading_rad):.0f} degrees", sweep.route_m)
            for sweep in found
        ]
        return [draft for draft in drafts if draft is not None]

    def direct(self) -> Draft | None:
        """Where nothing else fits: into the lattice, and home if need be."""
        return self.along("direct", self._start_m[None])

    def way_in(self) -> FloatArray:
        """The way from the start to a cell near it, both included, shape (k, 2)."""
        return self._way_in(self._start_m, self._start_m)[0]

    def fitted(self, draft: Draft, share: float = 1.0) -> Draft | None:
        """The longest beginning of the draft's chain from which home remains within `share` × budget; None: none."""
        lattice, room_m = self._lattice, share * self._budget_m - draft.fixed_m
        chain = np.array(draft.chain)
        lengths = lattice.leg_length_m[lattice.leg_number[chain[:-1], chain[1:]]]
        sailed_m = np.concatenate([[0.0], np.cumsum(lengths)])
        if self._home is None:
            fits = np.flatnonzero(sailed_m <= room_m)
        else:
            home_cell = self._home[1]
            fits = np.flatnonzero(sailed_m + lattice.distances_m(home_cell)[chain] <= room_m * (1.0 + 1e-12))
        if not len(fits):
            return None
        kept = list(draft.chain[: int(fits[-1]) + 1])
        # A round has two ends, even if they are the same cell.
        if self._home is not None and (kept[-1] != self._home[1] or len(kept) == 1):
            kept += lattice.path(kept[-1], self._home[1])[1:]
        return Draft(draft.name, draft.head_m, tuple(kept), draft.tail_m)

    def _tail(self) -> FloatArray:
        return np.empty((0, 2)) if self._home is None else self._home[0][::-1].copy()

    def _cells_along(self, way_m: FloatArray) -> list[int]:
        """Usable cells near a polyline, in its order."""
        step_m, places = _STEP * self._lattice.side_m, [way_m[:1]]
        for a, b in pairwise(way_m):
            # What a single leg can be is not bent by going to cells beside it.
            parts = 1 if np.hypot(*(b - a)) <= 2.0 * step_m else int(np.ceil(np.hypot(*(b - a)) / step_m))
            places.append(a + (np.arange(1, parts + 1) / parts)[:, None] * (b - a))
        nearest = self._tree.query(np.concatenate(places))[1]
        cells: list[int] = self._usable[nearest].tolist()
        return cells

    def _way_in(self, start_m: FloatArray, towards_m: FloatArray) -> tuple[FloatArray, int]:
        """The way from a place to a cell near another place: straight if any leads there straight."""
        nearest = np.atleast_1d(self._tree.query(towards_m, k=min(_TRIED, len(self._usable)))[1])
        cells = self._usable[nearest]
        goals = self._lattice.points_m[cells]
        navigable = bool(self._survey.is_navigable(start_m)[0])
        test = self._survey.legs_are_clear if navigable else self._survey.approaches_are_clear
        clear = np.flatnonzero(test(start_m, goals))
        if len(clear):
            k = int(clear[0])
            return np.stack([start_m, goals[k]]), int(cells[k])
        return passage_of(self._survey).path(start_m, goals[0]), int(cells[0])


def route_of(lattice: WaterLattice, draft: Draft, chain: Sequence[int]) -> FloatArray:
    """Corners of head, chain and tail, the start excluded, shape (k, 2); no two that follow each other are equal."""
    route = np.concatenate([draft.head_m[1:], lattice.corners(chain)[1:], draft.tail_m[1:]])
    moves = np.any(np.diff(route, axis=0, prepend=draft.head_m[:1]) != 0.0, axis=1)
    return np.asarray(route[moves])
