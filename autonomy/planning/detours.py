"""How far it is over water, roughly and quickly: for searches that ask thousands of times.

Distances come from the graph of a coarse raster, so that they are a few per cent longer than the way that string
pulling finds (`Passage.path`), and more where a channel is too narrow for it. They never decide whether a leg of a plan
is clear of land.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from autonomy.geometry import FloatArray
from autonomy.planning.errors import PlanningError
from autonomy.planning.passage import Passage
from autonomy.planning.raster import BoolArray, IntArray, Raster
from autonomy.planning.survey import SurveyArea

_COARSE_CELLS = 64
"""Cells of the coarse raster along the longer side of the area."""


class Detours:
    """Rough distances over the water that can be reached from one point."""

    def __init__(self, survey: SurveyArea, passage: Passage, start_m: ArrayLike) -> None:
        """Take the water.

        Raises:
            PlanningError: no passable water can be reached from the start.
        """
        start = np.asarray(start_m, dtype=float).reshape(2)
        self._survey = survey
        self._fine, self._coarse = _cells_of(survey, passage)
        self._whole = len(passage.raster.centres_m)
        _, first = np.unique(self._fine.basins, return_index=True)
        within = passage.reachable(start, self._fine.centres_m[first])
        if not within.any():
            lat_deg, lon_deg = survey.frame.to_geodetic(start)
            raise PlanningError(
                f"no navigable water can be reached from {lat_deg:.5f}, {lon_deg:.5f}; the vessel may be on land, "
                "outside the area or in water that is cut off"
            )
        self._within: BoolArray = np.isin(self._fine.basins, self._fine.basins[first[within]])

    @property
    def cells_m(self) -> FloatArray:
        """Centres of the raster's cells that can be reached, shape (n, 2)."""
        cells: FloatArray = self._fine.centres_m[: self._whole][self._within[: self._whole]]
        return cells

    def reachable(self, points_m: ArrayLike) -> BoolArray:
        """Whether the passable cell nearest to each point, shape (n, 2), can be reached; shape (n,)."""
        within: BoolArray = self._within[self._fine.nearest(points_m)]
        return within

    def distances(self, starts_m: ArrayLike, ends_m: ArrayLike, *, fine: bool = False) -> FloatArray:
        """Rough length in metres of the way from each start to its end, both shape (n, 2); shape (n,).

        Exact where the straight leg is clear; inf where there is no way. `fine`: on the passage's own raster.
        """
        a = np.asarray(starts_m, dtype=float).reshape(-1, 2)
        b = np.asarray(ends_m, dtype=float).reshape(-1, 2)
        lengths: FloatArray = np.hypot(*(b - a).T)
        bent = np.flatnonzero(~self._survey.legs_are_clear(a, b))
        along = (self._fine if fine else self._coarse).distances(a[bent], b[bent])
        closed = ~np.isfinite(along)
        along[closed] = self._fine.distances(a[bent[closed]], b[bent[closed]])
        lengths[bent] = np.maximum(lengths[bent], along)
        return lengths

    def between(self, points_m: ArrayLike) -> FloatArray:
        """Rough lengths between all pairs of points, shape (n, 2); shape (n, n), inf where there is no way."""
        points = np.asarray(points_m, dtype=float).reshape(-1, 2)
        first, second = np.triu_indices(len(points), 1)
        lengths = np.hypot(*(points[first] - points[second]).T)
        bent = np.flatnonzero(~self._survey.legs_are_clear(points[first], points[second]))
        pairs = first[bent], second[bent]
        along = self._coarse.from_each(points, *pairs)
        closed = ~np.isfinite(along)
        along[closed] = self._fine.from_each(points, pairs[0][closed], pairs[1][closed])
        lengths[bent] = np.maximum(lengths[bent], along)
        matrix = np.zeros((len(points), len(points)))
        matrix[first, second] = matrix[second, first] = lengths
        return matrix


class _Cells:
    """The cells of one graph and the distances along it, each looked for once."""

    def __init__(self, centres_m: FloatArray, graph: csr_array) -> None:
        self._graph = graph
        self.centres_m = centres_m
        self.basins: IntArray = connected_components(self._graph, directed=False)[1]
        self._tree = cKDTree(self.centres_m) if len(self.centres_m) else None
        self._known: dict[tuple[int, int], float] = {}

    def nearest(self, points_m: ArrayLike) -> IntArray:
        """Numbers of the cells nearest to points, shape (n, 2) to (n,); −1 if there is no cell at all."""
        points = np.asarray(points_m, dtype=float).reshape(-1, 2)
        if self._tree is None:
            return np.full(len(points), -1, dtype=np.intp)
        nearest: IntArray = self._tree.query(points)[1]
        return nearest

    def distances(self, starts_m: FloatArray, ends_m: FloatArray) -> FloatArray:
        """Between the cells nearest to starts and ends, both shape (n, 2); shape (n,), inf where there is no way."""
        pairs = np.sort(np.stack([self.nearest(starts_m), self.nearest(ends_m)], axis=-1), axis=1)
        return np.array([self._between(tail, head) for tail, head in pairs.tolist()])

    def from_each(self, points_m: FloatArray, first: IntArray, second: IntArray) -> FloatArray:
        """Between the cells nearest to pairs of points; one search for each of the first ones."""
        cells, lengths = self.nearest(points_m), np.full(len(first), np.inf)
        # One search at a time: all together would fill all points × all cells.
        for each in np.unique(first).tolist():
            own = first == each
            if cells[each] >= 0:
                lengths[own] = dijkstra(self._graph, indices=cells[each])[cells[second[own]]]
        return lengths

    def _between(self, tail: int, head: int) -> float:
        if tail < 0 or self.basins[tail] != self.basins[head]:
            return float("inf")
        if (tail, head) not in self._known:
            self._known[tail, head] = float(dijkstra(self._graph, indices=tail)[head])
        return self._known[tail, head]


@lru_cache(maxsize=4)
def _cells_of(survey: SurveyArea, passage: Passage) -> tuple[_Cells, _Cells]:
    """The passage's own cells and coarse ones; what they know of ways is kept for the next request."""
    cells = min(_COARSE_CELLS, survey.passage_cells)
    coarse = Raster.of(replace(survey, passage_cells=cells))
    return _Cells(passage.nodes_m, passage.graph), _Cells(coarse.centres_m, coarse.graph())
