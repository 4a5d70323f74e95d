"""QGroundControl's .plan files: the fence's zones, and the polygons of survey patterns.

The format: https://docs.qgroundcontrol.com/master/en/qgc-dev-guide/file_formats/plan.html. Positions are
[latitude, longitude], rings are open. A fence of version 1, before 2018, has one `polygon` that the vehicle is kept
inside of; one of version 2 has `polygons` and `circles`, each an inclusion or an exclusion. Waypoints, rally points and
the planned home are the autopilot's, and are not looked at.
"""

from math import cos, pi
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry import Point
from shapely.geometry.base import BaseGeometry

from autonomy.geometry import LocalFrame
from autonomy.planning.errors import SurveyError
from autonomy.planning.rings import Drawn, Position, area_of, finite, position, shown

_ORDER = "a plan has the latitude first, then the longitude"
_LARGEST_RADIUS_M = 200e3
_FENCE_VERSIONS = (1, 2)
_ARC_SEGMENTS = 16
"""Straight pieces per quarter of a circular zone."""


def survey_polygons(path: Path, content: dict[str, Any]) -> list[BaseGeometry]:
    """The polygons of the plan's survey patterns; if it has none, the one zone common to its inclusion fences.

    Returns:
        Valid polygons in degrees, x longitude, y latitude.

    Raises:
        SurveyError: it has neither, or they are malformed.
    """
    _check(path, content)
    patterns = _patterns(path, content)
    if patterns:
        return [each.shape for each in patterns]
    if not _zones(path, content, inclusion=True):
        raise SurveyError(
            f"{path}: has neither a survey pattern nor an inclusion fence{_other_patterns(content)}; "
            "draw one of them round the survey area"
        )
    return inclusion_polygons(path, content)


def inclusion_polygons(path: Path, content: dict[str, Any]) -> list[BaseGeometry]:
    """What all inclusion zones of the plan's fence have in common, which is what ArduPilot holds the vessel to.

    Raises:
        SurveyError: there are none, they have nothing in common, or they are malformed.
    """
    _check(path, content)
    zones = [each.shape for each in _zones(path, content, inclusion=True)]
    if not zones:
        raise SurveyError(f"{path}: its fence has no inclusion zone; the vessel would have nowhere to stay")
    common = shapely.intersection_all(zones)
    if common.area == 0.0:
        raise SurveyError(
            f"{path}: its {len(zones)} inclusion zones have no area in common; a vessel must stay inside all of them"
        )
    return [common]


def exclusion_polygons(path: Path, content: dict[str, Any]) -> list[BaseGeometry]:
    """The exclusion zones of the plan's fence.

    Raises:
        SurveyError: there are none, or they are malformed.
    """
    _check(path, content)
    zones = _zones(path, content, inclusion=False)
    if not zones:
        raise SurveyError(
            f"{path}: its fence has no exclusion zone, so it says nothing about where not to go"
        )
    return [each.shape for each in zones]


def plan_drawn(path: Path, content: dict[str, Any]) -> list[Drawn]:
    """Survey patterns and zones, each for itself, with its role.

    Raises:
        SurveyError: there are none, or they are malformed.
    """
    _check(path, content)
    zones = [_zones(path, content, inclusion=inclusion) for inclusion in (True, False)]
    drawn = [*_patterns(path, content), *zones[0], *zones[1]]
    if not drawn:
        raise SurveyError(
            f"{path}: has neither a survey pattern nor a fence{_other_patterns(content)}; "
            "draw one of them round the survey area"
        )
    return drawn


def _patterns(path: Path, content: dict[str, Any]) -> list[Drawn]:
    wheres = {
        f"{path}: mission.items[{index}] (survey)": item.get("polygon")
        for index, item in _complex_items(content)
        if item["complexItemType"] == "survey"
    }
    return [Drawn(where, _polygon(corners, where), role="area") for where, corners in wheres.items()]


def _complex_items(content: dict[str, Any]) -> list[tuple[int, dict[str, Any]]]:
    """The patterns of the mission with their places in it, whatever they are."""
    mission = content.get("mission")
    items = mission.get("items") if isinstance(mission, dict) else None
    return [
        (index, item)
        for index, item in enumerate(items if isinstance(items, list) else [])
        if isinstance(item, dict) and isinstance(item.get("complexItemType"), str)
    ]


def _other_patterns(content: dict[str, Any]) -> str:
    """What is drawn in place of a survey pattern, for whoever looks for it."""
    kinds = dict.fromkeys(shown(item["complexItemType"]) for _, item in _complex_items(content))
    return f" (only {', '.join(kinds)}, which has no survey area)" if kinds else ""


def _check(path: Path, content: dict[str, Any]) -> None:
    if content.get("fileType") != "Plan":
        raise SurveyError(f'{path}: is JSON but no QGroundControl plan: "fileType": "Plan" is missing')


def _zones(path: Path, content: dict[str, Any], *, inclusion: bool) -> list[Drawn]:
    fence = content.get("geoFence")
    if fence is None:
        return []
    if not isinstance(fence, dict):
        raise SurveyError(f'{path}: "geoFence" is not an object')
    version = fence.get("version", _FENCE_VERSIONS[-1])
    if version not in _FENCE_VERSIONS:
        raise SurveyError(
            f"{path}: its geoFence is of version {shown(version)}; {' and '.join(map(str, _FENCE_VERSIONS))} are known"
        )
    if version == 1:
        where, corners = f"{path}: geoFence.polygon", fence.get("polygon")
        return [Drawn(where, _polygon(corners, where), role="keep_in")] if inclusion and corners else []
    zones, role = [], "keep_in" if inclusion else "keep_out"
    for kind, read in (("polygons", _polygon_zone), ("circles", _circle_zone)):
        entries = fence.get(kind, [])
        if not isinstance(entries, list):
            raise SurveyError(f"{path}: geoFence.{kind} is not a list")
        for index, entry in enumerate(entries):
            where = f"{path}: geoFence.{kind}[{index}]"
            if not isinstance(entry, dict) or not isinstance(entry.get("inclusion"), bool):
                raise SurveyError(f'{where}: is not an object with "inclusion": true or false')
            if entry["inclusion"] is inclusion:
                zones.append(Drawn(where, read(entry, where), role=role))
    return zones


def _polygon_zone(entry: dict[str, Any], where: str) -> BaseGeometry:
    return _polygon(entry.get("polygon"), where)


def _polygon(corners: Any, where: str) -> BaseGeometry:
    if not isinstance(corners, list) or len(corners) < 3:
        raise SurveyError(f'{where}: "polygon" must be a list of at least three [latitude, longitude]')
    ring = [_position(corner, f"{where}, corner {index}") for index, corner in enumerate(corners)]
    return area_of([[ring]], where)


def _circle_zone(entry: dict[str, Any], where: str) -> BaseGeometry:
    """A circle as a polygon that lies inside it for an inclusion, and round it for an exclusion."""
    circle = entry.get("circle")
    if not isinstance(circle, dict):
        raise SurveyError(f'{where}: has no object "circle"')
    lon_deg, lat_deg = _position(circle.get("center"), f"{where}, center")
    radius_m = finite(circle.get("radius"))
    if radius_m is None or not 0.0 < radius_m <= _LARGEST_RADIUS_M:
        raise SurveyError(
            f"{where}: its radius is {shown(circle.get('radius'))}; more than 0 and at most "
            f"{_LARGEST_RADIUS_M:g} metres are possible"
        )
    if abs(lat_deg) > 85.0:
        raise SurveyError(f"{where}: its center is at {lat_deg:g} degrees of latitude, too near the pole")
    frame = LocalFrame(lat_deg, lon_deg)
    reach_m = radius_m if entry["inclusion"] else radius_m / cos(pi / (4 * _ARC_SEGMENTS))
    disc = Point(0.0, 0.0).buffer(reach_m, quad_segs=_ARC_SEGMENTS)

    def to_degrees(points_m: Any) -> Any:
        degrees = frame.to_geodetic(points_m)[:, ::-1]
        # Close to the date line some come out on its other side.
        degrees[:, 0] = lon_deg + (degrees[:, 0] - lon_deg + 180.0) % 360.0 - 180.0
        return degrees

    return shapely.transform(disc, to_degrees)


def _position(entry: Any, where: str) -> Position:
    numbers = [finite(n) for n in entry[:2]] if isinstance(entry, list) else []
    if len(numbers) < 2 or numbers[0] is None or numbers[1] is None:
        raise SurveyError(f"{where}: {shown(entry)} is not a position; [latitude, longitude] is needed")
    return position(numbers[1], numbers[0], where, str(entry), _ORDER)
