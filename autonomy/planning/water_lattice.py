"""The water of a survey as some hundred equal cells, and the short legs between those that see each other."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from autonomy.geometry import FloatArray
from autonomy.planning.errors import Unreachable
from autonomy.planning.lattice_legs import legs_between, parts_of
from autonomy.planning.raster import BoolArray, IntArray
from autonomy.planning.survey import SurveyArea

__all__ = ["WaterLattice", "water_lattice_of"]

_CELLS = 690
_NEAR = 0.1
_PART = 0.01
"""A way is looked at in pieces of this share of √(water area), each of which lies in one cell."""


@dataclass(frozen=True, eq=False)
class WaterLattice:
    """Cells of a survey's water, N of them, and P short legs between the centres of navigable ones.

    Attributes:
        side_m: √(water area), the unit of lengths in planning.
        points_m: shape (N, 2), centres.
        shore: shape (N,), distance from land and keep-out as a share of the side; 1 at most.
        navigable: shape (N,), whether the vessel may be sent to the centre.
        leg_number: shape (N, N), symmetric: the leg between two centres; P where there is none, P + 1, which has
            length 0, on the diagonal.
        leg_length_m: shape (P + 2,).
        leg_cells: shape (P + 2, c): cells that each leg passes, padded with 0.
        leg_parts_m: shape (P + 2, c): how far through each of them; 0 in the padding.
        near: shape (N, k): other cells that a leg of at most .1 of the side leads to, padded.
        near_count: shape (N,): how many; the cell itself stands for none.
    """

    side_m: float
    points_m: FloatArray
    shore: FloatArray
    navigable: BoolArray
    leg_number: IntArray
    leg_length_m: FloatArray
    leg_cells: IntArray
    leg_parts_m: FloatArray
    near: IntArray
    near_count: IntArray
    _bends: dict[int, FloatArray] = field(repr=False)
    _tree: cKDTree = field(repr=False)
    _graph: csr_array = field(repr=False)

    def __len__(self) -> int:
        return len(self.points_m)

    @property
    def no_leg(self) -> int:
        """P, the number of no leg."""
        return len(self.leg_length_m) - 2

    def cells_at(self, points_m: ArrayLike) -> IntArray:
        """The cell nearest to each of points (n, 2), shape (n,)."""
        return np.asarray(
            self._tree.query(np.asarray(points_m, dtype=float).reshape(-1, 2))[1], dtype=np.intp
        )

    def distances_m(self, cell: int) -> FloatArray:
        """Lengths of the shortest ways along legs from one cell to all, shape (N,); inf where there is none."""
        return np.asarray(dijkstra(self._graph, indices=cell, directed=False))

    def path(self, a: int, b: int) -> list[int]:
        """The cells of the shortest way along legs from a to b, both included.

        Raises:
            Unreachable: there is none.
        """
        if self.leg_number[a, b] != self.no_leg:
            return [a, b]
        _, before = dijkstra(self._graph, indices=a, directed=False, return_predecessors=True)
        way = [b]
        while way[-1] != a:
            if before[way[-1]] < 0:
                raise Unreachable(f"no way along legs from cell {a} to cell {b} of the water")
            way.append(int(before[way[-1]]))
        return way[::-1]

    def readings(self, chain: ArrayLike, spacing_m: float) -> FloatArray:
        """Readings taken in each cell on a way through neighbouring cells of `chain`, shape (N,)."""
        cells = np.asarray(chain, dtype=np.intp)
        legs = self.leg_number[cells[:-1], cells[1:]]
        parts = np.bincount(self.leg_cells[legs].ravel(), self.leg_parts_m[legs].ravel(), len(self))
        return np.asarray(parts / spacing_m)

    def readings_along(self, corners_m: FloatArray, spacing_m: float) -> FloatArray:
        """The same on a polyline (k, 2) through anywhere."""
        _, cells, parts_m = parts_of(self._tree, [corners_m], _PART * self.side_m)
        return np.asarray(np.bincount(cells, parts_m / spacing_m, len(self)), dtype=float)

    def corners(self, chain: Sequence[int]) -> FloatArray:
        """The way through neighbouring cells of `chain`, their centres and bends between them, shape (k, 2)."""
        ways = [self.points_m[list(chain[:1])]]
        for a, b in pairwise(chain):
            bend = self._bends.get(int(self.leg_number[a, b]))
            if bend is not None:
                ways.append(bend if a < b else bend[::-1])
            ways.append(self.points_m[[b]])
        return np.concatenate(ways)


@lru_cache(maxsize=4)
def water_lattice_of(survey: SurveyArea) -> WaterLattice:
    """The survey's lattice, built once for each survey object."""
    side_m = float(np.sqrt(survey.area_m2))
    points = _centres(survey, side_m / np.sqrt(_CELLS))
    navigable = survey.is_navigable(points)
    legs = legs_between(survey, points, navigable, side_m)
    P, N = len(legs.ends), len(points)
    number = np.full((N, N), P, dtype=np.intp)
    number[legs.ends[:, 0], legs.ends[:, 1]] = number[legs.ends[:, 1], legs.ends[:, 0]] = np.arange(P)
    np.fill_diagonal(number, P + 1)
    near, near_count = _near(legs.ends[legs.length_m <= _NEAR * side_m], N)
    none = np.zeros((2, legs.cells.shape[1]))
    return WaterLattice(
        side_m=side_m,
        points_m=points,
        shore=shore_distance(survey, points),
        navigable=navigable,
        leg_number=number,
        leg_length_m=np.append(legs.length_m, none[:, 0]),
        leg_cells=np.concatenate([legs.cells, none.astype(np.intp)]),
        leg_parts_m=np.concatenate([legs.parts_m, none]),
        near=near,
        near_count=near_count,
        _bends=legs.bends,
        _tree=cKDTree(points),
        _graph=legs.graph(N),
    )


def shore_distance(survey: SurveyArea, points_m: FloatArray) -> FloatArray:
    """Distance of points (n, 2) from the shore and keep-out as a share of √(water area), 1 at most; shape (n,)."""
    edges = _edges_of(survey)
    if edges is None or not len(points_m):
        return np.ones(len(points_m))
    nearest, distance = edges.query_nearest(shapely.points(points_m), all_matches=False, return_distance=True)
    away_m = np.empty(len(points_m))
    away_m[nearest[0]] = distance
    return np.asarray(np.minimum(away_m / float(np.sqrt(survey.area_m2)), 1.0))


@lru_cache(maxsize=4)
def _edges_of(survey: SurveyArea) -> shapely.STRtree | None:
    """The straight pieces of the shore; None if there is none. A coast may have tens of thousands."""
    rings = shapely.get_rings(shapely.get_parts(survey.obstacles))
    if not len(rings):
        return None
    corners, ring = shapely.get_coordinates(rings, return_index=True)
    first = np.flatnonzero(ring[:-1] == ring[1:])
    return shapely.STRtree(shapely.linestrings(np.stack([corners[first], corners[first + 1]], axis=1)))


def _centres(survey: SurveyArea, step_m: float) -> FloatArray:
    """Centres of the square cells that lie in the water, west to east within south to north."""
    x_min, y_min, x_max, y_max = survey.bounds
    nx, ny = max(1, round((x_max - x_min) / step_m)), max(1, round((y_max - y_min) / step_m))
    x = x_min + (np.arange(nx) + 0.5) * ((x_max - x_min) / nx)
    y = y_min + (np.arange(ny) + 0.5) * ((y_max - y_min) / ny)
    centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    shapely.prepare(survey.water)
    inside: FloatArray = centres[shapely.contains_xy(survey.water, centres[:, 0], centres[:, 1])]
    return inside


def _near(pairs: IntArray, cells: int) -> tuple[IntArray, IntArray]:
    """`near` and `near_count`."""
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    count = np.bincount(both[:, 0], minlength=cells)
    near = np.tile(np.arange(cells)[:, None], (1, max(1, int(count.max(initial=0)))))
    near[both[:, 0], np.arange(len(both)) - np.searchsorted(both[:, 0], both[:, 0])] = both[:, 1]
    return near, np.maximum(count, 1)
