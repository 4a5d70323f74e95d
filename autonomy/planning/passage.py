"""Shortest ways over water.

Dijkstra's algorithm on the raster's 16-neighbour graph gives a way between two cells; string pulling then
takes out the corners that the graph has put in, where the straight line touches passable cells only. Every
leg found this way is over navigable water because all cells it touches are, not because sampled points are.
Cells that are water in part have points in the graph too, whose legs were tested against the polygons.
At last the way is pulled tight against the polygons themselves, and its legs are checked against them.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from autonomy.geometry import FloatArray, path_length_m
from autonomy.planning.errors import Unreachable
from autonomy.planning.raster import BoolArray, IntArray, Raster
from autonomy.planning.shore_cells import with_shore_cells
from autonomy.planning.survey import SurveyArea
from autonomy.planning.taut import Shoreline

__all__ = ["Passage", "Unreachable", "Ways", "passage_of"]

_JOINS_TRIED = (16, 256, 2048)
"""How many of the nearest passable cells are tried for a point that lies in none, in widening rounds."""

_CORNERS = 16
"""At most this many points of a way take part in string pulling; its cost grows with their square."""


@dataclass(frozen=True, eq=False)
class Ways:
    """Ways over water between all pairs of some points.

    Attributes:
        points_m: shape (n, 2).
        distances_m: shape (n, n), symmetric: lengths of the ways; inf where there is none, 0 on the diagonal.
    """

    points_m: FloatArray
    distances_m: FloatArray
    _polylines: dict[tuple[int, int], FloatArray]

    def path(self, i: int, j: int) -> FloatArray:
        """The way from point i to point j, both ends included, shape (k, 2).

        Raises:
            Unreachable: there is none.
        """
        if not np.isfinite(self.distances_m[i, j]):
            raise Unreachable(f"no way over navigable water from {_place(self, i)} to {_place(self, j)}")
        if i > j:
            return self.path(j, i)[::-1].copy()
        straight = np.stack([self.points_m[i], self.points_m[j]])
        return self._polylines.get((i, j), straight).copy()


def _place(ways: Ways, i: int) -> str:
    x, y = ways.points_m[i]
    return f"({x:.0f} m east, {y:.0f} m north)"


class Passage:
    """The passable cells of a survey and the ways between them; built in less than a second at 200 × 200.

    A point in no passable cell (close to a shore, or a vessel outside navigable water) is joined to the
    nearest node that a clear leg leads to. Two points are connected if their nodes are: a channel that winds
    within a cell may be closed here; `passage_cells` sets the fineness.
    """

    def __init__(self, survey: SurveyArea) -> None:
        self._survey = survey
        self._raster = Raster.of(survey)
        self._shore = Shoreline(survey.navigable, survey.span_m / survey.passage_cells)
        self._centres, self._graph = with_shore_cells(self._shore.water, self._raster, self._raster.graph())
        self._basin = connected_components(self._graph, directed=False)[1]
        self._tree = cKDTree(self._centres) if len(self._centres) else None

    @property
    def raster(self) -> Raster:
        """The cells; read only."""
        return self._raster

    @property
    def nodes_m(self) -> FloatArray:
        """Centres of the passable cells, then points in those that are water in part, shape (n, 2); read only."""
        return self._centres

    @property
    def graph(self) -> csr_array:
        """Distances in metres between neighbouring nodes, symmetric; read only."""
        return self._graph

    def path(self, a: ArrayLike, b: ArrayLike) -> FloatArray:
        """The way from a to b, both included, shape (k, 2).

        Raises:
            Unreachable: there is none.
        """
        return self.ways(np.array([a, b], dtype=float)).path(0, 1)

    def distances(self, points_m: ArrayLike) -> FloatArray:
        """Lengths in metres of the ways between points (n, 2): shape (n, n), inf where there is none."""
        return self.ways(points_m).distances_m

    def reachable(self, start_m: ArrayLike, points_m: ArrayLike) -> BoolArray:
        """Which points, shape (n, 2), a vessel at `start_m` can reach; shape (n,)."""
        start = self.cells_of(np.asarray(start_m, dtype=float).reshape(1, 2))[0]
        cells = self.cells_of(np.asarray(points_m, dtype=float).reshape(-1, 2))
        if start < 0:
            return np.zeros(len(cells), dtype=bool)
        there: BoolArray = (cells >= 0) & (self._basin[cells] == self._basin[start])
        return there

    def ways(self, points_m: ArrayLike) -> Ways:
        """All ways between points of shape (n, 2)."""
        points = np.asarray(points_m, dtype=float).reshape(-1, 2)
        cells = self.cells_of(points)
        first, second = np.triu_indices(len(points), 1)
        connected = (cells[first] >= 0) & (cells[second] >= 0)
        connected &= self._basin[cells[first]] == self._basin[cells[second]]
        first, second = first[connected], second[connected]
        straight = self._survey.legs_are_clear(points[first], points[second])
        # Even outside navigable water there is nothing to sail between equal points.
        straight |= np.all(points[first] == points[second], axis=1)
        distances = np.full((len(points), len(points)), np.inf)
        np.fill_diagonal(distances, 0.0)
        i, j = first[straight], second[straight]
        distances[i, j] = distances[j, i] = np.hypot(*(points[i] - points[j]).T)
        polylines = self._bent(points, cells, first[~straight], second[~straight])
        for (a, b), polyline in polylines.items():
            distances[a, b] = distances[b, a] = path_length_m(polyline)
        return Ways(points, distances, polylines)

    def _bent(
        self, points: FloatArray, cells: IntArray, first: IntArray, second: IntArray
    ) -> dict[tuple[int, int], FloatArray]:
        """Ways between the pairs that have no clear leg."""
        if not len(first):
            return {}
        sources, which = np.unique(cells[first], return_inverse=True)
        _, before = dijkstra(self._graph, directed=True, indices=sources, return_predecessors=True)
        outside = self._raster.numbers_at(points) < 0
        bent = {}
        for i, j, source in zip(first.tolist(), second.tolist(), which.tolist(), strict=True):
            cells_on_way = _chain(before[source], int(cells[i]), int(cells[j]))
            way, clear = self._sights(cells_on_way, points[[i, j]], outside[[i, j]])
            lengths = np.hypot(*(way[:, None] - way[None]).transpose(2, 0, 1))
            bent[i, j] = way[_shortest(np.where(clear, lengths, np.inf))]
        return self._tight(bent)

    def _tight(self, bent: dict[tuple[int, int], FloatArray]) -> dict[tuple[int, int], FloatArray]:
        """The ways pulled tight and rounded, or tight, or as they are: the first of these whose legs are all clear."""
        tight = {pair: self._shore.tightened(way) for pair, way in bent.items()}
        best = dict(bent)
        for better in (tight, {pair: self._shore.rounded(way) for pair, way in tight.items()}):
            clear = self._are_clear(list(better.values()))
            best |= {
                pair: way for (pair, way), is_clear in zip(better.items(), clear, strict=True) if is_clear
            }
        return best

    def _are_clear(self, ways: list[FloatArray]) -> list[bool]:
        """Whether all legs of each way are clear by the polygons."""
        legs = self._survey.legs_are_clear(
            np.concatenate([way[:-1] for way in ways]), np.concatenate([way[1:] for way in ways])
        )
        first = np.cumsum([0, *(len(way) - 1 for way in ways)])[:-1]
        return [bool(clear) for clear in np.logical_and.reduceat(legs, first)]

    def _sights(
        self, cells: list[int], ends: FloatArray, are_outside: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Some centres of a chain of cells between two ends, and which of all these points see each other.

        Args:
            cells: numbers of neighbouring cells, from the one of the first end to the one of the second.
            ends: shape (2, 2).
            are_outside: shape (2,), which of the ends lie in no passable cell.

        Returns:
            The points, both ends included, shape (k, 2); and shape (k, k), whether the leg from row to column, later
            in the chain, is clear. Neighbours always see each other.
        """
        a, b = ends
        way = np.concatenate([a[None], _thinned(self._centres[cells]), b[None]])
        k = len(way)
        i, j = np.triu_indices(k, 1)
        clear = np.zeros((k, k), dtype=bool)
        clear[i, j] = self._raster.lines_are_clear(way[i], way[j])
        # An end in no passable cell has no clear line on the raster; the exact test finds its clear legs.
        if are_outside[0]:
            clear[0, 1:] = self._survey.legs_are_clear(a, way[1:])
        if are_outside[1]:
            clear[:-1, -1] = self._survey.legs_are_clear(way[:-1], b)
        # Neighbours in the chain are clear by the graph, and the ends by their joining.
        clear[np.arange(k - 1), np.arange(1, k)] = True
        return way, clear

    def cells_of(self, points: FloatArray) -> IntArray:
        """Numbers of the cells from which ways to the points start; −1 where none can be joined."""
        cells = self._raster.numbers_at(points)
        for k in np.flatnonzero(cells < 0):
            cells[k] = self._join(points[k])
        return cells

    def _join(self, point: FloatArray) -> int:
        if self._tree is None:
            return -1
        navigable = bool(self._survey.is_navigable(point)[0])
        test = self._survey.legs_are_clear if navigable else self._survey.approaches_are_clear
        for count in _JOINS_TRIED:
            nearest = np.atleast_1d(self._tree.query(point, k=min(count, len(self._centres)))[1])
            clear = np.flatnonzero(test(point, self._centres[nearest]))
            if len(clear):
                return int(nearest[clear[0]])
        return -1


@lru_cache(maxsize=4)
def passage_of(survey: SurveyArea) -> Passage:
    """The survey's passage, built once for each survey object."""
    return Passage(survey)


def _thinned(chain: FloatArray) -> FloatArray:
    """The chain's ends and turning points, and points between them as far as `_CORNERS` allows."""
    step = np.diff(chain, axis=0)
    turns = np.ones(len(chain), dtype=bool)
    turns[1:-1] = np.any(np.abs(np.diff(step, axis=0)) > 1e-6 * np.abs(step).max(initial=0.0), axis=1)
    keep = np.flatnonzero(turns)
    room = _CORNERS - len(keep)
    if room > 0:
        keep = np.union1d(keep, np.linspace(0, len(chain) - 1, room).astype(np.intp))
    return chain[keep]


def _chain(before: IntArray, source: int, target: int) -> list[int]:
    """The nodes from source to target, given the predecessors, shape (n,), that Dijkstra found from the source."""
    nodes = [target]
    while nodes[-1] != source:
        nodes.append(int(before[nodes[-1]]))
    return nodes[::-1]


def _shortest(lengths: FloatArray) -> list[int]:
    """Nodes of the shortest path from the first to the last node of a graph with edges i → j, i < j."""
    k = len(lengths)
    cost, before = np.full(k, np.inf), np.zeros(k, dtype=np.intp)
    cost[0] = 0.0
    for j in range(1, k):
        ways = cost[:j] + lengths[:j, j]
        before[j] = np.argmin(ways)
        cost[j] = ways[before[j]]
    path = [k - 1]
    while path[-1]:
        path.append(int(before[path[-1]]))
    return path[::-1]
