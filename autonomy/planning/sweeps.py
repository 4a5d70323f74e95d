"""Lawnmowers: back and forth over all the water, as a survey team would sail it.

Lanes of equal spacing are clipped to the navigable water that the vessel can reach; the pieces that lie side by side
form cells, each is swept back and forth, and the nearest cell not yet swept comes next (boustrophedon cellular
decomposition, Choset 2000). Ways between pieces go round the land, and count.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import atan2, cos, pi, sin

import numpy as np
import shapely
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray, path_length_m
from autonomy.planning.detours import Detours
from autonomy.planning.errors import PlanningError, Unreachable
from autonomy.planning.passage import Passage, passage_of
from autonomy.planning.raster import BoolArray
from autonomy.planning.survey import SurveyArea

CORNERS = ((0, 0), (0, 1), (1, 0), (1, 1))
"""Where a sweep starts: at the (first, last) lane's (near, far) end, seen along the heading."""

_SHORTEST = 0.5
"""Of the spacing: shorter pieces of a lane are left out, its neighbours see what is there."""

_BISECTIONS = 6
_CORRECTIONS = 4
_USED = 0.98
"""Of the length; a sweep that uses so much is good enough."""

_FINE = 1.03
"""Of the length; a fine length is at most by so much too long, or the true one is not asked for."""

_SPENT = 0.93
"""Of the length; if lanes cannot go out so far, one or two more are tried, whose ends stay further in."""

_INSET, _DEEPEST = 0.5, 1.0
"""Of the spacing: by how much lanes end before the water does while their number is looked for, and at most."""

_TRIED_BEYOND = 2
"""Round islands one lane more is not always longer; nor are all corners equally far."""

_LARGEST_LANES = 400


@dataclass(frozen=True, eq=False)
class Sweep:
    """A cover of the water by parallel lanes.

    Attributes:
        route_m: shape (k, 2), its corners in sailing order, the start excluded.
        is_lane_end: shape (k,), bool: which corners begin or end a lane's piece (the others only round the land).
        length_m: from the start to the last corner.
        approach_m: of which from the start to the first lane.
        heading_rad: direction of the lanes, counter-clockwise from east.
        spacing_m: between lanes.
        inset_m: by how much lanes end before the edge of the water, where they are long enough.
        corner: one of `CORNERS`.
    """

    route_m: FloatArray
    is_lane_end: BoolArray
    length_m: float
    approach_m: float
    heading_rad: float
    spacing_m: float
    inset_m: float
    corner: tuple[int, int]


def lawnmowers(
    survey: SurveyArea,
    start_m: ArrayLike,
    length_m: float,
    *,
    home_m: ArrayLike | None = None,
    headings_rad: Sequence[float] | None = None,
    nearest_corner: bool = False,
) -> list[Sweep]:
    """The densest sweeps that fit a length: one for each heading and each corner to start from.

    Every sweep is one cover of the water that can be reached. The way to its first lane counts; so does the way home
    from its end, if `home_m` is given. As many lanes are taken as fit if they end half a spacing before the water does;
    then their ends go out as far as the length allows.

    Args:
        survey: the water.
        start_m: shape (2,), where the vessel is.
        length_m: what may be sailed.
        home_m: shape (2,), where it must be able to get within the length; None: the sweep may end anywhere.
        headings_rad: of the lanes, counter-clockwise from east; None: along both sides of the area.
        nearest_corner: only from the corner nearest to the start, in a fraction of the time.

    Returns:
        The sweeps that fit, heading by heading; none if the length is too short for a single lane.

    Raises:
        PlanningError: no navigable water can be reached from the start.
    """
    water = _Water(survey, np.asarray(start_m, dtype=float).reshape(2), home_m)
    found = []
    for heading in headings(survey) if headings_rad is None else headings_rad:
        lanes = _Lanes(water, heading)
        found += _fitted(lanes, length_m, [lanes.nearest_corner()] if nearest_corner else CORNERS)
    return found


def sweeps(
    survey: SurveyArea,
    start_m: ArrayLike,
    spacing_m: float,
    *,
    headings_rad: Sequence[float] | None = None,
    nearest_corner: bool = False,
) -> list[Sweep]:
    """Sweeps whose lanes are at most `spacing_m` apart, one for each heading and corner; else as `lawnmowers`.

    Raises:
        PlanningError: no navigable water can be reached from the start, or none is wide enough for a lane.
    """
    water = _Water(survey, np.asarray(start_m, dtype=float).reshape(2), None)
    found = []
    for heading in headings(survey) if headings_rad is None else headings_rad:
        lanes = _Lanes(water, heading)
        count = max(1, min(_LARGEST_LANES, int(np.ceil(lanes.width_m / spacing_m - 1e-9))))
        corners = [lanes.nearest_corner()] if nearest_corner else CORNERS
        while not any(len(spans) for spans in lanes.pieces(count)):
            # All lanes lie over land, or next to it; closer ones do not all.
            if count > _LARGEST_LANES:
                raise PlanningError(f"no lane of {count} fits into the water, {lanes.width_m:.0f} m wide")
            count *= 2
        for corner in corners:
            with suppress(Unreachable):
                found.append(_sailed(lanes, lanes.track(count, 0.0, corner)))
    if not found:
        raise PlanningError("every lane has an end that no way over water leads to")
    return found


def headings(survey: SurveyArea) -> tuple[float, float]:
    """Directions of the two sides of the smallest rectangle about the survey's area, in [0, π), longer side first."""
    box = shapely.oriented_envelope(survey.ground)
    corners = shapely.get_coordinates(box)
    sides = np.diff(corners[:3], axis=0)
    sides = sides[np.argsort(-np.hypot(*sides.T), kind="stable")]
    first, second = (atan2(dy, dx) % pi for dx, dy in sides.tolist())
    return first, second


class _Water:
    """What all sweeps of one request share."""

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
class _Track:
    """Pieces of lanes in sailing order, shape (n, 2, 2), each from its start to its end."""

    legs: FloatArray
    rough_m: float
    heading_rad: float
    spacing_m: float
    inset_m: float
    corner: tuple[int, int]


class _Lanes:
    """Lanes in one direction. In their own frame (u along, v across) a lane is a level of v."""

    def __init__(self, water: _Water, heading_rad: float) -> None:
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

    def track(self, count: int, inset_m: float, corner: tuple[int, int], left_out: int = 0) -> _Track:
        """The lanes' pieces, shortened by up to the inset at both ends, from a corner: the shorter of two orders."""
        legs, lane, cell = self._legs(count, inset_m, left_out)
        place = self._corner(corner)
        orders = [_lane_by_lane(legs, lane, place)] if len(legs) else []
        if len(set(cell)) > 1:
            orders.append(_swept(legs, cell, place, self.water.detours))
        rough = [self.length(order) for order in orders]
        best = int(np.argmin(rough)) if orders else 0
        return _Track(
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
        beyond = max(0.0, inset_m * count / self.width_m - _INSET)
        most = 0.25 + 0.4 * min(beyond, _DEEPEST - _INSET)
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


def _fitted(lanes: _Lanes, length_m: float, corners: Sequence[tuple[int, int]]) -> list[Sweep]:
    """The densest sweeps from each corner that fit."""
    most = _most_lanes(lanes, length_m)
    found = [_fitted_from(lanes, length_m, most, corner) for corner in corners]
    return [sweep for sweep in found if sweep is not None]


def _fitted_from(lanes: _Lanes, length_m: float, most: int, corner: tuple[int, int]) -> Sweep | None:
    """What is searched with coarse lengths is corrected by fine ones, and these by the true one."""
    best: Sweep | None = None
    coarse_m = length_m
    for _ in range(_CORRECTIONS):
        track = _densest(lanes, corner, coarse_m, most)
        if track is None:
            break
        whole_m = lanes.length(track.legs, fine=True)
        if whole_m <= _FINE * length_m:
            try:
                sweep = _sailed(lanes, track)
                whole_m = sweep.length_m + _way_home_m(lanes.water, sweep)
            except Unreachable:
                # A lane's middle can be reached and its end, in a pocket of the shore, can not: other lanes may do.
                coarse_m *= _USED
                continue
            if whole_m <= length_m and (best is None or _denser(sweep, best)):
                best = sweep
        if _USED * length_m <= whole_m <= length_m:
            break
        coarse_m = track.rough_m * 0.999 * length_m / whole_m
    return best


def _denser(sweep: Sweep, other: Sweep) -> bool:
    return (sweep.spacing_m, sweep.inset_m) < (other.spacing_m, other.inset_m)


def _densest(lanes: _Lanes, corner: tuple[int, int], rough_m: float, most: int) -> _Track | None:
    """The most lanes, up to a few more than `most`, that fit if they end half a spacing before the water does."""
    fitting = None
    for count in range(most + _TRIED_BEYOND, 0, -1):
        if lanes.track(count, _INSET * lanes.width_m / count, corner).rough_m <= rough_m:
            fitting = _outwards(lanes, count, corner, rough_m, _INSET)
            break
    fewest = 1 if fitting is None else round(lanes.width_m / fitting.spacing_m) + 1
    for count in range(fewest, fewest + _TRIED_BEYOND):
        if fitting is not None and fitting.rough_m >= _SPENT * rough_m:
            break
        closer = _crammed(lanes, corner, rough_m, count)
        if closer is not None and (fitting is None or closer.rough_m > fitting.rough_m):
            fitting = closer
    return fitting


def _crammed(lanes: _Lanes, corner: tuple[int, int], rough_m: float, count: int) -> _Track | None:
    """So many lanes, made to fit: their ends stay far in, and of their pieces the shortest may be left out."""
    inset_m = _DEEPEST * lanes.width_m / count
    low, high = -1, sum(len(spans) for spans in lanes.pieces(count))
    while high - low > 1:
        middle = (low + high) // 2
        fits = lanes.track(count, inset_m, corner, middle).rough_m <= rough_m
        low, high = (low, middle) if fits else (middle, high)
    if not np.isfinite(lanes.track(count, inset_m, corner, high).rough_m):
        return None
    return _outwards(lanes, count, corner, rough_m, _DEEPEST, high)


def _most_lanes(lanes: _Lanes, length_m: float) -> int:
    """About how many lanes fit: found by bisection, from the first corner."""
    low, high = 0, 2
    while high < _LARGEST_LANES and _rough_m(lanes, high) <= length_m:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        fits = _rough_m(lanes, middle) <= length_m
        low, high = (middle, high) if fits else (low, middle)
    return low


def _rough_m(lanes: _Lanes, count: int) -> float:
    return lanes.track(count, _INSET * lanes.width_m / count, CORNERS[0]).rough_m


def _outwards(
    lanes: _Lanes, count: int, corner: tuple[int, int], length_m: float, share: float, left_out: int = 0
) -> _Track:
    """Lanes with the smallest inset at which they fit, given that they do with this share of the spacing."""
    low, high = 0.0, share * lanes.width_m / count
    fitting = lanes.track(count, low, corner, left_out)
    if fitting.rough_m <= length_m:
        return fitting
    fitting = lanes.track(count, high, corner, left_out)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        track = lanes.track(count, middle, corner, left_out)
        if track.rough_m <= length_m:
            high, fitting = middle, track
        else:
            low = middle
    return fitting


def _sailed(lanes: _Lanes, track: _Track) -> Sweep:
    """A track with the true ways between its legs."""
    water = lanes.water
    tails = np.concatenate([water.start_m[None], track.legs[:-1, 1]])
    clear = water.survey.legs_are_clear(tails, track.legs[:, 0])
    corners, marks = [], []
    for here, (a, b), straight in zip(tails, track.legs, clear.tolist(), strict=True):
        way = a[None] if straight else water.passage.path(here, a)[1:]
        corners += [way, b[None]]
        marks += [np.arange(len(way)) == len(way) - 1, [True]]
    route = np.concatenate(corners)
    return Sweep(
        route,
        np.concatenate(marks),
        length_m=path_length_m(np.concatenate([water.start_m[None], route])),
        approach_m=path_length_m(np.concatenate([water.start_m[None], corners[0]])),
        heading_rad=track.heading_rad,
        spacing_m=track.spacing_m,
        inset_m=track.inset_m,
        corner=track.corner,
    )


def _way_home_m(water: _Water, sweep: Sweep) -> float:
    if water.home_m is None:
        return 0.0
    return path_length_m(water.passage.path(sweep.route_m[-1], water.home_m))
