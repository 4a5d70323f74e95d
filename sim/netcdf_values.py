"""Unpacked values of NetCDF variables, missing ones as NaN."""

from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from sim.field_grid import FloatArray

_NO_VALUE = 1e30  # ROMS fills with 1e37, NetCDF by default with 9.97e36


def decode(data: Any, raw: NDArray[Any]) -> FloatArray:
    """Unpacked values, NaN where missing (CF conventions 2.5.1 and 8.1)."""
    missing = np.zeros(raw.shape, dtype=bool)
    for fill in _fill_values(data, raw.dtype):
        missing |= raw == fill
    low, high = _valid_range(data, raw.dtype)
    missing |= (raw < low) | (raw > high)
    if str(getattr(data, "_Unsigned", "false")).lower() == "true" and raw.dtype.kind == "i":
        raw = raw.view(raw.dtype.str.replace("i", "u"))
    values = raw.astype(float)
    if hasattr(data, "scale_factor"):
        values = values * float(data.scale_factor)
    if hasattr(data, "add_offset"):
        values = values + float(data.add_offset)
    missing |= ~(np.abs(values) < _NO_VALUE)
    return np.where(missing, np.nan, values)


def _fill_values(data: Any, dtype: np.dtype[Any]) -> list[Any]:
    stated = [np.ravel(getattr(data, key)) for key in ("_FillValue", "missing_value") if hasattr(data, key)]
    if not stated and dtype.itemsize > 1:  # a single byte has no default fill value
        return [netCDF4.default_fillvals.get(dtype.str[1:], np.nan)]
    return [value for values in stated for value in values]


def _valid_range(data: Any, dtype: np.dtype[Any]) -> tuple[Any, Any]:
    """The valid range, where it is stated in the packed type, as CF demands; else it is ignored."""
    low: Any = -np.inf
    high: Any = np.inf
    pair = np.atleast_1d(getattr(data, "valid_range", []))
    if len(pair) == 2 and pair.dtype == dtype:
        low, high = pair[0], pair[1]
    limit = np.asarray(getattr(data, "valid_min", None))
    low = limit[()] if limit.dtype == dtype else low
    limit = np.asarray(getattr(data, "valid_max", None))
    return low, limit[()] if limit.dtype == dtype else high
