"""The water of a survey as some hundred equal cells, and the short legs between those that see each other."""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import shapely
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from autonomy.geometry import FloatArray
from autonomy.planning.errors import Unreachable
from autonomy.planning.raster import BoolArray, IntArray
from autonomy.planning.survey import SurveyArea

__all__ = ["WaterLattice", "water_lattice_of"]

_CELLS = 690
_LONGEST_LEG = 0.16
"""Of √(water area)."""
_NEAR = 0.1
_PARTS = 16
"""Points of a leg that are asked which cell they lie in."""


@dataclass(frozen=True, eq=False)
class WaterLattice:
    """Cells of a survey's water, N of them, and P short straight legs between the centres of navigable ones.

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
        starts, steps = corners_m[:-1], np.diff(corners_m, axis=0)
        count = np.maximum(1, np.ceil(np.hypot(*steps.T) / (0.25 * _LONGEST_LEG * self.side_m / 4))).astype(
            int
        )
        leg = np.repeat(np.arange(len(starts)), count)
        place = np.concatenate([(np.arange(n) + 0.5) / n for n in count]) if len(count) else np.empty(0)
        cells = self.cells_at(starts[leg] + place[:, None] * steps[leg])
        parts_m: FloatArray = np.hypot(*steps[leg].T) / count[leg]
        return np.asarray(np.bincount(cells, parts_m / spacing_m, len(self)), dtype=float)


@lru_cache(maxsize=4)
def water_lattice_of(survey: SurveyArea) -> WaterLattice:
    """The survey's lattice, built once for each survey object."""
    side_m = float(np.sqrt(survey.area_m2))
    points = _centres(survey, side_m / np.sqrt(_CELLS))
    navigable = survey.is_navigable(points)
    tree = cKDTree(points)
    pairs = tree.query_pairs(_LONGEST_LEG * side_m, output_type="ndarray")
    pairs = pairs[navigable[pairs].all(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    pairs = pairs[survey.legs_are_clear(points[pairs[:, 0]], points[pairs[:, 1]])]
    lengths = np.hypot(*(points[pairs[:, 1]] - points[pairs[:, 0]]).T)
    number = np.full((len(points), len(points)), len(pairs), dtype=np.intp)
    number[pairs[:, 0], pairs[:, 1]] = number[pairs[:, 1], pairs[:, 0]] = np.arange(len(pairs))
    np.fill_diagonal(number, len(pairs) + 1)
    near, near_count = _near(pairs[lengths <= _NEAR * side_m], len(points))
    cells, parts = _passed(tree, points[pairs[:, 0]], points[pairs[:, 1]], lengths)
    graph = csr_array((lengths, (pairs[:, 0], pairs[:, 1])), shape=number.shape)
    return WaterLattice(
        side_m,
        points,
        shore_distance(survey, points),
        navigable,
        number,
        np.append(lengths, [0.0, 0.0]),
        cells,
        parts,
        near,
        near_count,
        tree,
        graph,
    )


def shore_distance(survey: SurveyArea, points_m: FloatArray) -> FloatArray:
    """Distance of points (n, 2) from land and keep-out as a share of √(water area), 1 at most; shape (n,)."""
    side_m = float(np.sqrt(survey.area_m2))
    if survey.obstacles.is_empty:
        return np.ones(len(points_m))
    shapely.prepare(survey.obstacles)
    distance: FloatArray = shapely.distance(shapely.points(points_m), survey.obstacles)
    return np.minimum(distance / side_m, 1.0)


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


def _passed(
    tree: cKDTree, starts: FloatArray, ends: FloatArray, lengths: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Cells that each leg passes and how far, both (P + 2, c); none in the last rows."""
    P, N = len(starts), tree.n
    share = (np.arange(_PARTS) + 0.5) / _PARTS
    places = starts[:, None] + share[:, None] * (ends - starts)[:, None]
    at = np.asarray(tree.query(places.reshape(-1, 2))[1], dtype=np.intp).reshape(P, _PARTS)
    key, count = np.unique((np.arange(P)[:, None] * N + at).ravel(), return_counts=True)
    leg, cell = np.divmod(key, N)
    slot = np.arange(len(key)) - np.searchsorted(leg, leg)
    width = int(slot.max(initial=0)) + 1
    cells, parts = np.zeros((P + 2, width), dtype=np.intp), np.zeros((P + 2, width))
    cells[leg, slot] = cell
    parts[leg, slot] = count / _PARTS * lengths[leg]
    return cells, parts
