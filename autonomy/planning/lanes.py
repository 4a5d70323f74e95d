"""Lanes over the water in one direction: their pieces, and the orders in which these are sailed.

Lanes are clipped to the navigable water that the vessel can reach; the pieces that lie side by side form cells, each is
swept back and forth, and the nearest cell not yet swept comes next (boustrophedon cellular decomposition, Choset 2000).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import cos, sin

import numpy as np
import shapely
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray
from autonomy.planning.detours import Detours
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import Passage, passage_of
from autonomy.planning.survey import SurveyArea

CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
"""Where a sweep starts: at the (first, last) lane's (near, far) end, seen along the heading."""

INSET, DEEPEST = 0.5, 1.0
"""Of the spacing: by how much lanes end before the water does while their number is looked for, and at most."""

_SHORTEST = 0.5
"""Of the spacing: shorter pieces of a lane are left out, its neighbours see what is there."""


class Water:
    """What all lanes of one request share.

    Args:
        survey: the water.
        start_m: shape (2,), where the vessel is.
        home_m: shape (2,), where it must get in the end; None: the last lane may end anywhere.

    Raises:
        PlanningError: no navigable water can be reached from the start.
    """

    def __init__(self, survey: SurveyArea, start_m: FloatArray, home_m: ArrayLike | None) -> None:
        self.survey, self.start_m = survey, start_m
        self.passage: Passage = passage_of(survey)
        self.detours = Detours(survey, self.passage, start_m)
        if not len(self.detours.cells_m):
            raise PlanningError(
                f"no water for lanes: the survey's is narrower than a cell of the raster, "
                f"{survey.span_m / survey.passage_cells:.0f} m; survey.passage_cells must be more than "
                f"{survey.passage_cells}"
            )
        self.home_m = None if home_m is None else np.asarray(home_m, dtype=float).reshape(2)


@dataclass(frozen=True, eq=False)
class Track:
    """Pieces of lanes in sailing order.

    Attributes:
        legs: shape (n, 2, 2), each from its start to its end.
        rough_m: length of the whole by coarse ways between the legs; infinite if there are none.
        heading_rad, spacing_m, inset_m, corner: as those of a `Sweep`.
    """

    legs: FloatArray
    rough_m: float
    heading_rad: float
    spacing_m: float
    inset_m: float
    corner: tuple[int, int]


class Lanes:
    """Lanes in one direction. In their own frame (u along, v across) a lane is a level of v."""

    def __init__(self, water: Water, heading_rad: float) -> None:
        self.water, self.heading_rad = water, heading_rad
        c, s = cos(heading_rad), sin(heading_rad)
        self._turn = np.array([[c, -s], [s, c]])
        cells = water.detours.cells_m @ self._turn
        # From the middles of cells to their rims.
        rim = 0.5 * water.survey.span_m / water.survey.passage_cells
        self._low, self._high = cells.min(axis=0) - rim, cells.max(axis=0) + rim

    @property
    def width_m(self) -> float:
        """How wide the water is across the lanes."""
        return float(self._high[1] - self._low[1])

    def pieces(self, count: int, left_out: int = 0) -> list[FloatArray]:
        """Of each of `count` lanes the pieces over reachable water, (n, 2): from and to, along u.

        Without those shorter than `_SHORTEST`, and without the `left_out` shortest of the others.
        """
        levels = self._levels(count)
        ends = np.array([[[self._low[0], v], [self._high[0], v]] for v in levels])
        lines = shapely.linestrings(ends @ self._turn.T)
        clipped, lane = shapely.get_parts(
            shapely.intersection(lines, self.water.survey.navigable), return_index=True
        )
        is_line = shapely.get_type_id(clipped) == shapely.GeometryType.LINESTRING.value
        corners = [shapely.get_coordinates(line) @ self._turn for line in clipped[is_line]]
        spans = np.array([[uv[:, 0].min(), uv[:, 0].max()] for uv in corners]).reshape(-1, 2)
        lane = lane[is_line]
        middle = np.stack([spans.mean(axis=1), levels[lane]], axis=-1) @ self._turn.T
        keep = spans[:, 1] - spans[:, 0] >= _SHORTEST * self.width_m / count
        keep &= self.water.detours.reachable(middle) if len(middle) else False
        spans, lane = spans[keep], lane[keep]
        longest = np.argsort(spans[:, 0] - spans[:, 1], kind="stable")
        kept = np.sort(longest[: max(0, len(spans) - left_out)])
        spans, lane = spans[kept], lane[kept]
        return [spans[lane == k][np.argsort(spans[lane == k, 0])] for k in range(count)]

    def _levels(self, count: int) -> FloatArray:
        levels: FloatArray = self._low[1] + (np.arange(count) + 0.5) * (self.width_m / count)
        return levels

    def track(self, count: int, inset_m: float, corner: tuple[int, int], left_out: int = 0) -> Track:
        """The lanes' pieces, shortened by up to the inset at both ends, from a corner: the shorter of two orders."""
        legs, lane, cell = self._legs(count, inset_m, left_out)
        place = self._corner(corner)
        orders = [_lane_by_lane(legs, lane, place)] if len(legs) else []
        if len(set(cell)) > 1:
            orders.append(_swept(legs, cell, place, self.water.detours))
        rough = [self.length(order) for order in orders]
        best = int(np.argmin(rough)) if orders else 0
        return Track(
            orders[best] if orders else legs,
            rough[best] if orders else np.inf,
            self.heading_rad,
            self.width_m / count,
            inset_m,
            corner,
        )

    def _legs(self, count: int, inset_m: float, left_out: int) -> tuple[FloatArray, list[int], list[int]]:
        """Shortened pieces in local metres (n, 2, 2), lane by lane, and the lane and the cell of each."""
        pieces, levels = self.pieces(count, left_out), self._levels(count)
        # A quarter of a piece at either end; more only where lanes end further in than they should.
        beyond = max(0.0, inset_m * count / self.width_m - INSET)
        most = 0.25 + 0.4 * min(beyond, DEEPEST - INSET)
        legs, lanes, cells = [], [], []
        for k, (spans, cell) in enumerate(zip(pieces, _cells(pieces), strict=True)):
            short = np.minimum(inset_m, most * (spans[:, 1] - spans[:, 0]))
            u = np.stack([spans[:, 0] + short, spans[:, 1] - short], axis=-1)
            legs += [np.stack([ends, [levels[k]] * 2], axis=-1) @ self._turn.T for ends in u]
            lanes += [k] * len(u)
            cells += cell
        return np.array(legs).reshape(-1, 2, 2), lanes, cells

    def nearest_corner(self) -> tuple[int, int]:
        """The corner of the box about the lanes that is nearest to the start."""
        away = [float(np.hypot(*(self._corner(corner) - self.water.start_m))) for corner in CORNERS]
        return CORNERS[int(np.argmin(away))]

    def _corner(self, corner: tuple[int, int]) -> FloatArray:
        """A corner of the box about the lanes, in local metres."""
        u = (self._low, self._high)[corner[1]][0]
        v = (self._low, self._high)[corner[0]][1]
        place: FloatArray = np.array([u, v]) @ self._turn.T
        return place

    def length(self, legs: FloatArray, *, fine: bool = False) -> float:
        """Rough length of the whole: the way to the first leg, all legs, the ways between, the way home."""
        water = self.water
        tails = np.concatenate([water.start_m[None], legs[:-1, 1]])
        heads = legs[:, 0]
        if water.home_m is not None:
            tails, heads = np.concatenate([tails, legs[-1:, 1]]), np.concatenate([heads, water.home_m[None]])
        along = np.hypot(*(legs[:, 1] - legs[:, 0]).T).sum()
        return float(along + water.detours.distances(tails, heads, fine=fine).sum())


def _cells(pieces: list[FloatArray]) -> list[list[int]]:
    """Lane by lane the number of the cell of each piece: pieces side by side, one to one, share a cell."""
    numbers: list[list[int]] = []
    fresh = 0
    before = np.empty((0, 2))
    for spans in pieces:
        overlap = (spans[:, None, 0] < before[None, :, 1]) & (spans[:, None, 1] > before[None, :, 0])
        own = []
        for k in range(len(spans)):
            beside = np.flatnonzero(overlap[k])
            if len(beside) == 1 and np.count_nonzero(overlap[:, beside[0]]) == 1:
                own.append(numbers[-1][beside[0]])
            else:
                own.append(fresh)
                fresh += 1
        numbers.append(own)
        before = spans
    return numbers


def _swept(legs: FloatArray, cell: list[int], corner: FloatArray, detours: Detours) -> FloatArray:
    """All legs (n, 2, 2) in sailing order: the cell nearest to where one is, swept from its nearest corner."""
    numbers = np.asarray(cell)
    ways = {number: list(_back_and_forth(legs[numbers == number])) for number in dict.fromkeys(cell)}
    here = corner
    ordered: list[FloatArray] = []
    while ways:
        starts = np.array([way[0, 0] for four in ways.values() for way in four])
        # The corner of the box need not be water.
        nearest = _nearest(here, starts, detours) if ordered else int(np.argmin(np.hypot(*(starts - here).T)))
        way = ways.pop(list(ways)[nearest // 4])[nearest % 4]
        ordered.append(way)
        here = way[-1, 1]
    return np.concatenate(ordered)


def _nearest(here: FloatArray, places: FloatArray, detours: Detours) -> int:
    """Which of the places (n, 2) is nearest over water; no way is shorter than the straight line."""
    straight = np.hypot(*(places - here).T)
    best, chosen = np.inf, int(np.argmin(straight))
    for k in np.argsort(straight, kind="stable").tolist():
        if straight[k] >= best:
            break
        length = float(detours.distances(here, places[k])[0])
        if length < best:
            best, chosen = length, k
    return chosen


def _lane_by_lane(legs: FloatArray, lane: list[int], corner: FloatArray) -> FloatArray:
    """All legs (n, 2, 2) in sailing order: every lane in full before the next, back and forth."""
    numbers = np.asarray(lane)
    lanes = [legs[numbers == number] for number in dict.fromkeys(lane)]
    middles = np.array([ends.mean(axis=(0, 1)) for ends in lanes[:: max(1, len(lanes) - 1)]])
    if np.argmin(np.hypot(*(middles - corner).T)) == 1:
        lanes.reverse()
    outer = np.array([lanes[0][0, 0], lanes[0][-1, 1]])
    backwards = np.argmin(np.hypot(*(outer - corner).T)) == 1
    return np.concatenate(
        [ends[::-1, ::-1] if (k % 2 == 1) != backwards else ends for k, ends in enumerate(lanes)]
    )


def _back_and_forth(legs: FloatArray) -> Iterator[FloatArray]:
    """The four ways to sweep a cell, each legs in sailing order (n, 2, 2)."""
    for lanes in (legs, legs[::-1]):
        for turned in (0, 1):
            way = lanes.copy()
            way[turned::2] = way[turned::2, ::-1]
            yield way
