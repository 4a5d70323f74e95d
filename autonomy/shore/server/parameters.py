"""What a request asks for: each parameter checked, with what would be right in the refusal."""

import math

from aiohttp import web

from autonomy.shore.server.maps import Extent
from autonomy.wire import VEHICLE_NAME

MAXIMUM_SIDE = 2000
MAXIMUM_CELLS = 1_000_000
_DEFAULT_SIDE = 200
_WIDEST_DEG = 30.0


class ParameterError(ValueError):
    """A request that can't be meant; says which parameter is wrong, and what would be right."""


def vehicle(request: web.Request) -> str:
    """The vehicle that the request is about."""
    return _name(request.match_info["vehicle"])


def _name(text: str) -> str:
    if not VEHICLE_NAME.fullmatch(text):
        raise ParameterError(f"vehicle: must match {VEHICLE_NAME.pattern}")
    return text


def vehicles(request: web.Request) -> frozenset[str] | None:
    """The vehicles named, None where none is: all."""
    text = request.query.get("vehicles", "")
    names = [name for name in text.split(",") if name]
    if len(names) > 64:
        raise ParameterError(f"vehicles: at most 64, not {len(names)}; none for all")
    return frozenset(map(_name, names)) or None


def known(request: web.Request, *names: str) -> None:
    """Refuse parameters that nobody reads, and those given twice."""
    for name in request.query:
        if name not in names:
            raise ParameterError(
                f"{name[:40]!a}: not a parameter of this; there are {', '.join(names) or 'none'}"
            )
        if len(request.query.getall(name)) > 1:
            raise ParameterError(f"{name}: given more than once")


def number(request: web.Request, name: str, low: float, high: float, default: float | None = None) -> float:
    """A number of the query within bounds."""
    text = request.query.get(name)
    if text is None:
        if default is None:
            raise ParameterError(f"{name}: is missing")
        return default
    try:
        value = float(text) if len(text) <= 40 else math.nan
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise ParameterError(f"{name}: must be a number from {low:g} to {high:g}")
    return value


def whole(request: web.Request, name: str, low: int, high: int, default: int) -> int:
    """A whole number of the query within bounds."""
    text = request.query.get(name)
    if text is None:
        return default
    if not (text.isascii() and text.isdecimal() and len(text) <= 9 and low <= int(text) <= high):
        raise ParameterError(f"{name}: must be a whole number from {low} to {high}")
    return int(text)


def moment(request: web.Request) -> float | None:
    """Seconds since 1970; None for now."""
    if request.query.get("at", "now") == "now":
        return None
    return number(request, "at", 0.0, 1e11)


def extent(request: web.Request, bounds: dict[str, float]) -> Extent:
    """The rectangle and its cells; what is not given is that of the survey."""
    south = number(request, "south", -90.0, 90.0, bounds["south"])
    north = number(request, "north", -90.0, 90.0, bounds["north"])
    west = number(request, "west", -180.0, 360.0, bounds["west"])
    east = number(request, "east", -180.0, 360.0, bounds["east"])
    if not (0.0 < north - south <= _WIDEST_DEG and 0.0 < east - west <= _WIDEST_DEG):
        raise ParameterError(
            f"south, west, north, east: south must be below north, and west below east, "
            f"by {_WIDEST_DEG:g} degrees at most"
        )
    rows = whole(request, "rows", 1, MAXIMUM_SIDE, _DEFAULT_SIDE)
    columns = whole(request, "columns", 1, MAXIMUM_SIDE, _DEFAULT_SIDE)
    if rows * columns > MAXIMUM_CELLS:
        raise ParameterError(f"rows, columns: at most {MAXIMUM_CELLS} cells in all, not {rows * columns}")
    return Extent(south, west, north, east, rows, columns)
