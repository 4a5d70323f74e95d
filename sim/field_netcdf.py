"""Fields from NetCDF: ROMS as ROMS writes it, and CF files on regular or curvilinear grids.

What is read: the surface level of one variable, its horizontal coordinates, its times, and the land. The land is the
file's mask where it has one (land is often *not* filled in the variable), and in any case every cell that has no
value at any time. A cell that lacks a value only at some times (clouds) is bridged linearly in time.
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cftime
import netCDF4
import numpy as np
from numpy.typing import NDArray

from sim.field import FieldError, FieldInfo, GriddedField
from sim.field_grid import BoolArray, CurvilinearGrid, FloatArray, Grid, LandMask, RectilinearGrid, near

_PREFERRED = (
    "salt",
    "salinity",
    "so",
    "sss",
    "temp",
    "temperature",
    "thetao",
    "analysed_sst",
    "sst",
    "chlor_a",
)
_SEA_MASKS = ("mask_rho", "mask_u", "mask_v", "mask_psi", "tmask", "wet", "sea_mask", "ocean_mask")
_LAND_MASKS = ("land", "land_mask", "landmask", "lsm")
_NO_VALUE = 1e30  # ROMS fills with 1e37, NetCDF by default with 9.97e36
_LARGEST_VALUES = 250_000_000
_LAND_WORDS = ("land", "on_land")


def open_netcdf(path: Path, variable: str | None = None) -> GriddedField:
    """The surface of one variable of a NetCDF file.

    Raises:
        FieldError: with the file's name and what is missing or wrong in it.
    """
    if not path.is_file():
        raise FieldError(f"{path}: no such file (or give synthetic[:SEED] or synthetic-patch[:SEED])")
    try:
        dataset = netCDF4.Dataset(str(path))
    except OSError as error:
        raise FieldError(f"{path}: not a NetCDF file ({error})") from error
    with dataset:
        dataset.set_auto_maskandscale(
            False
        )  # decoded here: real files have fill values their type cannot hold
        try:
            return _read(dataset, path, variable)
        except FieldError as error:
            raise FieldError(f"{path}: {error}") from error


def _read(dataset: Any, path: Path, variable: str | None) -> GriddedField:
    name = variable or _default_variable(dataset)
    if name not in dataset.variables:
        raise FieldError(
            f"no variable {name!r}; on a horizontal grid there are: {_list(_candidates(dataset))}"
        )
    data = dataset[name]
    lat_name, lon_name = _coordinate_names(dataset, data)
    horizontal = _horizontal_dimensions(dataset, lat_name, lon_name)
    time_dimension = _time_dimension(dataset, data)
    frames = _surface(dataset, data, time_dimension, horizontal)
    instants_s, start_utc = _times(dataset, data, time_dimension)
    masked = _land_mask(dataset, data, horizontal)
    land = np.isnan(frames).all(axis=0) if masked is None else masked | np.isnan(frames).all(axis=0)
    if land.all():
        raise FieldError(f"{name!r} is land or missing everywhere")
    grid, flips = _grid(dataset, lat_name, lon_name, horizontal)
    info = FieldInfo(
        variable=name,
        long_name=str(getattr(data, "long_name", "") or getattr(data, "standard_name", "") or name),
        units=str(getattr(data, "units", "")),
        description=f"{path.name}: {name}, {land.shape[0]} x {land.shape[1]} points, {len(frames)} instants",
        start_utc=start_utc,
    )
    frames = _bridge_gaps(np.ascontiguousarray(frames[(slice(None), *flips)]), instants_s)
    return GriddedField(info, LandMask(grid, np.ascontiguousarray(land[flips])), instants_s, frames)


# --- values -----------------------------------------------------------------------------------------------------------


def _decode(data: Any, raw: NDArray[Any]) -> FloatArray:
    """Unpacked values, NaN where missing (CF conventions 2.5.1 and 8.1)."""
    if str(getattr(data, "_Unsigned", "false")).lower() == "true" and raw.dtype.kind == "i":
        raw = raw.view(np.dtype(f"{raw.dtype.byteorder}u{raw.dtype.itemsize}"))
    missing = np.zeros(raw.shape, dtype=bool)
    fills = [
        np.atleast_1d(getattr(data, key)) for key in ("_FillValue", "missing_value") if hasattr(data, key)
    ]
    if not fills and raw.dtype.itemsize > 1:
        fills = [np.atleast_1d(netCDF4.default_fillvals.get(raw.dtype.str[1:], np.nan))]
    for fill in (value for values in fills for value in values):
        missing |= raw == fill
    low, high = _valid_range(data, raw.dtype)
    missing |= (raw < low) | (raw > high)
    values = raw.astype(float)
    if hasattr(data, "scale_factor"):
        values = values * float(data.scale_factor)
    if hasattr(data, "add_offset"):
        values = values + float(data.add_offset)
    missing |= ~(np.abs(values) < _NO_VALUE)
    return np.where(missing, np.nan, values)


def _valid_range(data: Any, dtype: np.dtype[Any]) -> tuple[Any, Any]:
    """The valid range, where it is stated in the packed type, as CF demands; files that state it otherwise err."""
    low, high = -np.inf, np.inf
    pair = np.atleast_1d(getattr(data, "valid_range", []))
    if len(pair) == 2 and pair.dtype == dtype:
        low, high = pair[0], pair[1]
    limit = np.asarray(getattr(data, "valid_min", None))
    low = limit[()] if limit.dtype == dtype else low
    limit = np.asarray(getattr(data, "valid_max", None))
    return low, limit[()] if limit.dtype == dtype else high


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
            f"{data.name!r} has {count} surface values; at most {_LARGEST_VALUES} fit: cut the file down"
        )
    values = _decode(data, np.asarray(data[tuple(selection)]))
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
            return int(np.nanargmin(np.abs(_decode(axis, np.asarray(axis[:])))))
    if dimension in ("s_rho", "s_w"):
        return size - 1
    if dimension.startswith("depth"):
        return 0
    raise FieldError(
        f"dimension {dimension!r} has {size} entries and is no depth: cut the file down to one of them"
    )


def _bridge_gaps(frames: FloatArray, instants_s: FloatArray) -> FloatArray:
    """Fill, in place, cells that lack a value at some times only: linear in time, constant beyond the ends."""
    known = np.isfinite(frames)
    for i, j in np.argwhere(known.any(axis=0) & ~known.all(axis=0)):
        has = known[:, i, j]
        frames[:, i, j] = np.interp(instants_s, instants_s[has], frames[has, i, j])
    return frames


# --- land -------------------------------------------------------------------------------------------------------------


def _land_mask(dataset: Any, data: Any, horizontal: tuple[str, str]) -> BoolArray | None:
    """Land by the file's own mask on the same grid; None when it has none."""
    for name, mask in dataset.variables.items():
        if not set(horizontal) <= set(mask.dimensions) or name == data.name:
            continue
        land = _read_mask(name, mask, horizontal)
        if land is not None:
            return land
    return None


def _read_mask(name: str, mask: Any, horizontal: tuple[str, str]) -> BoolArray | None:
    standard_name = getattr(mask, "standard_name", "")
    selection = tuple(slice(None) if d in horizontal else 0 for d in mask.dimensions)
    meanings = str(getattr(mask, "flag_meanings", "")).split()
    is_sea_mask = name in _SEA_MASKS or standard_name == "sea_binary_mask"
    is_land_mask = name in _LAND_MASKS or standard_name == "land_binary_mask"
    by_bits = name == "mask" and hasattr(mask, "flag_masks") and "land" in meanings
    by_flags = name == "mask" and hasattr(mask, "flag_values") and any(w in _LAND_WORDS for w in meanings)
    if not (is_sea_mask or is_land_mask or by_bits or by_flags):
        return None
    raw = np.asarray(mask[selection])
    if [d for d in mask.dimensions if d in horizontal] != list(horizontal):
        raw = raw.T
    if by_bits:
        return (
            np.asarray(raw.astype(np.int64) & int(np.atleast_1d(mask.flag_masks)[meanings.index("land")]))
            != 0
        )
    if by_flags:
        values = np.atleast_1d(mask.flag_values)
        return np.isin(raw, [v for v, word in zip(values, meanings, strict=True) if word in _LAND_WORDS])
    values = _decode(mask, raw)
    # A mask that is missing where it is not 1 means the other thing there. Packed masks are 0 and 1 only nearly.
    return ~(values > 0.5) if is_sea_mask else values > 0.5


# --- coordinates ------------------------------------------------------------------------------------------------------


def _is_latitude(name: str, variable: Any) -> bool:
    units = str(getattr(variable, "units", "")).lower()
    return (
        getattr(variable, "standard_name", "") == "latitude"
        or units in ("degrees_north", "degree_north", "degree_n", "degrees_n")
        or name.lower() in ("lat", "latitude", "nav_lat", "lat_rho")
    )


def _is_longitude(name: str, variable: Any) -> bool:
    units = str(getattr(variable, "units", "")).lower()
    return (
        getattr(variable, "standard_name", "") == "longitude"
        or units in ("degrees_east", "degree_east", "degree_e", "degrees_e")
        or name.lower() in ("lon", "longitude", "nav_lon", "lon_rho")
    )


def _coordinate_names(dataset: Any, data: Any) -> tuple[str, str]:
    """Names of latitude and longitude of a variable: those it names itself, else those on its own dimensions."""
    named = [n for n in str(getattr(data, "coordinates", "")).split() if n in dataset.variables]
    fitting = [
        n for n, v in dataset.variables.items() if v.dimensions and set(v.dimensions) <= set(data.dimensions)
    ]
    for names in (named, fitting):
        lats = [n for n in names if _is_latitude(n, dataset[n]) or n.startswith("lat_")]
        lons = [n for n in names if _is_longitude(n, dataset[n]) or n.startswith("lon_")]
        pairs = [(lat, lon) for lat in lats for lon in lons if _pair_up(dataset, lat, lon)]
        if pairs:
            return pairs[0]
    raise FieldError(
        f"variable {data.name!r}{data.dimensions} has no latitude and longitude: they must lie on its dimensions and "
        "be named as such (lat_rho/lon_rho, lat/lon, standard_name, or units degrees_north/degrees_east)"
    )


def _pair_up(dataset: Any, lat_name: str, lon_name: str) -> bool:
    lat, lon = dataset[lat_name], dataset[lon_name]
    return bool(
        lat.ndim == lon.ndim and (lat.ndim == 1 or (lat.ndim == 2 and lat.dimensions == lon.dimensions))
    )


def _horizontal_dimensions(dataset: Any, lat_name: str, lon_name: str) -> tuple[str, str]:
    lat, lon = dataset[lat_name], dataset[lon_name]
    rows, columns = (lat.dimensions[0], lon.dimensions[0]) if lat.ndim == 1 else lat.dimensions
    for dimension in (rows, columns):
        if len(dataset.dimensions[dimension]) < 2:
            raise FieldError(f"dimension {dimension!r} has one point only; a field needs at least 2 x 2")
    if rows == columns:
        raise FieldError(
            f"{lat_name!r} and {lon_name!r} both lie on {rows!r}: a list of stations is not a grid"
        )
    return str(rows), str(columns)


def _grid(
    dataset: Any, lat_name: str, lon_name: str, horizontal: tuple[str, str]
) -> tuple[Grid, tuple[slice, slice]]:
    """The grid, and the slices that bring rows and columns of the values into its order."""
    lat = _decode(dataset[lat_name], np.asarray(dataset[lat_name][:]))
    lon = _decode(dataset[lon_name], np.asarray(dataset[lon_name][:]))
    for name, values, limit in ((lat_name, lat, 90.0), (lon_name, lon, 540.0)):
        gaps = int(np.count_nonzero(np.isnan(values)))
        if gaps:
            raise FieldError(
                f"{name!r} lacks {gaps} of {values.size} values; every grid point needs a position"
            )
        if np.ptp(values) == 0.0:
            raise FieldError(f"{name!r} is {values.flat[0]:g} everywhere: it was never written")
        if np.abs(values).max() > limit:
            raise FieldError(f"{name!r} reaches {np.abs(values).max():g}, which is no angle in degrees")
    if lat.ndim == 2:
        lat_axis, lon_axis = lat[:, 0], near(lon[0], float(lon[0, 0]))
        turned = near(lon, float(lon[0, 0])) - lon_axis
        if max(np.abs(lat - lat_axis[:, None]).max(), np.abs(turned).max()) > 1e-9:
            return _curvilinear(lat, lon), (slice(None), slice(None))
        lat, lon = lat_axis, lon_axis
    return _rectilinear(lat, lon, lat_name, lon_name)


def _curvilinear(lat: FloatArray, lon: FloatArray) -> Grid:
    try:
        return CurvilinearGrid(lat, lon)
    except ValueError as error:
        raise FieldError(f"the curvilinear grid is unusable: {error}") from error


def _rectilinear(
    lat: FloatArray, lon: FloatArray, lat_name: str, lon_name: str
) -> tuple[Grid, tuple[slice, slice]]:
    lon = np.unwrap(lon, period=360.0)
    flips = []
    for name, axis in ((lat_name, lat), (lon_name, lon)):
        steps = np.diff(axis)
        if not (np.all(steps > 0.0) or np.all(steps < 0.0)):
            raise FieldError(f"{name!r} neither rises nor falls throughout")
        flips.append(slice(None, None, 1 if steps[0] > 0.0 else -1))
    lon = lon[flips[1]]
    middle = 0.5 * (lon[0] + lon[-1])
    lon = lon - 360.0 * np.round(middle / 360.0)
    return RectilinearGrid(lat[flips[0]], lon), (flips[0], flips[1])


# --- times ------------------------------------------------------------------------------------------------------------


def _time_dimension(dataset: Any, data: Any) -> str | None:
    for dimension in data.dimensions:
        axis = dataset.variables.get(dimension)
        says_so = axis is not None and (
            getattr(axis, "standard_name", "") == "time"
            or str(getattr(axis, "axis", "")).upper() == "T"
            or " since " in str(getattr(axis, "units", ""))
        )
        if says_so or "time" in dimension.lower() or dimension == getattr(data, "time", None):
            return str(dimension)
    return None


def _times(dataset: Any, data: Any, dimension: str | None) -> tuple[FloatArray, datetime | None]:
    """Seconds since the first instant, shape (n,), and its UTC if the file has an epoch."""
    axis = _time_variable(dataset, data, dimension)
    if axis is None:
        if dimension is not None and len(dataset.dimensions[dimension]) > 1:
            raise FieldError(f"dimension {dimension!r} has no variable that says when its instants are")
        return np.zeros(1), None
    values = np.atleast_1d(_decode(axis, np.asarray(axis[...])))
    if dimension is None:
        values = values[:1]
    if np.isnan(values).any() or not np.all(np.diff(values) > 0.0):
        raise FieldError(f"the instants of {axis.name!r} are not increasing, or some are missing")
    units = str(getattr(axis, "units", "seconds"))
    start = _epoch_time(axis, units, float(values[0])) if " since " in units else None
    return (values - values[0]) * _seconds_per(units.split(" since ")[0].strip(), axis.name), start


def _time_variable(dataset: Any, data: Any, dimension: str | None) -> Any | None:
    """The variable of the instants: that of the dimension, or the one that the data name, or the only one on it."""
    names: Iterable[str] = (dimension or "", str(getattr(data, "time", "")), "ocean_time", "time")
    for name in names:
        axis = dataset.variables.get(name)
        if axis is not None and axis.dimensions in ((), (dimension,)) and axis.dtype.kind in "fiu":
            return axis
    return None


def _seconds_per(unit: str, name: str) -> float:
    singular = unit.lower().rstrip("s") or "second"
    known = {
        **dict.fromkeys(("second", "sec"), 1.0),
        **dict.fromkeys(("minute", "min"), 60.0),
        **dict.fromkeys(("hour", "hr", "h"), 3600.0),
        **dict.fromkeys(("day", "d"), 86400.0),
        **dict.fromkeys(("millisecond", "msec", "m"), 1e-3),
    }
    if singular not in known:
        raise FieldError(f"unit {unit!r} of {name!r} is not understood; seconds, minutes, hours or days are")
    return known[singular]


def _epoch_time(axis: Any, units: str, value: float) -> datetime | None:
    """UTC of one instant; None when the file's calendar is not the world's (a model year of 360 days)."""
    calendar = str(getattr(axis, "calendar", "standard")).lower()
    if calendar not in ("standard", "gregorian", "proleptic_gregorian"):
        return None
    try:
        date = cftime.num2pydate(value, units, calendar=calendar)
    except ValueError as error:
        raise FieldError(f"units {units!r} of {axis.name!r} are not understood: {error}") from error
    return datetime(*date.timetuple()[:6], date.microsecond, tzinfo=UTC)


# --- which variable ---------------------------------------------------------------------------------------------------


def _candidates(dataset: Any) -> list[str]:
    """Variables on a horizontal grid that are not themselves coordinates or masks."""
    found = []
    for name, variable in dataset.variables.items():
        if variable.ndim < 2 or variable.dtype.kind not in "fiu" or _is_latitude(name, variable):
            continue
        if _is_longitude(name, variable) or name.startswith(("lat_", "lon_", "mask")) or name in _LAND_MASKS:
            continue
        try:
            _horizontal_dimensions(dataset, *_coordinate_names(dataset, variable))
        except FieldError:
            continue
        found.append(str(name))
    return found


def _default_variable(dataset: Any) -> str:
    candidates = _candidates(dataset)
    for name in _PREFERRED:
        if name in candidates:
            return name
    if len(candidates) == 1:
        return candidates[0]
    if not candidates:
        raise FieldError("no variable lies on a grid of latitude and longitude")
    raise FieldError(f"name the variable to read, one of: {_list(candidates)}")


def _list(names: list[str]) -> str:
    return ", ".join(names) if names else "none"
