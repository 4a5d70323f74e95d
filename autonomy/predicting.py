"""What the model says of places that somebody asks for: `usv/<vehicle>/predict`, see docs/wire.md. Knows no network."""

from typing import Any

import cbor2
import numpy as np

from autonomy.geometry import FloatArray, LocalFrame
from autonomy.wire import VERSION
from autonomy.wire_kinds import FLOAT64_TAG, WireError, brief, opened
from autonomy.wire_values import ModelSnapshot

MAXIMUM_POINTS = 20_000
BYTES_PER_POINT = 16
MAXIMUM_REQUEST = 24 * MAXIMUM_POINTS
"""Bytes of a request, at most."""
_LONGEST_S = 366 * 86_400.0
_GRID = ("south", "west", "north", "east", "rows", "columns")


def answer(request: bytes, snapshot: ModelSnapshot | None, most: int = MAXIMUM_POINTS) -> bytes:
    """The answer to a request, as CBOR: mean and standard deviation of the field at the points asked for.

    Args:
        request: may come from anybody.
        snapshot: the newest belief; None if there is none yet.
        most: points that are answered at most.

    Raises:
        WireError: the request is none, or cannot be answered; says why.
    """
    content = _content(request)
    places_deg = _places(content, min(most, MAXIMUM_POINTS))
    if snapshot is None:
        raise WireError("there is no model yet: too few readings have been learnt")
    model, utc_s = snapshot.model, snapshot.utc_s
    if "at_s" in content:
        at_s = content["at_s"]
        if utc_s is None:
            raise WireError("at_s: the vehicle does not know the time")
        if not _is_number(at_s) or not utc_s <= at_s <= utc_s + _LONGEST_S:
            raise WireError(
                f"at_s: must be from the model's time, {utc_s:.3f}, to a year later (got {brief(at_s)})"
            )
        model, utc_s = model.advanced(at_s - utc_s), float(at_s)
    frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
    points_m = frame.to_local(places_deg[:, 0], places_deg[:, 1])
    if not np.isfinite(points_m).all():
        raise WireError("points_deg: some are too far from the survey")
    prediction = model.predict(points_m)
    payload: bytes = cbor2.dumps(
        {
            "v": VERSION,
            "mean": _float64(prediction.mean),
            "sd": _float64(np.sqrt(prediction.variance)),
            "units": snapshot.units,
            "sequence": snapshot.sequence,
            "utc_s": utc_s,
        }
    )
    return payload


def _content(request: bytes) -> dict[str, Any]:
    content = opened("predict", request, maximum_bytes=MAXIMUM_REQUEST, maximum_items=100, maximum_depth=4)
    if content.get("v") != VERSION:
        raise WireError(f"predict: v: must be {VERSION} (got {brief(content.get('v'))})")
    if ("points_deg" in content) == ("grid" in content):
        raise WireError("predict: either points_deg or grid must be given")
    return content


def _places(content: dict[str, Any], most: int) -> FloatArray:
    """Latitudes and longitudes, shape (n, 2)."""
    return _grid(content["grid"], most) if "grid" in content else _points(content["points_deg"], most)


def _points(value: Any, most: int) -> FloatArray:
    if not isinstance(value, cbor2.CBORTag) or value.tag != FLOAT64_TAG or not isinstance(value.value, bytes):
        raise WireError(f"points_deg: must be an array of float64, tag {FLOAT64_TAG} (got {brief(value)})")
    if len(value.value) % 16 or not 1 <= len(value.value) // 16 <= most:
        raise WireError(f"points_deg: must have 1 to {most} times 2 float64 (got {len(value.value)} bytes)")
    points = np.frombuffer(value.value, dtype="<f8").reshape(-1, 2).astype(float)
    if not ((np.abs(points[:, 0]) <= 90.0) & (points[:, 1] >= -180.0) & (points[:, 1] <= 360.0)).all():
        raise WireError("points_deg: must be latitudes from -90 to 90 and longitudes from -180 to 360")
    return points


def _grid(value: Any, most: int) -> FloatArray:
    """Row by row from north to south, each from west to east; the edges belong to it."""
    if not isinstance(value, dict) or any(name not in value for name in _GRID):
        raise WireError(f"grid: must be a map of {', '.join(_GRID)} (got {brief(value)})")
    edges, sizes = [value[name] for name in _GRID[:4]], [value[name] for name in _GRID[4:]]
    if not all(map(_is_number, edges)):
        raise WireError(f"grid: {', '.join(_GRID[:4])} must be numbers")
    south, west, north, east = map(float, edges)
    if not (-90.0 <= south <= north <= 90.0 and -180.0 <= west <= east <= 360.0):
        raise WireError("grid: must have -90 <= south <= north <= 90 and -180 <= west <= east <= 360")
    if not all(isinstance(size, int) and not isinstance(size, bool) and size >= 1 for size in sizes):
        raise WireError("grid: rows and columns must be whole numbers above 0")
    rows, columns = sizes
    if rows * columns > most:
        raise WireError(f"grid: must have at most {most} points (got {rows} x {columns})")
    lat, lon = np.meshgrid(np.linspace(north, south, rows), np.linspace(west, east, columns), indexing="ij")
    return np.column_stack([lat.ravel(), lon.ravel()])


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12


def _float64(numbers: FloatArray) -> cbor2.CBORTag:
    return cbor2.CBORTag(FLOAT64_TAG, np.ascontiguousarray(numbers, dtype="<f8").tobytes())
