"""Fields from NetCDF: ROMS as ROMS writes it, and CF files on regular or curvilinear grids.

What is read: the surface level of one variable, its horizontal coordinates, its times, and the land. The land
is the file's mask where it has one (land is often *not* filled in the variable), and in any case every cell
that has no value at any time. A cell that lacks a value only at some times (clouds) is bridged linearly in
time.
"""

import math
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from sim.field import FieldError, FieldInfo, GriddedField
from sim.field_grid import BoolArray, FloatArray, LandMask
from sim.netcdf_coordinates import (
    coordinate_names,
    horizontal_dimensions,
    is_latitude,
    is_longitude,
    read_grid,
    read_times,
    time_dimension,
)
from sim.netcdf_guard import check_readable
from sim.netcdf_land import LAND_MASKS, land_mask
from sim.netcdf_values import decode

_SALINITY = ("salt", "salinity", "so", "sss", "SSS", "SALT")
_TEMPERATURE = ("temp", "temperature", "thetao", "analysed_sst", "sst", "TEMP")
_LARGEST_VALUES = 250_000_000
_ALWAYS_READ = 1_000_000
_DAMAGE = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RuntimeError, OSError)


def open_netcdf(path: Path, variable: str | None = None) -> GriddedField:
    """The surface of one variable of a NetCDF file, which is tried in a process of its own first.

    Raises:
        FieldError: with the file's name and what is missing or wrong in it.
    """
    if not path.is_file():
        raise FieldError(
            f"{path}: no such file (or give synthetic[:SEED], synthetic-patch[:SEED] or synthetic-moving[:SEED])"
        )
    check_readable(path, variable, read_unguarded)
    return read_unguarded(path, variable)


def read_unguarded(path: Path, variable: str | None) -> GriddedField:
    """The same, here and now: a damaged file may hang the library. FieldError as there."""
    try:
        dataset = netCDF4.Dataset(str(path))
    except (OSError, RuntimeError, ValueError) as error:
        raise FieldError(f"{path}: not a NetCDF file, or a damaged one ({error})") from error
    with dataset:
        # Decoded here, not by the library: real files have fill values that their own type cannot hold.
        dataset.set_auto_maskandscale(False)
        try:
            _check_size(dataset, path.stat().st_size)
            return _read(dataset, path, variable)
        except FieldError as error:
            raise FieldError(f"{path}: {error}") from error
        except _DAMAGE as error:
            # What the library gives of a damaged file may be anything: text that is none, lists for numbers …
            raise FieldError(f"{path}: it is damaged ({type(error).__name__}: {error})") from error


def _check_size(dataset: Any, file_bytes: int) -> None:
    """A cut file claims more than it has, and a damaged one perhaps more than there is memory for.

    Variables of a NetCDF 4 file may be compressed, by a thousand at most, or never have been written.
    """
    packing = 1 if dataset.data_model.startswith("NETCDF3") else 1100
    counts = {name: math.prod(variable.shape) for name, variable in dataset.variables.items()}
    claimed = sum(
        count * getattr(dataset[name].dtype, "itemsize", 1)
        for name, count in counts.items()
        if packing == 1 or count > _ALWAYS_READ
    )
    if claimed > packing * file_bytes:
        raise FieldError(f"its variables take {claimed} bytes, and it has {file_bytes}: it is cut or damaged")


def _read(dataset: Any, path: Path, variable: str | None) -> GriddedField:
    name = variable or _default_variable(dataset)
    if name not in dataset.variables:
        raise FieldError(
            f"no variable {name!r}; on a horizontal grid there are: {_list(_candidates(dataset))}"
        )
    data = dataset[name]
    lat_name, lon_name = coordinate_names(dataset, data)
    horizontal = horizontal_dimensions(dataset, lat_name, lon_name)
    time = time_dimension(dataset, data)
    frames = _surface(dataset, data, time, horizontal)
    instants_s, start_utc = read_times(dataset, data, time)
    masked = land_mask(dataset, data, horizontal)
    empty: BoolArray = np.asarray(np.isnan(frames).all(axis=0))
    land = empty if masked is None else empty | masked
    if land.all():
        raise FieldError(f"{name!r} is land or missing everywhere")
    grid, flips = read_grid(dataset, lat_name, lon_name)
    info = FieldInfo(
        variable=name,
        long_name=str(getattr(data, "long_name", "") or getattr(data, "standard_name", "") or name),
        units=str(getattr(data, "units", "")),
        description=f"{path.name}: {name}, {land.shape[0]} x {land.shape[1]} points, {len(frames)} instants",
        start_utc=start_utc,
    )
    frames = _bridge_gaps(np.ascontiguousarray(frames[(slice(None), *flips)]), instants_s)
    return GriddedField(info, LandMask(grid, np.ascontiguousarray(land[flips])), instants_s, frames)


def _surface(dataset: Any, data: Any, time: str | None, horizontal: tuple[str, str]) -> FloatArray:
    """Values of the surface, shape (times, rows, columns)."""
    selection: list[int | slice] = []
    kept: list[str] = []
    for dimension, size in zip(data.dimensions, data.shape, strict=True):
        if dimension in horizontal or dimension == time:
            selection.append(slice(None))
            kept.append(dimension)
        else:
            selection.append(_level(dataset, dimension, size))
    count = int(np.prod([len(dataset.dimensions[d]) for d in kept]))
    if count > _LARGEST_VALUES:
        raise FieldError(
            f"{data.name!r} has {count} surface values; at most {_LARGEST_VALUES} fit: cut it down"
        )
    values = decode(data, np.asarray(data[tuple(selection)]))
    if time is None:
        values, kept = values[None], ["", *kept]
    wanted = [kept[0] if time is None else time, *horizontal]
    return np.transpose(values, [kept.index(d) for d in wanted])


def _level(dataset: Any, dimension: str, size: int) -> int:
    """The index nearest to the sea surface along a dimension that is neither time nor horizontal."""
    if size == 1:
        return 0
    axis = dataset.variables.get(dimension)
    if axis is not None and axis.dimensions == (dimension,) and axis.dtype.kind in "fiu":
        vertical = hasattr(axis, "positive") or str(getattr(axis, "axis", "")).upper() == "Z"
        name = f"{dimension} {getattr(axis, 'standard_name', '')} {getattr(axis, 'long_name', '')}".lower()
        if vertical or any(word in name for word in ("depth", "s_rho", "sigma", "s-coord", "lev", "height")):
            # Depths, heights and s-coordinates are all zero at the surface.
            return int(np.nanargmin(np.abs(decode(axis, np.asarray(axis[:])))))
    if dimension in ("s_rho", "s_w"):
        return size - 1
    if dimension.startswith("depth"):
        return 0
    raise FieldError(
        f"dimension {dimension!r} has {size} entries and is no depth: cut the file to one of them"
    )


def _bridge_gaps(frames: FloatArray, instants_s: FloatArray) -> FloatArray:
    """Fill, in place, cells that lack a value at some times: linear in time, constant beyond the ends."""
    known = np.isfinite(frames)
    for i, j in np.argwhere(known.any(axis=0) & ~known.all(axis=0)):
        has = known[:, i, j]
        frames[:, i, j] = np.interp(instants_s, instants_s[has], frames[has, i, j])
    return frames


def _candidates(dataset: Any) -> list[str]:
    """Variables on a horizontal grid that are not themselves coordinates or masks."""
    found = []
    for name, variable in dataset.variables.items():
        if variable.ndim < 2 or variable.dtype.kind not in "fiu" or is_latitude(name, variable):
            continue
        if is_longitude(name, variable) or name.startswith(("lat_", "lon_", "mask")) or name in LAND_MASKS:
            continue
        try:
            horizontal_dimensions(dataset, *coordinate_names(dataset, variable))
        except FieldError:
            continue
        found.append(str(name))
    return found


def _default_variable(dataset: Any) -> str:
    candidates = _candidates(dataset)
    for name in _SALINITY + _TEMPERATURE:
        if name in candidates:
            return name
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        raise FieldError("no variable lies on a grid of latitude and longitude")
    raise FieldError(f"name the variable to read, one of: {_list(candidates)}")


def _list(names: list[str]) -> str:
    return ", ".join(names) if names else "none"
