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

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

METRES_PER_DEGREE = 111_195.0  # of a great circle on a sphere of 6371 km


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


def _with_outer_edges(axis: FloatArray) -> FloatArray:
    """The axis with half a spacing added at both ends."""
    first, last = axis[0] - 0.5 * (axis[1] - axis[0]), axis[-1] + 0.5 * (axis[-1] - axis[-2])
    return np.concatenate([[first], axis, [last]])
