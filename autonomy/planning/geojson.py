"""GeoJSON files of polygons, read strictly: every mistake is named with file, feature and remedy."""

import json
import math
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry


class SurveyError(ValueError):
    """The survey's geometry cannot be used; the text says which file, which feature, what would be right."""


def read_polygons(path: Path, *, may_be_empty: bool = False) -> BaseGeometry:
    """The union of all polygons of a GeoJSON file.

    Args:
        path: a Feature, a FeatureCollection or a bare geometry; Polygon or MultiPolygon; longitude first.
        may_be_empty: whether a FeatureCollection without features is an answer ("no land here") or a mistake.

    Returns:
        A valid polygon or multipolygon in degrees, x longitude, y latitude; empty only if that is allowed.

    Raises:
        SurveyError: the file cannot be read, is no GeoJSON, or a feature in it is no valid polygon.
    """
    features = _features(path, _parse(path))
    if not features and not may_be_empty:
        raise SurveyError(f"{path}: has no polygon in it; at least one Polygon or MultiPolygon is needed")
    parts = [_polygons(geometry, f"{path}: {label}") for label, geometry in features]
    return shapely.union_all(parts) if parts else Polygon()


def _parse(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SurveyError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise SurveyError(f"{path}: is not UTF-8 text; a GeoJSON file is needed") from error
    except json.JSONDecodeError as error:
        raise SurveyError(f"{path}:{error.lineno}:{error.colno}: is not JSON: {error.msg}") from error
    if not isinstance(content, dict) or "type" not in content:
        raise SurveyError(
            f'{path}: is JSON but not GeoJSON: the outermost value must be an object with a "type", '
            "a FeatureCollection, a Feature, a Polygon or a MultiPolygon"
        )
    crs = json.dumps(content.get("crs"))
    if content.get("crs") is not None and "CRS84" not in crs and "4326" not in crs:
        raise SurveyError(
            f"{path}: its coordinates are in {crs}; convert it to longitude and latitude on WGS84 (EPSG:4326)"
        )
    return content


def _features(path: Path, content: dict[str, Any]) -> list[tuple[str, Any]]:
    """(label, geometry object) of everything in the file."""
    kind = content["type"]
    if kind == "Feature":
        return [(_label(content, None), content.get("geometry"))]
    if kind != "FeatureCollection":
        return [("the geometry", content)]
    features = content.get("features")
    if not isinstance(features, list):
        raise SurveyError(f'{path}: the FeatureCollection has no list "features"')
    labelled = []
    for index, feature in enumerate(features):
        if not isinstance(feature, dict) or feature.get("type") != "Feature":
            raise SurveyError(f'{path}: features[{index}] is not an object of "type": "Feature"')
        labelled.append((_label(feature, index), feature.get("geometry")))
    return labelled


def _label(feature: dict[str, Any], index: int | None) -> str:
    properties = feature.get("properties") or {}
    name = feature.get("id")
    if name is None and isinstance(properties, dict):
        name = properties.get("name")
    place = "the feature" if index is None else f"features[{index}]"
    return place if name is None else f"{place} ({name})"


def _polygons(geometry: Any, where: str) -> BaseGeometry:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise SurveyError(
            f"{where}: its geometry is {kind or 'missing'}; a Polygon or a MultiPolygon is needed"
        )
    coordinates = geometry.get("coordinates")
    polygons = [coordinates] if kind == "Polygon" else coordinates
    if not isinstance(polygons, list) or not all(isinstance(rings, list) and rings for rings in polygons):
        raise SurveyError(f'{where}: "coordinates" must be a list of rings, the outer one first')
    shapes = [Polygon(*_rings(rings, where)) for rings in polygons]
    shape = shapes[0] if len(shapes) == 1 else MultiPolygon(shapes)
    if shape.is_empty:
        raise SurveyError(f"{where}: has no area")
    if not shape.is_valid:
        raise SurveyError(
            f"{where}: is not a valid polygon: {shapely.is_valid_reason(shape)} (longitude latitude); "
            "rings must not cross themselves or each other"
        )
    return shape


def _rings(rings: list[Any], where: str) -> tuple[list[tuple[float, float]], list[list[tuple[float, float]]]]:
    read = [_ring(ring, f"{where}, ring {index}") for index, ring in enumerate(rings)]
    return read[0], read[1:]


def _ring(ring: Any, where: str) -> list[tuple[float, float]]:
    if not isinstance(ring, list) or len(ring) < 4:
        raise SurveyError(f"{where}: needs at least four positions, the last equal to the first")
    positions = [_position(position, f"{where}, position {index}") for index, position in enumerate(ring)]
    if positions[0] != positions[-1]:
        raise SurveyError(f"{where}: is not closed: its last position must equal its first")
    return positions


def _position(position: Any, where: str) -> tuple[float, float]:
    numbers = position[:2] if isinstance(position, list) else []
    if len(numbers) < 2 or not all(
        isinstance(n, (int, float)) and not isinstance(n, bool) and math.isfinite(n) for n in numbers
    ):
        raise SurveyError(
            f"{where}: {json.dumps(position)} is not a position; [longitude, latitude] is needed"
        )
    lon_deg, lat_deg = float(numbers[0]), float(numbers[1])
    if not -90.0 <= lat_deg <= 90.0:
        raise SurveyError(
            f"{where}: {json.dumps(position)}: {lat_deg:g} is no latitude; GeoJSON has the longitude first, "
            "then the latitude, in degrees"
        )
    if not -180.0 <= lon_deg <= 360.0:
        raise SurveyError(f"{where}: {json.dumps(position)}: {lon_deg:g} is no longitude in degrees")
    return lon_deg, lat_deg
