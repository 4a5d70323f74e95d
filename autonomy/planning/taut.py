"""Pulling a way tight against the shore: from the raster's corners to those of the polygons themselves.

Where a way bends at c between a and b, the shortest way of the same kind from a to b (on the same side of every
island) is the convex hull of the shore's corners inside the triangle a c b, on c's side: nothing else can lie
between. Doing this bend by bend until nothing gets shorter is the rubber band of Hershberger and Snoeyink,
Computing minimum length paths of a given homotopy class (1994), without their triangulation.
"""

from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from autonomy.geometry import FloatArray

_MOST_PULLS = 5000
_ROUNDING = 0.02
"""Of the length there, what one corner less may cost at most."""
_INSET_M = 0.15
"""Ways keep this far inside the water where there is room: positions are sent in steps of a centimetre."""

_STRAIGHTENED_M = 1.0
"""Arcs and crinkles of the shore are cut by as much, on the water's side: every corner costs time."""

_INTO_LAND_M = 1e-3


class Shoreline:
    """The corners of some water that jut into it, the only places where a tight way bends.

    `water` is a little less than the water given: ways that are pulled tight must lie in it.
    """

    def __init__(self, water: BaseGeometry, cell_m: float) -> None:
        """Take the corners of `water`; ways were found on cells of `cell_m` metres."""
        off_m = min(_STRAIGHTENED_M, 0.01 * cell_m)
        inset = water.buffer(-off_m - min(_INSET_M, 0.005 * cell_m), join_style="mitre", mitre_limit=2.0)
        self.water = inset.simplify(off_m)
        corners, land = _jutting(self.water)
        # By x, so that those between two x are one slice.
        order = np.argsort(corners[:, 0], kind="stable")
        self._corners = corners[order]
        self._land = (corners + _INTO_LAND_M * land)[order]
        self._round_m = 0.05 * cell_m

    def tightened(self, way: FloatArray) -> FloatArray:
        """The way pulled tight, its ends and its sides of islands kept; shape (n, 2) to (k, 2).

        Each leg of the result lies in `water` if each of the given did. Ends may lie outside, so check them.
        """
        points, loose = list(way), [True] * len(way)
        k, pulls = 1, 0
        while k < len(points) - 1 and pulls < _MOST_PULLS:
            if not loose[k]:
                k += 1
                continue
            pulls += 1
            a, c, b = points[k - 1 : k + 2]
            loose[k] = False
            chain = _hull(a, b, self._within(a, c, b), _side(a, b, c))
            if len(chain) == 1 and (chain[0] == c).all():
                continue
            # What has been put in is tight; what it hangs between need not be any more.
            points[k : k + 1] = chain
            loose[k : k + 1] = [False] * len(chain)
            loose[k - 1] = loose[k + len(chain)] = True
            k = max(1, k - 1)
        return np.array(points)

    def _within(self, a: FloatArray, c: FloatArray, b: FloatArray) -> FloatArray:
        """Corners whose land is in the triangle; one on a leg may only touch it from outside."""
        low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
        first, last = np.searchsorted(self._corners[:, 0], [low[0], np.nextafter(high[0], np.inf)])
        y = self._corners[first:last, 1]
        near = first + np.flatnonzero((y >= low[1]) & (y <= high[1]))
        if not len(near):
            return np.empty((0, 2))
        land = self._land[near]
        turns = np.stack([_side(a, c, land), _side(c, b, land), _side(b, a, land)])
        inside = np.all(turns >= 0.0, axis=0) | np.all(turns <= 0.0, axis=0)
        return np.asarray(self._corners[near[inside]])

    def rounded(self, way: FloatArray) -> FloatArray:
        """A tight way with fewer corners for little length: short legs go, their neighbours are made to meet.

        The stand-off about a headland is an arc of many short legs, and nobody steers these. The new corners lie
        further out, where another shore may be: check the legs.
        """
        points = list(way)
        k = 1
        while k < len(points) - 2:
            before, a, b, after = points[k - 1 : k + 3]
            meet = _meeting(before, a, b, after)
            tight = _length(before, a, b, after)
            room = min(_ROUNDING * tight, self._round_m)
            if meet is not None and _length(before, meet, after) - tight < room:
                points[k : k + 2] = [meet]
            else:
                k += 1
        return np.array(points)


def _jutting(water: BaseGeometry) -> tuple[FloatArray, FloatArray]:
    """Corners at which the land is convex, shape (n, 2), and the directions from them into the land, (n, 2)."""
    found, directions = [np.empty((0, 2))], [np.empty((0, 2))]
    for part in shapely.get_parts(water):
        turned = orient(part, 1.0)
        for ring in (turned.exterior, *turned.interiors):
            xy = shapely.get_coordinates(ring)[:-1]
            before, after = np.roll(xy, 1, axis=0), np.roll(xy, -1, axis=0)
            # The water is on the left of every ring, so a turn to the right goes round land.
            juts = _side(before, xy, after) < 0.0
            into = _unit(before - xy)[juts] + _unit(after - xy)[juts]
            found.append(xy[juts])
            directions.append(_unit(into))
    return np.concatenate(found), np.concatenate(directions)


def _unit(vectors: FloatArray) -> FloatArray:
    length = np.hypot(*vectors.T)[:, None]
    return np.asarray(vectors / np.where(length > 0.0, length, 1.0))


def _hull(a: FloatArray, b: FloatArray, points: FloatArray, side: FloatArray) -> list[FloatArray]:
    """The hull of points on one side of a b, from a to b, without these two."""
    if not len(points):
        return []
    height = _side(a, b, points) * np.sign(side)
    farthest = int(np.argmax(height))
    if height[farthest] <= 1e-9 * float(np.sum((b - a) ** 2)):
        return []
    top, above = points[farthest], points[height > 0.0]
    return [*_hull(a, top, above, side), top, *_hull(top, b, above, side)]


def _meeting(before: FloatArray, a: FloatArray, b: FloatArray, after: FloatArray) -> FloatArray | None:
    """Where the legs before a and after b meet if both are made longer; None if they do not, or turn otherwise."""
    u, v = a - before, after - b
    turn = float(u[0] * v[1] - u[1] * v[0])
    first, second = _side(before, a, b), _side(a, b, after)
    # Both bends to one side, and less than a right angle in all.
    if float(first) * float(second) <= 0.0 or float(u @ v) <= 0.0 or turn == 0.0:
        return None
    share = float((b - a)[0] * v[1] - (b - a)[1] * v[0]) / turn
    meeting: FloatArray = a + share * u
    return meeting if share >= 0.0 else None


def _length(*points: FloatArray) -> float:
    return sum(float(np.hypot(*(q - p))) for p, q in pairwise(points))


def _side(a: FloatArray, b: FloatArray, points: FloatArray) -> FloatArray:
    """Twice the signed area of the triangles a b point: positive on the left of a → b."""
    u, v = b - a, points - a
    area: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return area
