"""Where and when the values of a NetCDF file are: its latitudes and longitudes, as a grid, and its times."""

from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

import netCDF4
import numpy as np

from sim.curvilinear import CurvilinearGrid
from sim.field import FieldError
from sim.field_grid import FloatArray, Grid, RectilinearGrid, near
from sim.netcdf_values import decode


def is_latitude(name: str, variable: Any) -> bool:
    """Whether a variable holds latitudes, by its attributes or its name."""
    return _is_coordinate(name, variable, "latitude", "north", ("lat", "nav_lat", "lat_rho"))


def is_longitude(name: str, variable: Any) -> bool:
    """Whether a variable holds longitudes, by its attributes or its name."""
    return _is_coordinate(name, variable, "longitude", "east", ("lon", "nav_lon", "lon_rho"))


def _is_coordinate(name: str, variable: Any, standard: str, towards: str, names: tuple[str, ...]) -> bool:
    units = str(getattr(variable, "units", "")).lower()
    return (
        getattr(variable, "standard_name", "") == standard
        or units
        in {f"{word}_{letters}" for word in ("degree", "degrees") for letters in (towards, towards[0])}
        or name.lower() in (standard, *names)
    )


def coordinate_names(dataset: Any, data: Any) -> tuple[str, str]:
    """Names of a variable's latitude and longitude: those it names, else those on its dimensions."""
    words = str(getattr(data, "coordinates", "")).split()
    fitting = [
        n for n, v in dataset.variables.items() if v.dimensions and set(v.dimensions) <= set(data.dimensions)
    ]
    for names in ([n for n in fitting if n in words], fitting):
        lats = [n for n in names if is_latitude(n, dataset[n]) or n.startswith("lat_")]
        lons = [n for n in names if is_longitude(n, dataset[n]) or n.startswith("lon_")]
        pairs = [(lat, lon) for lat in lats for lon in lons if _pair_up(dataset, lat, lon)]
        if pairs:
            return pairs[0]
    raise FieldError(
        f"variable {data.name!r}{data.dimensions} has no latitude and longitude: they must lie on its "
        "dimensions and be called so (lat_rho/lon_rho, lat/lon, standard_name, or degrees_north/_east)"
    )


def _pair_up(dataset: Any, lat_name: str, lon_name: str) -> bool:
    lat, lon = dataset[lat_name], dataset[lon_name]
    return bool(
        lat.ndim == lon.ndim and (lat.ndim == 1 or (lat.ndim == 2 and lat.dimensions == lon.dimensions))
    )


def horizontal_dimensions(dataset: Any, lat_name: str, lon_name: str) -> tuple[str, str]:
    """Names of the dimensions of rows and columns."""
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


def read_grid(dataset: Any, lat_name: str, lon_name: str) -> tuple[Grid, tuple[slice, slice]]:
    """The grid, and the slices that bring rows and columns of the values into its order."""
    lat = decode(dataset[lat_name], np.asarray(dataset[lat_name][:]))
    lon = decode(dataset[lon_name], np.asarray(dataset[lon_name][:]))
    for name, values, limit in ((lat_name, lat, 90.0), (lon_name, lon, 540.0)):
        gaps = int(np.count_nonzero(np.isnan(values)))
        if gaps:
            raise FieldError(f"{name!r} lacks {gaps} of {values.size} values; every point needs a position")
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


def time_dimension(dataset: Any, data: Any) -> str | None:
    """Which of a variable's dimensions is time; None if it has no time."""
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


def read_times(dataset: Any, data: Any, dimension: str | None) -> tuple[FloatArray, datetime | None]:
    """Seconds since the first instant, shape (n,), and its UTC if the file has an epoch."""
    axis = _time_variable(dataset, data, dimension)
    if axis is None:
        if dimension is not None and len(dataset.dimensions[dimension]) > 1:
            raise FieldError(f"dimension {dimension!r} has no variable that says when its instants are")
        return np.zeros(1), None
    values = np.atleast_1d(decode(axis, np.asarray(axis[...])))
    if dimension is None:
        values = values[:1]
    if np.isnan(values).any() or not np.all(np.diff(values) > 0.0):
        raise FieldError(f"the instants of {axis.name!r} are not increasing, or some are missing")
    units = str(getattr(axis, "units", "seconds"))
    start = _epoch_time(axis, units, float(values[0])) if " since " in units else None
    return (values - values[0]) * _seconds_per(units.split(" since ")[0].strip(), axis.name), start


def _time_variable(dataset: Any, data: Any, dimension: str | None) -> Any | None:
    """The variable of the instants: that of the dimension, or the one that the data name."""
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
        dates: Any = netCDF4.num2date(
            np.array([value]),
            units,
            calendar,
            only_use_cftime_datetimes=False,
            only_use_python_datetimes=True,
        )
    except ValueError as error:
        raise FieldError(f"units {units!r} of {axis.name!r} are not understood: {error}") from error
    return datetime.fromisoformat(dates[0].isoformat()).replace(tzinfo=UTC)
