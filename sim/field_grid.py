"""Grids of the sea: from degrees to the fractional row and column of a grid, and back.

The cell of a grid point reaches half an index in every direction. `locate` therefore answers within
[-0.5, rows - 0.5] x [-0.5, columns - 0.5] and gives NaN elsewhere; rounding its answer is the nearest-cell
rule by which land is told from water, and the same cells, drawn as polygons, are what the vessel is given as
land.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

METRES_PER_DEGREE = 111_195.0  # of a great circle on a sphere of 6371 km

_TOLERANCE = 1e-9  # in index units
_MAX_STEPS = 12


@dataclass(frozen=True)
class Bounds:
    """A box of latitude and longitude, degrees. `east` exceeds 180 when the box crosses the date line."""

    south: float
    north: float
    west: float
    east: float

    @property
    def centre(self) -> tuple[float, float]:
        """Latitude and longitude of the middle, degrees."""
        return 0.5 * (self.south + self.north), 0.5 * (self.west + self.east)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (at the middle latitude) and height, metres."""
        narrowing = math.cos(math.radians(self.centre[0]))
        width_m = (self.east - self.west) * METRES_PER_DEGREE * narrowing
        return width_m, (self.north - self.south) * METRES_PER_DEGREE


class Grid(Protocol):
    """Rows and columns of grid points on the globe."""

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""

    @property
    def bounds(self) -> Bounds:
        """The smallest box that holds every grid point."""

    def locate(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Fractional row and column of positions; NaN outside the outermost cells."""

    def positions(self, row: ArrayLike, column: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude, degrees, of fractional rows and columns."""


class RectilinearGrid:
    """Rows of constant latitude, columns of constant longitude, evenly spaced or not."""

    def __init__(self, lat_axis_deg: ArrayLike, lon_axis_deg: ArrayLike) -> None:
        """Take the axes.

        Args:
            lat_axis_deg: latitudes of the rows, strictly increasing.
            lon_axis_deg: longitudes of the columns, strictly increasing, without a jump.
        """
        self._lat = np.asarray(lat_axis_deg, dtype=float)
        self._lon = np.asarray(lon_axis_deg, dtype=float)
        for name, axis in (("latitudes", self._lat), ("longitudes", self._lon)):
            if axis.ndim != 1 or len(axis) < 2 or not np.all(np.diff(axis) > 0.0):
                raise ValueError(f"{name} of a grid must be at least two, strictly increasing")
        self._lat_edges = _with_outer_edges(self._lat)
        self._lon_edges = _with_outer_edges(self._lon)
        self._lat_index = _with_outer_edges(np.arange(len(self._lat), dtype=float))
        self._lon_index = _with_outer_edges(np.arange(len(self._lon), dtype=float))
        self._middle_lon = float(0.5 * (self._lon[0] + self._lon[-1]))

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return len(self._lat), len(self._lon)

    @property
    def bounds(self) -> Bounds:
        """The smallest box that holds every grid point."""
        return Bounds(*(float(v) for v in (self._lat[0], self._lat[-1], self._lon[0], self._lon[-1])))

    def locate(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Fractional row and column of positions; NaN outside the outermost cells."""
        lon = near(np.asarray(lon_deg, dtype=float), self._middle_lon)
        row = np.interp(np.asarray(lat_deg, dtype=float), self._lat_edges, self._lat_index, np.nan, np.nan)
        column = np.interp(lon, self._lon_edges, self._lon_index, np.nan, np.nan)
        inside = np.isfinite(row) & np.isfinite(column)
        return np.where(inside, row, np.nan), np.where(inside, column, np.nan)

    def positions(self, row: ArrayLike, column: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude, degrees, of fractional rows and columns."""
        lat = np.interp(np.asarray(row, dtype=float), self._lat_index, self._lat_edges)
        lon = np.interp(np.asarray(column, dtype=float), self._lon_index, self._lon_edges)
        return lat, lon


class CurvilinearGrid:
    """Grid points anywhere, in rows and columns that may bend: bilinear within each quadrilateral of four.

    All geometry is done in a stereographic plane about the middle of the grid, so that neither the date line
    nor a pole is special.
    """

    def __init__(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> None:
        """Take latitudes and longitudes of the grid points, both of shape (rows, columns), at least 2 x 2."""
        lat, lon = np.asarray(lat_deg, dtype=float), np.asarray(lon_deg, dtype=float)
        if lat.ndim != 2 or lat.shape != lon.shape or min(lat.shape) < 2:
            raise ValueError(f"a curvilinear grid needs two equal arrays of at least 2 x 2, not {lat.shape}")
        self.shape: tuple[int, int] = (lat.shape[0], lat.shape[1])
        middle_lon = float(lon[lat.shape[0] // 2, lat.shape[1] // 2])
        middle_lon = (middle_lon + 180.0) % 360.0 - 180.0
        lon = near(lon, middle_lon)
        self.bounds = Bounds(float(lat.min()), float(lat.max()), float(lon.min()), float(lon.max()))
        self._plane = _StereographicPlane(*self.bounds.centre)
        self._points = self._plane.forward(lat, lon)
        self._tree = KDTree(self._points.reshape(-1, 2))
        self._orientation = self._common_orientation()
        self._last_cell: tuple[IntArray, IntArray] | None = None

    def _common_orientation(self) -> float:
        p = self._points
        along, across = p[:-1, 1:] - p[:-1, :-1], p[1:, :-1] - p[:-1, :-1]
        turns = _cross(along, across)
        if not (np.all(turns > 0.0) or np.all(turns < 0.0)):
            bad = int(np.count_nonzero(np.sign(turns) != np.sign(np.median(turns))))
            raise ValueError(f"{bad} of {turns.size} grid cells are folded or have no area")
        return float(np.sign(turns.flat[0]))

    def locate(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Fractional row and column of positions; NaN outside the outermost cells."""
        target = self._plane.forward(np.asarray(lat_deg, dtype=float), np.asarray(lon_deg, dtype=float))
        shape = target.shape[:-1]
        target = target.reshape(-1, 2)
        known = np.isfinite(target).all(axis=-1)
        row, column = np.full(len(target), np.nan), np.full(len(target), np.nan)
        row[known], column[known] = self._locate_points(target[known])
        return row.reshape(shape), column.reshape(shape)

    def _locate_points(self, target: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Indices of points of the plane, shape (n, 2): walk there from the nearest grid point."""
        if len(target) == 1 and self._last_cell is not None:
            # A vessel asks again nearby: mostly its cell is the last one. Only a sure answer counts.
            v, u, real = self._solve(target, *self._last_cell)
            if real[0] and 0.0 <= v[0] <= 1.0 and 0.0 <= u[0] <= 1.0:
                return self._last_cell[0] + v, self._last_cell[1] + u
        rows, columns = self.shape
        nearest = np.asarray(self._tree.query(target)[1], dtype=np.int64)
        i, j = np.minimum(nearest // columns, rows - 2), np.minimum(nearest % columns, columns - 2)
        v, u, inside = self._walk(target, i, j)
        if len(target) == 1:
            self._last_cell = i, j
        row, column = i + v, j + u
        inside &= (row >= -0.5) & (row <= rows - 0.5) & (column >= -0.5) & (column <= columns - 0.5)
        return np.where(inside, row, np.nan), np.where(inside, column, np.nan)

    def _walk(self, target: FloatArray, i: IntArray, j: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Shares within the cells reached, and whether they answer; moves the cells (i, j) in place."""
        rows, columns = self.shape
        v, u, real = self._solve(target, i, j)
        moving = np.arange(len(target))
        for _ in range(_MAX_STEPS):
            next_i = np.minimum(np.maximum(i[moving] + _steps(v[moving]), 0), rows - 2)
            next_j = np.minimum(np.maximum(j[moving] + _steps(u[moving]), 0), columns - 2)
            moved = (next_i != i[moving]) | (next_j != j[moving])
            moving = moving[moved]
            if not len(moving):
                break
            i[moving], j[moving] = next_i[moved], next_j[moved]
            v[moving], u[moving], real[moving] = self._solve(target[moving], i[moving], j[moving])
        real[moving] = False
        return v, u, real

    def _solve(
        self, target: FloatArray, i: IntArray, j: IntArray
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Inverse bilinear map of the quadrilaterals (i, j).

        The point is a + u e + v f + u v g; eliminating u leaves k2 v² + k1 v + k0 = 0, and the wanted root is
        the one at which the map keeps the grid's orientation.

        Returns:
            Shares across rows and columns, beyond 0..1 if the point is outside, and whether the root is real:
            where it is not, the shares only say in which direction to look.
        """
        a, b = self._points[i, j], self._points[i, j + 1]
        d, c = self._points[i + 1, j], self._points[i + 1, j + 1]
        e, f, g, h = b - a, d - a, a - b + c - d, target - a
        k2, k1, k0 = _cross(g, f), _cross(e, f) + _cross(h, g), _cross(h, e)
        discriminant = k1 * k1 - 4.0 * k0 * k2
        divisor = k1 + self._orientation * np.sqrt(np.maximum(discriminant, 0.0))
        v = -2.0 * k0 / np.where(divisor == 0.0, np.finfo(float).tiny, divisor)
        v = np.minimum(np.maximum(v, -1e6), 1e6)
        edge = e + v[..., None] * g
        u = ((h - v[..., None] * f) * edge).sum(axis=-1) / np.maximum((edge * edge).sum(axis=-1), 1e-300)
        return v, u, discriminant >= 0.0

    def positions(self, row: ArrayLike, column: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude, degrees, of fractional rows and columns, also beyond the outer points."""
        points = self._map(np.asarray(row, dtype=float), np.asarray(column, dtype=float))
        lat, lon = self._plane.inverse(points)
        return lat, near(lon, self.bounds.centre[1])

    def _map(self, row: FloatArray, column: FloatArray) -> FloatArray:
        """Points of the plane at fractional indices, bilinear."""
        i = np.clip(np.floor(row), 0, self.shape[0] - 2).astype(np.int64)
        j = np.clip(np.floor(column), 0, self.shape[1] - 2).astype(np.int64)
        v, u = (row - i)[..., None], (column - j)[..., None]
        p = self._points
        lower = (1 - u) * p[i, j] + u * p[i, j + 1]
        upper = (1 - u) * p[i + 1, j] + u * p[i + 1, j + 1]
        return np.asarray((1 - v) * lower + v * upper)


class ShrunkGrid:
    """A grid drawn together about the middle of its bounds, in latitude and longitude alike."""

    def __init__(self, inner: Grid, factor: float) -> None:
        if not factor > 0.0:
            raise ValueError(f"a grid shrinks by a factor above 0, not {factor}")
        self._inner = inner
        self._factor = factor
        self._lat0, self._lon0 = inner.bounds.centre
        self.shape = inner.shape
        b = inner.bounds
        self.bounds = Bounds(
            self._lat0 + (b.south - self._lat0) / factor,
            self._lat0 + (b.north - self._lat0) / factor,
            self._lon0 + (b.west - self._lon0) / factor,
            self._lon0 + (b.east - self._lon0) / factor,
        )

    def expand(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Where positions of the small sea lie in the large one; NaN where that is not on the globe."""
        lat = self._lat0 + self._factor * (np.asarray(lat_deg, dtype=float) - self._lat0)
        offset = near(np.asarray(lon_deg, dtype=float), self._lon0) - self._lon0
        lon = self._lon0 + self._factor * offset
        on_globe = (np.abs(lat) <= 90.0) & (np.abs(lon - self._lon0) <= 180.0)
        return np.where(on_globe, lat, np.nan), np.where(on_globe, lon, np.nan)

    def locate(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Fractional row and column of positions; NaN outside the outermost cells."""
        return self._inner.locate(*self.expand(lat_deg, lon_deg))

    def positions(self, row: ArrayLike, column: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Latitude and longitude, degrees, of fractional rows and columns."""
        lat, lon = self._inner.positions(row, column)
        return self._lat0 + (lat - self._lat0) / self._factor, self._lon0 + (lon - self._lon0) / self._factor


@dataclass(frozen=True)
class LandMask:
    """Land or water for every cell of a grid; `land` has the grid's shape."""

    grid: Grid
    land: BoolArray

    def is_land(self, row: FloatArray, column: FloatArray) -> BoolArray:
        """Whether the cell at fractional indices is land; False where they are NaN."""
        inside, land = self._nearest(row, column)
        return np.asarray(inside & land)

    def is_water(self, row: FloatArray, column: FloatArray) -> BoolArray:
        """Whether the cell at fractional indices is water; False where they are NaN."""
        inside, land = self._nearest(row, column)
        return np.asarray(inside & ~land)

    def _nearest(self, row: FloatArray, column: FloatArray) -> tuple[BoolArray, BoolArray]:
        inside = ~np.isnan(row)
        i = np.minimum(np.floor(np.where(inside, row, 0.0) + 0.5).astype(np.int64), self.land.shape[0] - 1)
        j = np.minimum(np.floor(np.where(inside, column, 0.0) + 0.5).astype(np.int64), self.land.shape[1] - 1)
        return inside, self.land[i, j]


def near(lon_deg: FloatArray, middle_deg: float) -> FloatArray:
    """Longitudes moved by whole turns to within 180 degrees of a middle one."""
    return np.asarray(middle_deg + (lon_deg - middle_deg + 180.0) % 360.0 - 180.0)


class _StereographicPlane:
    """Stereographic projection of the sphere about a point; the unit is the sphere's radius."""

    def __init__(self, lat_deg: float, lon_deg: float) -> None:
        lat, lon = math.radians(lat_deg), math.radians(lon_deg)
        east = [-math.sin(lon), math.cos(lon), 0.0]
        north = [-math.sin(lat) * math.cos(lon), -math.sin(lat) * math.sin(lon), math.cos(lat)]
        up = [math.cos(lat) * math.cos(lon), math.cos(lat) * math.sin(lon), math.sin(lat)]
        self._axes = np.array([east, north, up])

    def forward(self, lat_deg: FloatArray, lon_deg: FloatArray) -> FloatArray:
        lat, lon = np.radians(lat_deg), np.radians(lon_deg)
        level = np.cos(lat)
        on_sphere = np.stack([level * np.cos(lon), level * np.sin(lon), np.sin(lat)], axis=-1)
        turned = on_sphere @ self._axes.T
        # The antipode is sent very far away instead of dividing by zero.
        return np.asarray(2.0 * turned[..., :2] / np.maximum(1.0 + turned[..., 2:], 1e-12))

    def inverse(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        quarter = (points * points).sum(axis=-1, keepdims=True) / 4.0
        turned = np.concatenate([points, 1.0 - quarter], axis=-1) / (1.0 + quarter)
        x, y, z = np.moveaxis(turned @ self._axes, -1, 0)
        return np.degrees(np.arctan2(z, np.hypot(x, y))), np.degrees(np.arctan2(y, x))


def _with_outer_edges(axis: FloatArray) -> FloatArray:
    """The axis with half a spacing added at both ends."""
    first, last = axis[0] - 0.5 * (axis[1] - axis[0]), axis[-1] + 0.5 * (axis[-1] - axis[-2])
    return np.concatenate([[first], axis, [last]])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _steps(share: FloatArray) -> IntArray:
    """How many cells to move for a share outside 0..1; at most three: far extrapolation is poor."""
    beyond = (share < -_TOLERANCE) | (share > 1.0 + _TOLERANCE)
    return np.where(beyond, np.minimum(np.maximum(np.floor(share), -3.0), 3.0), 0.0).astype(np.int64)
