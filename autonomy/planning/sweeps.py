"""Lawnmowers: back and forth over all the water, as a survey team would sail it.

Lanes of equal spacing (`autonomy.planning.lanes`), as many as fit a length or as close as is asked for. Ways between
them go round the land, and count.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from math import atan2, pi

import numpy as np
import shapely
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray, path_length_m
from autonomy.planning.errors import PlanningError, Unreachable
from autonomy.planning.lanes import CORNERS, DEEPEST, INSET, Lanes, Track, Water
from autonomy.planning.raster import BoolArray
from autonomy.planning.survey import SurveyArea

_BISECTIONS = 6
_CORRECTIONS = 4
_USED = 0.98
"""Of the length; a sweep that uses so much is good enough."""

_FINE = 1.03
"""Of the length; a fine length is at most by so much too long, or the true one is not asked for."""

_SPENT = 0.93
"""Of the length; if lanes cannot go out so far, one or two more are tried, whose ends stay further in."""

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
    water = Water(survey, np.asarray(start_m, dtype=float).reshape(2), home_m)
    found = []
    for heading in headings(survey) if headings_rad is None else headings_rad:
        lanes = Lanes(water, heading)
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
    water = Water(survey, np.asarray(start_m, dtype=float).reshape(2), None)
    found = []
    for heading in headings(survey) if headings_rad is None else headings_rad:
        lanes = Lanes(water, heading)
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


def _fitted(lanes: Lanes, length_m: float, corners: Sequence[tuple[int, int]]) -> list[Sweep]:
    """The densest sweeps from each corner that fit."""
    most = _most_lanes(lanes, length_m)
    found = [_fitted_from(lanes, length_m, most, corner) for corner in corners]
    return [sweep for sweep in found if sweep is not None]


def _fitted_from(lanes: Lanes, length_m: float, most: int, corner: tuple[int, int]) -> Sweep | None:
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


def _densest(lanes: Lanes, corner: tuple[int, int], rough_m: float, most: int) -> Track | None:
    """The most lanes, up to a few more than `most`, that fit if they end half a spacing before the water does."""
    fitting = None
    for count in range(most + _TRIED_BEYOND, 0, -1):
        if lanes.track(count, INSET * lanes.width_m / count, corner).rough_m <= rough_m:
            fitting = _outwards(lanes, count, corner, rough_m, INSET)
            break
    fewest = 1 if fitting is None else round(lanes.width_m / fitting.spacing_m) + 1
    for count in range(fewest, fewest + _TRIED_BEYOND):
        if fitting is not None and fitting.rough_m >= _SPENT * rough_m:
            break
        closer = _crammed(lanes, corner, rough_m, count)
        if closer is not None and (fitting is None or closer.rough_m > fitting.rough_m):
            fitting = closer
    return fitting


def _crammed(lanes: Lanes, corner: tuple[int, int], rough_m: float, count: int) -> Track | None:
    """So many lanes, made to fit: their ends stay far in, and of their pieces the shortest may be left out."""
    inset_m = DEEPEST * lanes.width_m / count
    low, high = -1, sum(len(spans) for spans in lanes.pieces(count))
    while high - low > 1:
        middle = (low + high) // 2
        fits = lanes.track(count, inset_m, corner, middle).rough_m <= rough_m
        low, high = (low, middle) if fits else (middle, high)
    if not np.isfinite(lanes.track(count, inset_m, corner, high).rough_m):
        return None
    return _outwards(lanes, count, corner, rough_m, DEEPEST, high)


def _most_lanes(lanes: Lanes, length_m: float) -> int:
    """About how many lanes fit: found by bisection, from the first corner."""
    low, high = 0, 2
    while high < _LARGEST_LANES and _rough_m(lanes, high) <= length_m:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        fits = _rough_m(lanes, middle) <= length_m
        low, high = (middle, high) if fits else (low, middle)
    return low


def _rough_m(lanes: Lanes, count: int) -> float:
    return lanes.track(count, INSET * lanes.width_m / count, CORNERS[0]).rough_m


def _outwards(
    lanes: Lanes, count: int, corner: tuple[int, int], length_m: float, share: float, left_out: int = 0
) -> Track:
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


def _sailed(lanes: Lanes, track: Track) -> Sweep:
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


def _way_home_m(water: Water, sweep: Sweep) -> float:
    if water.home_m is None:
        return 0.0
    return path_length_m(water.passage.path(sweep.route_m[-1], water.home_m))
