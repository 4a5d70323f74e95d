"""Bent grids of the sea: which cell holds a position, and where in that cell it lies."""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from sim.field_grid import BoolArray, Bounds, FloatArray, IntArray, near

_TOLERANCE = 1e-9  # in index units
_MAX_STEPS = 12


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


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _steps(share: FloatArray) -> IntArray:
    """How many cells to move for a share outside 0..1; at most three: far extrapolation is poor."""
    beyond = (share < -_TOLERANCE) | (share > 1.0 + _TOLERANCE)
    return np.where(beyond, np.minimum(np.maximum(np.floor(share), -3.0), 3.0), 0.0).astype(np.int64)
