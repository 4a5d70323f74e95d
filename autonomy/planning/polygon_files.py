"""Files of polygons: GeoJSON, QGroundControl plans, KML and KMZ, told apart by name and, failing that, content."""

import json
from pathlib import Path
from typing import Any, Literal, get_args

import shapely
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from autonomy.planning.errors import SurveyError
from autonomy.planning.geojson import geojson_drawn
from autonomy.planning.kml import LARGEST_BYTES, kml_drawn, kmz_document
from autonomy.planning.qgc_plan import exclusion_polygons, inclusion_polygons, plan_drawn, survey_polygons
from autonomy.planning.rings import Drawn, shown

Role = Literal["area", "keep_in", "keep_out", "land"]
"""What the configuration wants of a file: a plan has something else for each."""

Format = Literal["JSON", "plan", "KML", "KMZ"]

_BY_SUFFIX: dict[str, Format] = {".plan": "plan", ".kml": "KML", ".kmz": "KMZ", ".geojson": "JSON"}
_MOST_BRACKETS = 2_000_000
"""Lists and objects in a JSON file: about as many positions."""

_OTHERS = {
    ".shp": "a shapefile",
    ".gpkg": "a GeoPackage",
    ".gpx": "GPX, tracks and waypoints without polygons",
    ".waypoints": "a list of waypoints",
}


def read_polygons(path: Path, role: Role) -> BaseGeometry:
    """The union of all polygons of a file.

    Args:
        path: GeoJSON, a QGroundControl .plan, KML or KMZ.
        role: which key of the configuration names it. Of a plan the area is its survey patterns, or without any
            its inclusion fence; keep-in is what its inclusion zones have in common; keep-out and land are its
            exclusion zones. Of a GeoJSON file whose features have roles it is those with this one.

    Returns:
        A valid polygon or multipolygon in degrees, x longitude, y latitude; empty only for land and keep-out,
        where a GeoJSON FeatureCollection without features is an answer.

    Raises:
        SurveyError: the file cannot be read, is larger than 32 MB, none of these formats, or a polygon in it is wrong.
    """
    content = _content(path)
    if isinstance(content, dict) and _is_plan(path, content):
        read = {"area": survey_polygons, "keep_in": inclusion_polygons}.get(role, exclusion_polygons)
        return shapely.union_all(read(path, content))
    parts = [each.shape for each in _with_role(path, _drawn(path, content), role)]
    if not parts and role in ("area", "keep_in"):
        raise SurveyError(f"{path}: has no polygon in it; at least one Polygon or MultiPolygon is needed")
    return shapely.union_all(parts) if parts else Polygon()


def read_drawn(path: Path) -> list[Drawn]:
    """Everything that is drawn in a file, each polygon for itself, with its names and, if it says so, its role.

    Of a plan survey patterns are areas, inclusion zones keep_in, exclusion zones keep_out.

    Raises:
        SurveyError: as from `read_polygons`.
    """
    content = _content(path)
    is_plan = isinstance(content, dict) and _is_plan(path, content)
    return plan_drawn(path, content) if is_plan else _drawn(path, content)


def _content(path: Path) -> Any:
    """What is in a file: a JSON object, or the bytes of a KML document."""
    data = _bytes(path)
    kind = _format(path, data)
    if kind == "KMZ":
        return kmz_document(path, data)
    return data if kind == "KML" else _json(path, data)


def _is_plan(path: Path, content: dict[str, Any]) -> bool:
    return path.suffix.lower() == ".plan" or content.get("fileType") == "Plan"


def _drawn(path: Path, content: Any) -> list[Drawn]:
    return kml_drawn(path, content) if isinstance(content, bytes) else geojson_drawn(path, content)


def _with_role(path: Path, drawn: list[Drawn], role: Role) -> list[Drawn]:
    """Those that say they are this; all of them where none says anything."""
    said = sorted({each.role for each in drawn if each.role is not None})
    if not said:
        return drawn
    silent = next((each for each in drawn if each.role is None), None)
    if silent is not None:
        raise SurveyError(
            f'{silent.where}: has no "role" ({", ".join(get_args(Role))}), which others in this file have'
        )
    if role not in said:
        raise SurveyError(f"{path}: no polygon in it has the role {role}; there is {', '.join(said)}")
    return [each for each in drawn if each.role == role]


def _bytes(path: Path) -> bytes:
    if path.suffix.lower() in _OTHERS:
        raise SurveyError(
            f"{path}: is {_OTHERS[path.suffix.lower()]}; GeoJSON, a QGroundControl .plan, KML or KMZ is needed"
        )
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise SurveyError(f"{path}: cannot be read: {error.strerror or error}") from error
    if len(data) > LARGEST_BYTES:
        raise SurveyError(
            f"{path}: is larger than {LARGEST_BYTES / 1e6:g} MB; cut it to the surroundings of the survey"
        )
    return data


def _format(path: Path, data: bytes) -> Format:
    if path.suffix.lower() in _BY_SUFFIX:
        return _BY_SUFFIX[path.suffix.lower()]
    if data.startswith(b"PK\x03\x04"):
        return "KMZ"
    text = data.removeprefix(b"\xef\xbb\xbf").lstrip()
    return "KML" if text.startswith(b"<") or data.startswith((b"\xff\xfe<", b"\xfe\xff\x00<")) else "JSON"


def _json(path: Path, data: bytes) -> dict[str, Any]:
    if data.count(b"[") + data.count(b"{") > _MOST_BRACKETS:
        raise SurveyError(
            f"{path}: has more than {_MOST_BRACKETS} positions; cut it to the surroundings of the survey"
        )
    try:
        content = json.loads(data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise SurveyError(
            f"{path}: is not UTF-8 text; GeoJSON, a QGroundControl .plan, KML or KMZ is needed"
        ) from error
    except json.JSONDecodeError as error:
        raise SurveyError(f"{path}:{error.lineno}:{error.colno}: is not JSON: {error.msg}") from error
    except RecursionError as error:
        raise SurveyError(f"{path}: is JSON nested too deeply to be polygons") from error
    except ValueError as error:
        # Whole numbers of thousands of digits.
        raise SurveyError(f"{path}: is JSON with a number that cannot be read: {shown(error)}") from error
    if not isinstance(content, dict):
        raise SurveyError(
            f"{path}: is JSON but not GeoJSON nor a plan: its outermost value must be an object {{…}}"
        )
    return content
