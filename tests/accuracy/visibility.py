"""Exact shortest ways among polygons, and an exact check of legs: nothing of the planner's own, no raster.

The visibility graph of Lozano-Pérez and Wesley (1979): shortest ways bend only at convex corners of obstacles,
and only where they are tangent to them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

_BLOCK = 400


@dataclass(frozen=True)
class VisibilityGraph:
    """Of one water polygon or several, metres.

    `tolerance_m`: by so much a leg may leave the water; it makes legs along shores visible, and shortens a way
    by about as much a corner at most.
    """

    water: BaseGeometry
    tolerance_m: float = 1e-3

    @cached_property
    def _corners(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Corners at which ways can bend, and the corners before and after them: each (n, 2)."""
        here, before, after = [], [], []
        for part in shapely.get_parts(self.water):
            part = orient(part, 1.0)
            for ring in (part.exterior, *part.interiors):
                xy = shapely.get_coordinates(ring)[:-1]
                b, a = np.roll(xy, 1, axis=0), np.roll(xy, -1, axis=0)
                # Water is on the left of every ring: a turn to the right juts into it.
                juts = _cross(xy - b, a - xy) < 0.0
                here.append(xy[juts])
                before.append(b[juts])
                after.append(a[juts])
        return np.concatenate(here), np.concatenate(before), np.concatenate(after)

    @cached_property
    def _tolerant(self) -> BaseGeometry:
        grown = self.water.buffer(self.tolerance_m, join_style="mitre")
        shapely.prepare(grown)
        return grown

    def _tangent(self, points: FloatArray) -> BoolArray:
        """(m, n): whether the line from a point touches a corner without running into the land behind it."""
        here, before, after = self._corners
        ray = here[None] - points[:, None]
        scale = np.hypot(ray[..., 0], ray[..., 1]) * 1e-9
        s = _cross(ray, (before - here)[None])
        t = _cross(ray, (after - here)[None])
        return ((s >= -scale) & (t >= -scale)) | ((s <= scale) & (t <= scale))

    def _visible(self, starts: FloatArray, ends: FloatArray) -> BoolArray:
        seen: BoolArray = shapely.covers(
            self._tolerant, shapely.linestrings(np.stack([starts, ends], axis=1))
        )
        return seen

    @cached_property
    def _graph(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pairs of corners that see each other and are tangent both ways."""
        here = self._corners[0]
        tangent = np.concatenate([self._tangent(here[k : k + _BLOCK]) for k in range(0, len(here), _BLOCK)])
        i, j = np.nonzero(np.triu(tangent & tangent.T, 1))
        seen = np.concatenate(
            [
                self._visible(here[i[k : k + 100_000]], here[j[k : k + 100_000]])
                for k in range(0, max(1, len(i)), 100_000)
            ]
        )
        return i[seen], j[seen]

    def distances(self, points: FloatArray) -> FloatArray:
        """Lengths of the shortest ways between points in the water, (m, m); inf where there is none."""
        here = self._corners[0]
        m = len(points)
        a, b = np.triu_indices(m, 1)
        direct = self._visible(points[a], points[b])
        p, c = np.nonzero(self._tangent(points))
        seen = self._visible(points[p], here[c])
        i, j = self._graph
        tails = np.concatenate([a[direct], p[seen], i + m])
        heads = np.concatenate([b[direct], c[seen] + m, j + m])
        nodes = np.concatenate([points, here])
        # Touching corners of different rings lie in one place: no length is an edge of no length.
        lengths = np.maximum(np.hypot(*(nodes[heads] - nodes[tails]).T), 1e-9)
        graph = csr_array((lengths, (tails, heads)), shape=(len(nodes), len(nodes)))
        found: FloatArray = dijkstra(graph, directed=False, indices=np.arange(m))[:, :m]
        return found


@dataclass(frozen=True)
class Shore:
    """Edges of polygons, for the distance of legs from them: plain arithmetic on coordinates.

    `a`, `b`: (n, 2), ends of the edges.
    """

    a: FloatArray
    b: FloatArray

    @classmethod
    def of(cls, shape: BaseGeometry) -> "Shore":
        rings = [
            shapely.get_coordinates(ring)
            for part in shapely.get_parts(shape)
            for ring in (part.exterior, *part.interiors)
        ]
        return cls(
            np.concatenate([np.empty((0, 2)), *(ring[:-1] for ring in rings)]),
            np.concatenate([np.empty((0, 2)), *(ring[1:] for ring in rings)]),
        )

    def contains(self, points: FloatArray) -> BoolArray:
        """(m,): whether points lie inside, by counting the edges north of them (even–odd)."""
        odd = np.zeros(len(points), dtype=bool)
        for k in range(0, len(points), _BLOCK):
            x, y = points[k : k + _BLOCK, 0, None], points[k : k + _BLOCK, 1, None]
            spans = (self.a[:, 0] <= x) != (self.b[:, 0] <= x)
            run = self.b[:, 0] - self.a[:, 0]
            share = (x - self.a[:, 0]) / np.where(run == 0.0, 1.0, run)
            above = self.a[:, 1] + share * (self.b[:, 1] - self.a[:, 1]) > y
            odd[k : k + _BLOCK] = np.count_nonzero(spans & above, axis=1) % 2 == 1
        return odd

    def clearance(self, starts: FloatArray, ends: FloatArray, reach_m: float) -> FloatArray:
        """(m,): least distance of every leg to an edge, 0 if they cross; not looked for beyond `reach_m`."""
        found = np.full(len(starts), np.inf)
        low, high = np.minimum(self.a, self.b) - reach_m, np.maximum(self.a, self.b) + reach_m
        for k, (p, q) in enumerate(zip(starts, ends, strict=True)):
            near = np.all((low <= np.maximum(p, q)) & (high >= np.minimum(p, q)), axis=1)
            if near.any():
                found[k] = _distance(p, q, self.a[near], self.b[near]).min()
        return found


def _distance(p: FloatArray, q: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances of one segment to many: 0 where they cross, else an end of one to the other."""
    crosses = (_cross(q - p, a - p) * _cross(q - p, b - p) <= 0.0) & (
        _cross(b - a, p - a) * _cross(b - a, q - a) <= 0.0
    )
    # Four collinear points cross by these signs though they may lie apart: their ends decide.
    flat = (_cross(q - p, a - p) == 0.0) & (_cross(q - p, b - p) == 0.0)
    ends = np.minimum.reduce(
        [_to_segment(p, a, b), _to_segment(q, a, b), _to_segment(a, p, q), _to_segment(b, p, q)]
    )
    return np.where(crosses & ~flat, 0.0, ends)


def _to_segment(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    along = b - a
    squared = np.maximum(np.sum(along * along, axis=-1), 1e-300)
    share = np.clip(np.sum((point - a) * along, axis=-1) / squared, 0.0, 1.0)
    nearest = a + share[..., None] * along
    distance: FloatArray = np.hypot(*np.moveaxis(point - nearest, -1, 0))
    return distance


def _cross(u: FloatArray, v: FloatArray) -> FloatArray:
    area: FloatArray = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return area
