"""GeoJSON polygons (RFC 7946), read strictly: every mistake is named with file, feature and remedy."""

import json
from pathlib import Path
from typing import Any

from shapely.geometry.base import BaseGeometry

from autonomy.planning.errors import SurveyError
from autonomy.planning.rings import Drawn, Position, area_of, check_closed, finite, position, shown

ROLES = ("area", "keep_in", "keep_out", "land")
"""What the property `role` of a feature may say of its polygons; anything else there is somebody else's."""

_ORDER = "GeoJSON has the longitude first, then the latitude"


def geojson_drawn(path: Path, content: dict[str, Any]) -> list[Drawn]:
    """The features of a GeoJSON file.

    Args:
        path: where it came from, for messages.
        content: a Feature, a FeatureCollection or a bare geometry; Polygon or MultiPolygon; longitude first.

    Returns:
        One for each feature, with its name and role; none for an empty collection.

    Raises:
        SurveyError: it is no GeoJSON, or a feature in it is no valid polygon.
    """
    if "type" not in content:
        raise SurveyError(
            f'{path}: is JSON but not GeoJSON: the outermost value must be an object with a "type", '
            "a FeatureCollection, a Feature, a Polygon or a MultiPolygon"
        )
    crs = content.get("crs")
    told = json.dumps(crs)
    if crs is not None and "CRS84" not in told and "4326" not in told:
        raise SurveyError(
            f"{path}: its coordinates are in {shown(told)}; convert it to longitude and latitude on WGS84 (EPSG:4326)"
        )
    return [_drawn(f"{path}: {label}", feature) for label, feature in _features(path, content)]


def _drawn(where: str, feature: dict[str, Any]) -> Drawn:
    properties = feature.get("properties")
    said = properties if isinstance(properties, dict) else {}
    names = (said["name"],) if isinstance(said.get("name"), str) else ()
    role = next((role for role in ROLES if role == said.get("role")), None)
    return Drawn(where, _polygons(feature.get("geometry"), where), names, role)


def _features(path: Path, content: dict[str, Any]) -> list[tuple[str, Any]]:
    """(label, feature object) of everything in the file."""
    kind = content["type"]
    if kind == "Feature":
        return [(_label(content, None), content)]
    if kind != "FeatureCollection":
        return [("the geometry", {"geometry": content})]
    features = content.get("features")
    if not isinstance(features, list):
        raise SurveyError(f'{path}: the FeatureCollection has no list "features"')
    labelled = []
    for index, feature in enumerate(features):
        if not isinstance(feature, dict) or feature.get("type") != "Feature":
            raise SurveyError(f'{path}: features[{index}] is not an object of "type": "Feature"')
        labelled.append((_label(feature, index), feature))
    return labelled


def _label(feature: dict[str, Any], index: int | None) -> str:
    properties = feature.get("properties") or {}
    name = feature.get("id")
    if name is None and isinstance(properties, dict):
        name = properties.get("name")
    place = "the feature" if index is None else f"features[{index}]"
    return place if name is None else f"{place} ({shown(name)})"


def _polygons(geometry: Any, where: str) -> BaseGeometry:
    kind = geometry.get("type") if isinstance(geometry, dict) else None
    if kind not in ("Polygon", "MultiPolygon"):
        raise SurveyError(
            f"{where}: its geometry is {shown(kind or 'missing')}; a Polygon or a MultiPolygon is needed"
        )
    coordinates = geometry.get("coordinates")
    polygons = [coordinates] if kind == "Polygon" else coordinates
    if not isinstance(polygons, list) or not all(isinstance(rings, list) and rings for rings in polygons):
        raise SurveyError(f'{where}: "coordinates" must be a list of rings, the outer one first')
    return area_of(
        [[_ring(ring, f"{where}, ring {index}") for index, ring in enumerate(rings)] for rings in polygons],
        where,
    )


def _ring(ring: Any, where: str) -> list[Position]:
    if not isinstance(ring, list):
        raise SurveyError(f"{where}: needs at least four positions, the last equal to the first")
    positions = [_position(entry, f"{where}, position {index}") for index, entry in enumerate(ring)]
    check_closed(positions, where)
    return positions


def _position(entry: Any, where: str) -> Position:
    lon_deg, lat_deg = (finite(entry[0]), finite(entry[1])) if _is_pair(entry) else (None, None)
    if lon_deg is None or lat_deg is None:
        raise SurveyError(
            f"{where}: {shown(json.dumps(entry))} is not a position; [longitude, latitude] is needed"
        )
    return position(lon_deg, lat_deg, where, json.dumps(entry), _ORDER)


def _is_pair(entry: Any) -> bool:
    return isinstance(entry, list) and len(entry) >= 2
