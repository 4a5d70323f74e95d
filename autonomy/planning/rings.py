"""Positions, rings and polygons out of files, the same checks for every format."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from autonomy.planning.errors import SurveyError

Position = tuple[float, float]
"""Longitude, latitude in degrees."""

_SHOWN = 60
"""Characters of a file's own text that go into a message."""


@dataclass(frozen=True)
class Drawn:
    """What somebody has drawn.

    Attributes:
        where: file and place in it.
        shape: a valid polygon or multipolygon in degrees, x longitude, y latitude.
        names: its own, then those of the folders that it lies in, the innermost first.
        role: what it says itself that it is: area, keep_in, keep_out or land; None: nothing.
    """

    where: str
    shape: BaseGeometry
    names: tuple[str, ...] = ()
    role: str | None = None


def shown(text: object) -> str:
    """A piece of a file as one short printable line."""
    line = "".join(c if c.isprintable() else "?" for c in str(text)[: _SHOWN + 1])
    return line if len(line) <= _SHOWN else f"{line[:_SHOWN]}…"


def finite(value: Any) -> float | None:
    """A number of a JSON file as a float; None for everything else, NaN, infinity and truth values included."""
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def position(lon_deg: float, lat_deg: float, where: str, text: str, order: str) -> Position:
    """A position on earth.

    Args:
        lon_deg, lat_deg: as read.
        where: file and place in it.
        text: the position as it stands there.
        order: what comes first in this format, for whoever mixed them up.

    Raises:
        SurveyError: there is no such place.
    """
    if not -90.0 <= lat_deg <= 90.0:
        raise SurveyError(f"{where}: {shown(text)}: {lat_deg:g} is no latitude; {order}, in degrees")
    if not -180.0 <= lon_deg <= 360.0:
        raise SurveyError(f"{where}: {shown(text)}: {lon_deg:g} is no longitude in degrees; {order}")
    return lon_deg, lat_deg


def check_closed(ring: Sequence[Position], where: str) -> None:
    """Raise SurveyError unless a ring has four positions or more and ends where it began."""
    if len(ring) < 4:
        raise SurveyError(f"{where}: needs at least four positions, the last equal to the first")
    if ring[0] != ring[-1]:
        raise SurveyError(f"{where}: is not closed: its last position must equal its first")


def area_of(polygons: Sequence[Sequence[Sequence[Position]]], where: str) -> BaseGeometry:
    """One valid polygon or multipolygon of polygons, each a list of rings, the outer one first.

    Raises:
        SurveyError: it has no area, or rings cross themselves or each other.
    """
    shapes = [Polygon(rings[0], rings[1:]) for rings in polygons]
    shape = shapes[0] if len(shapes) == 1 else MultiPolygon(shapes)
    if shape.is_empty:
        raise SurveyError(f"{where}: has no area")
    if not shape.is_valid:
        raise SurveyError(
            f"{where}: is not a valid polygon: {shapely.is_valid_reason(shape)} (longitude latitude); "
            "rings must not cross themselves or each other"
        )
    return shape
