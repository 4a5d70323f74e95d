"""The truth: one scalar of the sea at any place and time, with its land.

Positions are degrees (WGS84), times are seconds since the field's own first instant. Every kind of field
answers through the same small interface, `Field`; `open_field` makes one from a word or a file name.
"""

import math
import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.field_grid import Bounds, FloatArray, Grid, LandMask, ShrunkGrid

BoolArray = NDArray[np.bool_]

_SYNTHETIC = re.compile(r"synthetic(?P<kind>|-patch|-moving)(?::(?P<seed>\d+))?")


class FieldError(ValueError):
    """The field cannot be opened; the message says what is wrong, where, and what would be right."""


@dataclass(frozen=True)
class FieldInfo:
    """What a field is, in words: `units` is empty when the source states none."""

    variable: str
    long_name: str
    units: str
    description: str
    start_utc: datetime | None = None

    @property
    def label(self) -> str:
        """The long name with its unit, for axes and colour bars."""
        return f"{self.long_name} ({self.units})" if self.units else self.long_name


class Field(Protocol):
    """One scalar of the sea, in degrees and seconds.

    Attributes:
        info: variable, units, long name, description, UTC of time zero (None when the source has no epoch).
        mask: the land, cell by cell, on the field's own grid.
        times_s: first and last instant at which the field changes; before and after it is held constant.
    """

    @property
    def info(self) -> FieldInfo:
        """Names, units and origin."""

    @property
    def mask(self) -> LandMask:
        """The land, cell by cell."""

    @property
    def times_s(self) -> tuple[float, float]:
        """First and last instant of change, seconds; the first is 0."""

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""

    @property
    def bounds(self) -> Bounds:
        """The smallest box of latitude and longitude that holds every grid point."""

    def is_land(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> BoolArray:
        """Whether the grid cell around each position is land; False outside the field."""

    def grid(self, lat_axis_deg: ArrayLike, lon_axis_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values on a lattice: shape (len(lat_axis_deg), len(lon_axis_deg)), NaN on land and outside."""

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, m/s; (0, 0) for a field that knows none, on land and outside."""


class MaskedField(ABC):
    """The part of a field that follows from its mask; subclasses add `value`, and `current` if they know one."""

    def __init__(self, info: FieldInfo, mask: LandMask, times_s: tuple[float, float]) -> None:
        self.info = info
        self.mask = mask
        self.times_s = times_s

    @property
    def bounds(self) -> Bounds:
        """The smallest box of latitude and longitude that holds every grid point."""
        return self.mask.grid.bounds

    @abstractmethod
    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""

    def is_land(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> BoolArray:
        """Whether the grid cell around each position (the cell of the nearest grid point) is land."""
        return self.mask.is_land(*self.mask.grid.locate(lat_deg, lon_deg))

    def grid(self, lat_axis_deg: ArrayLike, lon_axis_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values on a lattice: shape (len(lat_axis_deg), len(lon_axis_deg)), NaN on land and outside."""
        lat, lon = np.meshgrid(
            np.asarray(lat_axis_deg, dtype=float), np.asarray(lon_axis_deg, dtype=float), indexing="ij"
        )
        return self.value(lat, lon, time_s)

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, m/s: (0, 0), since nothing is known of it."""
        return 0.0, 0.0


class InterpolatedField(MaskedField):
    """A field known at grid points: bilinear in the grid's own index space, linear in time.

    Near the coast only water corners count, their weights renormalised: no value of land is ever mixed in.
    """

    def __init__(self, info: FieldInfo, mask: LandMask, times_s: tuple[float, float]) -> None:
        super().__init__(info, mask, times_s)
        self._water = (~mask.land).ravel().astype(float)

    @abstractmethod
    def _around(self, time_s: float) -> tuple[FloatArray, FloatArray, float]:
        """The frames before and after an instant, finite everywhere, and the share of the later one."""

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""
        row, column = self.mask.grid.locate(lat_deg, lon_deg)
        water = self.mask.is_water(row, column)
        corners, weights = self._corners(np.where(water, row, 0.0), np.where(water, column, 0.0))
        weights = weights * self._water[corners]
        total = weights.sum(axis=0)
        before, after, share = self._around(time_s)
        values = before.ravel()[corners]
        if share > 0.0:
            values = values + share * (after.ravel()[corners] - values)
        mixed = (weights * values).sum(axis=0) / np.where(water, total, 1.0)
        return np.where(water, mixed, np.nan)

    def _corners(self, row: FloatArray, column: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """Flat indices and bilinear weights of the four grid points around each place, shapes (4, ...)."""
        rows, columns = self.mask.land.shape
        # Cells reach half a spacing beyond the outermost points; there the field continues as a constant.
        row = np.minimum(np.maximum(row, 0.0), rows - 1.0)
        column = np.minimum(np.maximum(column, 0.0), columns - 1.0)
        i = np.minimum(row.astype(np.int64), rows - 2)
        j = np.minimum(column.astype(np.int64), columns - 2)
        v, u = row - i, column - j
        corner = i * columns + j
        indices = np.stack([corner, corner + 1, corner + columns, corner + columns + 1])
        return indices, np.stack([(1 - v) * (1 - u), (1 - v) * u, v * (1 - u), v * u])


class GriddedField(InterpolatedField):
    """A field given at grid points and instants; before the first instant and after the last it is held constant."""

    def __init__(self, info: FieldInfo, mask: LandMask, instants_s: FloatArray, frames: FloatArray) -> None:
        """Take the values.

        Args:
            info: what the field is.
            mask: the land on the grid, shape (rows, columns).
            instants_s: increasing times, shape (n,), the first 0.
            frames: values, shape (n, rows, columns), finite wherever the mask says water.
        """
        super().__init__(info, mask, (float(instants_s[0]), float(instants_s[-1])))
        self._instants_s = np.asarray(instants_s, dtype=float)
        self._frames = np.where(mask.land, 0.0, frames)

    def _around(self, time_s: float) -> tuple[FloatArray, FloatArray, float]:
        instants = self._instants_s
        if time_s <= instants[0]:
            return self._frames[0], self._frames[0], 0.0
        if time_s >= instants[-1]:
            return self._frames[-1], self._frames[-1], 0.0
        before = int(np.searchsorted(instants, time_s, side="right")) - 1
        share = float((time_s - instants[before]) / (instants[before + 1] - instants[before]))
        return self._frames[before], self._frames[before + 1], share


class ShrunkField(MaskedField):
    """The same values on a smaller piece of sea: drawn together about its centre, time unchanged."""

    def __init__(self, inner: Field, factor: float, info: FieldInfo) -> None:
        grid = ShrunkGrid(inner.mask.grid, factor)
        super().__init__(info, LandMask(grid, inner.mask.land), inner.times_s)
        self._inner = inner
        self._grid = grid
        self._factor = factor

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""
        return self._inner.value(*self._grid.expand(lat_deg, lon_deg), time_s)

    def current(self, lat_deg: float, lon_deg: float, time_s: float) -> tuple[float, float]:
        """Velocity of the water, east and north, m/s: slower by the factor by which the way is shorter."""
        lat, lon = self._grid.expand(lat_deg, lon_deg)
        east, north = self._inner.current(float(lat), float(lon), time_s)
        return east / self._factor, north / self._factor


def shrunk(field: Field, max_side_m: float = 15_000.0) -> Field:
    """The field drawn together about its centre until its longer side measures `max_side_m`.

    A field that is small enough already is returned as it is; otherwise the description says by how much.
    """
    width_m, height_m = field.bounds.size_m
    factor = max(width_m, height_m) / max_side_m
    if factor <= 1.0:
        return field
    info = field.info
    said = (
        f"{info.description}; coordinates shrunk {factor:.4g} times, "
        f"from {width_m / 1000:.4g} km x {height_m / 1000:.4g} km "
        f"to {width_m / factor / 1000:.3g} km x {height_m / factor / 1000:.3g} km"
    )
    return ShrunkField(
        field, factor, FieldInfo(info.variable, info.long_name, info.units, said, info.start_utc)
    )


def open_field(spec: str | Path, variable: str | None = None) -> Field:
    """The field that a word or a file names.

    Args:
        spec: a NetCDF file (ROMS output or CF), or `synthetic[:SEED]` (the Southern California Bight), or
            `synthetic-patch[:SEED]` (a piece of its coast, 15 km wide), or `synthetic-moving[:SEED]` (that piece with
            a current that carries the salinity along). The seed is 0 unless given.
        variable: which variable of the file; by default salinity, else temperature, else the only one.

    Raises:
        FieldError: no such file, not NetCDF, no such variable, no usable coordinates, nothing but land.
    """
    word = _SYNTHETIC.fullmatch(str(spec))
    if word is None:
        from sim.field_netcdf import open_netcdf

        return open_netcdf(Path(spec), variable)
    from sim.synthetic import bight, moving_patch, patch

    if variable not in (None, "salinity", "salt"):
        raise FieldError(f"{spec}: no variable {variable!r}; the synthetic ocean has only 'salinity'")
    seed = int(word["seed"] or 0)
    return {"": bight, "-patch": patch, "-moving": moving_patch}[word["kind"]](seed)


def lattice(field: Field, spacing_m: float) -> tuple[FloatArray, FloatArray]:
    """Axes of latitude and longitude over the field's bounds, at most `spacing_m` apart, with both ends."""
    bounds = field.bounds
    width_m, height_m = bounds.size_m
    rows = max(2, math.ceil(height_m / spacing_m) + 1)
    columns = max(2, math.ceil(width_m / spacing_m) + 1)
    return np.linspace(bounds.south, bounds.north, rows), np.linspace(bounds.west, bounds.east, columns)


__all__ = [
    "Bounds",
    "Field",
    "FieldError",
    "FieldInfo",
    "Grid",
    "GriddedField",
    "InterpolatedField",
    "LandMask",
    "MaskedField",
    "ShrunkField",
    "lattice",
    "open_field",
    "shrunk",
]
