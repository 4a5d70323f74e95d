"""A raster of passable cells, its graph, and a line test that touches every cell a line touches."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array

from autonomy.geometry import FloatArray
from autonomy.planning.survey import SurveyArea

IntArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

_EDGE = 1e-9
"""In cells: a line this close to a cell touches it. Errs on the side of land."""

# One half of the 16 neighbours, (columns, rows): the other half is the same edge the other way. Each with the
# cells between its ends that the straight line between the centres touches: no corner is cut.
_MOVES: tuple[tuple[tuple[int, int], tuple[tuple[int, int], ...]], ...] = (
    ((1, 0), ()),
    ((0, 1), ()),
    ((1, 1), ((1, 0), (0, 1))),
    ((1, -1), ((1, 0), (0, -1))),
    ((2, 1), ((1, 0), (1, 1))),
    ((2, -1), ((1, 0), (1, -1))),
    ((1, 2), ((0, 1), (1, 1))),
    ((1, -2), ((0, -1), (1, -1))),
)


@dataclass(frozen=True, eq=False)
class Raster:
    """Nearly square cells over a rectangle.

    Attributes:
        x_edges_m, y_edges_m: shapes (nx + 1,) and (ny + 1,).
        passable: shape (nx, ny), which cells may be sailed over, all of each.
    """

    x_edges_m: FloatArray
    y_edges_m: FloatArray
    passable: BoolArray

    @classmethod
    def of(cls, survey: SurveyArea) -> "Raster":
        """The cells of a survey that lie wholly in its navigable water."""
        x_min, y_min, x_max, y_max = survey.bounds
        cell = survey.span_m / survey.passage_cells
        x = np.linspace(x_min, x_max, max(1, round((x_max - x_min) / cell)) + 1)
        y = np.linspace(y_min, y_max, max(1, round((y_max - y_min) / cell)) + 1)
        shapely.prepare(survey.navigable)
        # Column by column: a million squares at once would take half a gigabyte.
        columns = (shapely.box(west, y[:-1], east, y[1:]) for west, east in pairwise(x))
        return cls(x, y, np.stack([shapely.covers(survey.navigable, column) for column in columns]))

    @cached_property
    def number(self) -> IntArray:
        """Shape (nx, ny): the passable cells' numbers in the graph; −1 elsewhere."""
        number = np.full(self.passable.shape, -1, dtype=np.intp)
        number[self.passable] = np.arange(np.count_nonzero(self.passable))
        return number

    @cached_property
    def centres_m(self) -> FloatArray:
        """Centres of the passable cells in the order of their numbers, shape (n, 2)."""
        column, row = np.nonzero(self.passable)
        x = 0.5 * (self.x_edges_m[:-1] + self.x_edges_m[1:])
        y = 0.5 * (self.y_edges_m[:-1] + self.y_edges_m[1:])
        return np.stack([x[column], y[row]], axis=-1)

    def graph(self) -> csr_array:
        """Distances in metres between neighbouring passable cells, 16 neighbours each, symmetric."""
        tails, heads = [], []
        for move, between in _MOVES:
            tail = self._shifted((0, 0), move)
            head = self._shifted(move, move)
            free = (tail >= 0) & (head >= 0)
            for cell in between:
                free &= self._shifted(cell, move) >= 0
            tails.append(tail[free])
            heads.append(head[free])
        tail, head = np.concatenate(tails), np.concatenate(heads)
        length = np.hypot(*(self.centres_m[head] - self.centres_m[tail]).T)
        n = len(self.centres_m)
        rows, columns = np.concatenate([tail, head]), np.concatenate([head, tail])
        return csr_array((np.concatenate([length, length]), (rows, columns)), shape=(n, n))

    def _shifted(self, by: tuple[int, int], within: tuple[int, int]) -> IntArray:
        """Numbers of the cells `by` away from every cell whose neighbour at `within` is on the raster."""
        nx, ny = self.passable.shape
        column = slice(max(0, -within[0]) + by[0], nx - max(0, within[0]) + by[0])
        row = slice(max(0, -within[1]) + by[1], ny - max(0, within[1]) + by[1])
        return self.number[column, row]

    def numbers_at(self, points_m: ArrayLike) -> IntArray:
        """Numbers of the passable cells in which points lie, shape (n, 2) to (n,).

        −1 for a point in no passable cell; on a border all the cells that meet there must be passable.
        """
        points = np.asarray(points_m, dtype=float).reshape(-1, 2)
        numbers = np.full(len(points), -1, dtype=np.intp)
        clear = self.lines_are_clear(points, points)
        column, row = np.floor(self._in_cells(points[clear])).astype(np.intp).T
        numbers[clear] = self.number[column, row]
        return numbers

    def lines_are_clear(self, starts_m: ArrayLike, ends_m: ArrayLike) -> BoolArray:
        """Which straight lines touch passable cells only: a supercover, taken column by column.

        Args:
            starts_m: shape (n, 2).
            ends_m: shape (n, 2).

        Returns:
            Shape (n,).
        """
        a, b = self._in_cells(starts_m), self._in_cells(ends_m)
        swap = a[:, 0] > b[:, 0]
        a[swap], b[swap] = b[swap], a[swap]
        nx, ny = self.passable.shape
        low = np.minimum(a, b).min(axis=0, initial=np.inf) - _EDGE
        high = np.maximum(a, b).max(axis=0, initial=-np.inf) + _EDGE
        columns = np.arange(max(0, _floor(low[0], nx)), min(nx - 1, _floor(high[0], nx)) + 1)
        first, last = self._rows_touched(a, b, columns)
        touched = (columns >= np.floor(a[:, :1] - _EDGE)) & (columns <= np.floor(b[:, :1] + _EDGE))
        blocked = self._blocked_below[columns, np.clip(last + 1, 0, ny)]
        blocked = blocked - self._blocked_below[columns, np.clip(first, 0, ny)]
        on_raster = np.all(np.minimum(a, b) >= _EDGE, axis=1)
        on_raster &= np.all(np.maximum(a, b) <= np.array([nx, ny]) - _EDGE, axis=1)
        clear: BoolArray = on_raster & ~np.any(touched & (blocked > 0), axis=1)
        return clear

    @staticmethod
    def _rows_touched(a: FloatArray, b: FloatArray, columns: IntArray) -> tuple[IntArray, IntArray]:
        """First and last row that each line touches in each column, shapes (n, columns)."""
        x0, x1 = a[:, :1], b[:, :1]
        steep = x1 - x0 <= 4 * _EDGE
        run = np.where(steep, 1.0, x1 - x0)
        slope = (b[:, 1:] - a[:, 1:]) / run
        y_in = a[:, 1:] + slope * (np.clip(columns - _EDGE, x0, x1) - x0)
        y_out = a[:, 1:] + slope * (np.clip(columns + 1 + _EDGE, x0, x1) - x0)
        # A line along a column touches all its rows there, whatever the slope says.
        y_in, y_out = np.where(steep, a[:, 1:], y_in), np.where(steep, b[:, 1:], y_out)
        first = np.floor(np.minimum(y_in, y_out) - _EDGE).astype(np.intp)
        last = np.floor(np.maximum(y_in, y_out) + _EDGE).astype(np.intp)
        return first, last

    @cached_property
    def _blocked_below(self) -> IntArray:
        """Shape (nx, ny + 1): how many cells of a column below a row are blocked."""
        blocked = np.cumsum(~self.passable, axis=1, dtype=np.intp)
        return np.concatenate([np.zeros((len(blocked), 1), dtype=np.intp), blocked], axis=1)

    def _in_cells(self, points_m: ArrayLike) -> FloatArray:
        """Positions in units of cells: cell (i, j) is the square from (i, j) to (i + 1, j + 1)."""
        points = np.asarray(points_m, dtype=float).reshape(-1, 2)
        near = np.array([self.x_edges_m[0], self.y_edges_m[0]])
        far = np.array([self.x_edges_m[-1], self.y_edges_m[-1]])
        cells: FloatArray = (points - near) / (far - near) * self.passable.shape
        return cells


def _floor(value: float, cells: int) -> int:
    return int(np.floor(np.clip(value, -1.0, cells)))
