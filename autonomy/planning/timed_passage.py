"""Quickest ways over water in a current: there and back they differ."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from autonomy.geometry import FloatArray
from autonomy.planning.errors import Unreachable
from autonomy.planning.passage import Passage, chain, shortest
from autonomy.planning.sailing import Sailing


@dataclass(frozen=True, eq=False)
class TimedWays:
    """Quickest ways found between all ordered pairs of some points.

    Attributes:
        points_m: shape (n, 2).
        times_s: shape (n, n), from row to column; inf where the water or the current leave no way, 0 on the diagonal.
        energies_j: the same in joules.
    """

    points_m: FloatArray
    times_s: FloatArray
    energies_j: FloatArray
    _polylines: dict[tuple[int, int], FloatArray]

    def path(self, i: int, j: int) -> FloatArray:
        """The way from point i to point j, both ends included, shape (k, 2).

        Raises:
            Unreachable: there is none.
        """
        if i != j and (i, j) not in self._polylines:
            (x0, y0), (x1, y1) = self.points_m[[i, j]]
            raise Unreachable(
                f"no way over navigable water from ({x0:.0f} m east, {y0:.0f} m north) to "
                f"({x1:.0f} m east, {y1:.0f} m north) against this current"
            )
        return self._polylines[i, j].copy() if i != j else self.points_m[[i, i]]


class TimedPassage:
    """Ways of a vessel in a current: the faster of the shortest way and the raster's quickest one.

    On the raster time is least along moves in 16 directions; string pulling then leaves out the corners that only
    cost time. Where the current is the same everywhere, or slow, that is the shortest way.
    """

    def __init__(self, passage: Passage, sailing: Sailing) -> None:
        self._passage, self._sailing = passage, sailing
        centres, graph = passage.nodes_m, passage.graph
        tails = np.repeat(np.arange(len(centres)), np.diff(graph.indptr))
        times = sailing.times_s(centres[tails], centres[graph.indices]) if len(tails) else np.empty(0)
        sailed = np.isfinite(times)
        pairs = (tails[sailed], graph.indices[sailed])
        self._graph = csr_array((times[sailed], pairs), shape=graph.shape)

    def ways(self, points_m: ArrayLike) -> TimedWays:
        """Quickest ways between points of shape (n, 2)."""
        short = self._passage.ways(points_m)
        n = len(short.points_m)
        times, polylines = np.full((n, n), np.inf), {}
        np.fill_diagonal(times, 0.0)
        for (i, j), quick in self._quick(short.points_m).items():
            options = [short.path(i, j), quick] if np.isfinite(short.distances_m[i, j]) else [quick]
            spent = [self._sailing.way_time_s(option) for option in options]
            best = int(np.argmin(spent))
            if np.isfinite(spent[best]):
                times[i, j], polylines[i, j] = spent[best], options[best]
        energies = (
            times * self._sailing.power_w if self._sailing.power_w else np.where(times < np.inf, 0.0, np.inf)
        )
        return TimedWays(short.points_m, times, energies, polylines)

    def _quick(self, points: FloatArray) -> dict[tuple[int, int], FloatArray]:
        """The raster's quickest ways between all ordered pairs that have one."""
        cells = self._passage.cells_of(points)
        outside = self._passage.raster.numbers_at(points) < 0
        joined = np.flatnonzero(cells >= 0)
        if len(joined) < 2:
            return {}
        sources, which = np.unique(cells[joined], return_inverse=True)
        spent, before = dijkstra(self._graph, directed=True, indices=sources, return_predecessors=True)
        ways = {}
        for i, row in zip(joined.tolist(), which.tolist(), strict=True):
            for j in joined[(joined != i) & np.isfinite(spent[row, cells[joined]])].tolist():
                on_way = chain(before[row], int(cells[i]), int(cells[j]))
                way, clear = self._passage.sights(on_way, points[[i, j]], outside[[i, j]])
                a, b = np.nonzero(clear)
                times = np.full(clear.shape, np.inf)
                times[a, b] = self._sailing.times_s(way[a], way[b])
                ways[i, j] = way[shortest(times)]
        return ways
