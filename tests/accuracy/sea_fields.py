"""Still fields of the sea on a lattice of metres: cut from files of real ones, or made up."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
from scipy.spatial import cKDTree

from sim.synthetic import bight, patch

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

STEPS_PER_SIDE = 80
"""The lattice's step is √(water area) / 80."""
_METRES_PER_DEGREE = 111_195.0
_FILES = {
    "txla": "txla_roms_native_top10levels.nc",
    "nordic": "Nordic_subset.nc",
    "ucla": "ucla_roms_point_conception_joined_101x201.nc",
    "sst": "scb_mur_sst_7dates_240x435.nc",
}
REAL = (
    *("txla-salt-9", "txla-temp-9", "txla-salt-0", "txla-temp-0"),
    *("nordic-salt-34", "nordic-temp-34", "nordic-salt-0", "nordic-temp-0"),
    *("ucla-salt-49", "ucla-temp-49", "ucla-salt-0", "ucla-temp-0"),
    *("sst-0", "sst-2", "sst-4", "sst-6"),
)
"""File, variable and level (the last is the surface); for the satellite's, the date."""


@dataclass(frozen=True)
class SeaField:
    """One still field; `values` (rows, columns) on the lattice of `y_axis_m` × `x_axis_m`, NaN where no water is.

    The water is in one piece.
    """

    name: str
    x_axis_m: FloatArray
    y_axis_m: FloatArray
    values: FloatArray

    @property
    def water(self) -> BoolArray:
        return np.isfinite(self.values)

    @property
    def step_m(self) -> float:
        return float(self.x_axis_m[1] - self.x_axis_m[0])

    @property
    def side_m(self) -> float:
        """√(water area): the unit of lengths in these tests."""
        return self.step_m * float(np.sqrt(self.water.sum()))

    @property
    def span_m(self) -> float:
        """The longer side of the water's bounding box, which is what the learner is told."""
        return float(np.ptp(self.points, axis=0).max())

    @property
    def points(self) -> FloatArray:
        """Centres of all water cells, (N, 2) metres."""
        row, column = np.nonzero(self.water)
        return np.column_stack([self.x_axis_m[column], self.y_axis_m[row]])

    @property
    def truth(self) -> FloatArray:
        """The values at `points`, (N,)."""
        return np.asarray(self.values[self.water])

    def is_water(self, points: FloatArray) -> BoolArray:
        """Whether the cell around each of `points` (n, 2) is water."""
        row, column = (np.rint(v).astype(int) for v in self._indices(points))
        rows, columns = self.values.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        return np.asarray(inside & self.water[row.clip(0, rows - 1), column.clip(0, columns - 1)])

    def at(self, points: FloatArray) -> FloatArray:
        """Bilinear over the water's corners, (n,); NaN where all four are land."""
        row, column = self._indices(points)
        rows, columns = self.values.shape
        i = np.floor(row).astype(int).clip(0, rows - 2)
        j = np.floor(column).astype(int).clip(0, columns - 2)
        v, u = (row - i).clip(0, 1), (column - j).clip(0, 1)
        total, weight = np.zeros(len(points)), np.zeros(len(points))
        for di, dj, share in (
            (0, 0, (1 - v) * (1 - u)),
            (0, 1, (1 - v) * u),
            (1, 0, v * (1 - u)),
            (1, 1, v * u),
        ):
            value = self.values[i + di, j + dj]
            known = np.isfinite(value)
            # Tiny, so that a place right on a corner of land still has its neighbours' value.
            share = np.where(known, share + 1e-9, 0.0)
            total += share * np.where(known, value, 0.0)
            weight += share
        return np.where(weight > 0, total / np.where(weight > 0, weight, 1.0), np.nan)

    def _indices(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        step = self.step_m
        return (points[:, 1] - self.y_axis_m[0]) / step, (points[:, 0] - self.x_axis_m[0]) / step


def real_field(directory: Path, name: str) -> SeaField:
    """One of `REAL`."""
    family, *rest = name.split("-")
    if family == "sst":
        return _from_grid(
            name, _grid(directory, family), _values(directory, family, "analysed_sst", int(rest[0]))
        )
    return _from_grid(name, _grid(directory, family), _values(directory, family, rest[0], int(rest[1])))


def sim_field(name: str, seed: int) -> SeaField:
    """The simulator's synthetic salinity: `patch` (15 km of coast) or `bight` (the whole bight)."""
    field = {"patch": patch, "bight": bight}[name](seed)
    bounds = field.bounds
    width_m, height_m = bounds.size_m

    def value(x: FloatArray, y: FloatArray) -> FloatArray:
        lat = bounds.south + (bounds.north - bounds.south) * y / height_m
        lon = bounds.west + (bounds.east - bounds.west) * x / width_m
        return field.value(lat, lon, 0.0)

    return _on_lattice(f"{name}-{seed}", value, np.array([0.0, 0.0]), np.array([width_m, height_m]))


def drawn_field(
    name: str, correlation: Callable[[FloatArray], FloatArray], seed: int, side_m: float = 1e4
) -> SeaField:
    """A draw of unit variance from a stationary process over a square without land, by circulant embedding.

    `correlation` takes distances as multiples of the square's side (so that length-scales are shares of it).
    """
    n = 4 * STEPS_PER_SIDE
    lag = np.minimum(np.arange(n), n - np.arange(n)) / STEPS_PER_SIDE
    spectrum = np.fft.fft2(correlation(np.hypot(lag[:, None], lag[None, :]))).real.clip(0.0)
    noise = np.random.default_rng(seed).normal(size=(2, n, n))
    draw = np.fft.fft2(np.sqrt(spectrum) / n * (noise[0] + 1j * noise[1])).real
    axis = (np.arange(STEPS_PER_SIDE) + 0.5) * side_m / STEPS_PER_SIDE
    return SeaField(f"{name}-{seed}", axis, axis, draw[:STEPS_PER_SIDE, :STEPS_PER_SIDE])


@dataclass(frozen=True)
class _Grid:
    """Where a file's grid points are, (N, 2) metres, and which of them are water."""

    places: FloatArray
    water: BoolArray
    spacing_m: FloatArray


@lru_cache
def _grid(directory: Path, family: str) -> _Grid:
    with netCDF4.Dataset(str(directory / _FILES[family])) as data:
        data.set_auto_mask(False)
        if family == "sst":
            lon, lat = np.meshgrid(data["lon"][:].astype(float), data["lat"][:].astype(float))
            water = data["land"][:] == 0
        else:
            lon, lat = data["lon_rho"][:].astype(float), data["lat_rho"][:].astype(float)
            water = data["mask_rho"][:] > 0.5
    lat0 = 0.5 * (lat.min() + lat.max())
    places = (
        np.stack([(lon - lon.min()) * np.cos(np.radians(lat0)), lat - lat.min()], axis=-1)
        * _METRES_PER_DEGREE
    )
    gap = np.maximum(
        np.linalg.norm(np.gradient(places, axis=0), axis=-1),
        np.linalg.norm(np.gradient(places, axis=1), axis=-1),
    )
    return _Grid(places.reshape(-1, 2), water.ravel(), gap.ravel())


def _values(directory: Path, family: str, variable: str, index: int) -> FloatArray:
    with netCDF4.Dataset(str(directory / _FILES[family])) as data:
        data.set_auto_mask(False)
        values: Any = data[variable]
        # ROMS: the first instant of (time, level, row, column) or (level, row, column); the satellite: a date.
        chosen = values[0, index] if values.ndim == 4 else values[index]
    return np.asarray(chosen, dtype=float).ravel()


def _from_grid(name: str, grid: _Grid, values: FloatArray) -> SeaField:
    sane = grid.water & np.isfinite(values) & (np.abs(values) < 1e3)
    tree = cKDTree(grid.places)
    linear = LinearNDInterpolator(grid.places[sane], values[sane])
    nearest = NearestNDInterpolator(grid.places[sane], values[sane])

    def value(x: FloatArray, y: FloatArray) -> FloatArray:
        places = np.column_stack([x.ravel(), y.ravel()])
        distance, owner = tree.query(places)
        inner = linear(places)
        inner = np.where(np.isfinite(inner), inner, nearest(places))
        here = sane[owner] & (distance <= 0.75 * grid.spacing_m[owner])
        return np.asarray(np.where(here, inner, np.nan).reshape(x.shape))

    return _on_lattice(name, value, grid.places.min(axis=0), grid.places.max(axis=0))


def _on_lattice(
    name: str, value: Callable[[FloatArray, FloatArray], FloatArray], low: FloatArray, high: FloatArray
) -> SeaField:
    """The largest piece of water of `value` over the box, on a lattice whose step suits its area."""
    extent = high - low
    share = 1.0
    for _ in range(2):  # the step follows from the water's area, which only a lattice tells
        step = float(np.sqrt(share * extent[0] * extent[1])) / STEPS_PER_SIDE
        x_axis = low[0] + np.arange(0.5 * step, extent[0], step)
        y_axis = low[1] + np.arange(0.5 * step, extent[1], step)
        values = value(*np.meshgrid(x_axis, y_axis))
        labels, _ = ndimage.label(np.isfinite(values))
        sizes = np.bincount(labels.ravel())[1:]
        largest = labels == 1 + int(sizes.argmax())
        share = float(largest.mean())
    return SeaField(name, x_axis, y_axis, np.where(largest, values, np.nan))
