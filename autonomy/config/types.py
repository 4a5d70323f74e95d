"""Kinds of configuration values, with checks whose messages a person can act on."""

import re
from pathlib import Path
from typing import Annotated, Any

import shapely
from pydantic import AfterValidator, Discriminator, Field, Tag
from pydantic_core import PydanticCustomError

from autonomy.config.file import shown
from autonomy.endpoints import check_endpoint, parse_link

ENDPOINT_FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"
LOCATOR_FORMS = "PROTOCOL/HOST:PORT with protocol tcp, udp, tls, quic or ws"
LIMIT_FORMS = "a number above 0, .inf for no limit, or null"
AREA_FORMS = (
    "at least 3 [latitude, longitude] pairs in order round the area, or a file (GeoJSON, .plan, KML or KMZ)"
)
FOLDER = "folder"
"""Marks the name of a folder, which need not be there yet."""
SECRET = "secret"
"""Marks the name of a file that only its owner may read."""
_MAXIMUM_SPAN_DEG = 20.0


def _not_nan(value: float) -> float:
    if value != value:
        raise PydanticCustomError("nan", "must be a number, not .nan")
    return value


def _endpoint(value: str) -> str:
    try:
        parse_link(value)
    except ValueError as error:
        fault = "the port must be from 1 to 65535" if "port must" in str(error) else "not an endpoint"
        raise PydanticCustomError(
            "endpoint", "{fault} (got {value})", {"fault": fault, "value": shown(value)}
        ) from None
    return value


def _locator(value: str) -> str:
    try:
        return check_endpoint(value)
    except ValueError:
        raise PydanticCustomError(
            "locator", "not a zenoh endpoint (got {value})", {"value": shown(value)}
        ) from None


def _simple_polygon(corners: list[tuple[float, float]]) -> list[tuple[float, float]]:
    distinct = set(corners)
    if len(distinct) < 3:
        raise PydanticCustomError(
            "polygon", "needs at least 3 different corners (got {count})", {"count": len(distinct)}
        )
    lats, lons = zip(*corners, strict=True)
    span = max(max(lats) - min(lats), max(lons) - min(lons))
    if span > _MAXIMUM_SPAN_DEG:
        raise PydanticCustomError(
            "polygon",
            "spans {span} degrees, more than 20: a wrong sign or, across 180 degrees, mixed longitudes"
            " (write them from 0 to 360)",
            {"span": f"{span:g}"},
        )
    polygon = shapely.Polygon([(lon, lat) for lat, lon in corners])
    if polygon.is_valid and polygon.area > 0.0:
        return corners
    reason = shapely.is_valid_reason(polygon)
    crossing = re.fullmatch(r"Self-intersection\[(\S+) (\S+)\]", reason)
    if polygon.convex_hull.area > 0.0 and crossing:
        fault = f"its outline crosses itself at [{float(crossing[2]):.6g}, {float(crossing[1]):.6g}]"
    else:
        fault = "it encloses no area, or touches itself"
    raise PydanticCustomError("polygon", "{fault}; give the corners in order", {"fault": fault})


def _area_kind(value: Any) -> str:
    return "file" if isinstance(value, str | Path) else "corners"


Latitude = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
Longitude = Annotated[float, Field(ge=-180, le=360, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Bound = Annotated[float, AfterValidator(_not_nan)]
Limit = Annotated[float, Field(gt=0)]
# The tree is strict (no text for numbers, no 1 for true), but YAML has neither tuples nor paths.
FilePath = Annotated[Path, Field(strict=False)]
FolderPath = Annotated[Path, Field(strict=False), FOLDER]
SecretPath = Annotated[Path, Field(strict=False), SECRET]
Corner = Annotated[tuple[Latitude, Longitude], Field(strict=False)]
Corners = Annotated[list[Corner], Field(strict=False), AfterValidator(_simple_polygon)]
Locator = Annotated[str, AfterValidator(_locator)]
Endpoint = Annotated[str, AfterValidator(_endpoint)]
Area = Annotated[
    Annotated[Corners, Tag("corners")] | Annotated[FilePath, Tag("file")], Discriminator(_area_kind)
]
LatticeSide = Annotated[int, Field(ge=2, le=100)]
