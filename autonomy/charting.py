"""What the shore draws its chart from: the survey's outlines, small enough for a thin link."""

import numpy as np
import shapely
from shapely.geometry import Point
from shapely.geometry.base import BaseGeometry

from autonomy.config import Configuration
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.mavlink.fence import Zone
from autonomy.mavlink.safeguards import Safeguards
from autonomy.planning.survey import SurveyArea
from autonomy.wire_values import Ring, SurveyNotice

CORNERS = 2000
"""Corners of all outlines together that are told, in eight bytes each; of a coast no chart on a screen shows more."""

_FINEST_SHARE = 1e-4
"""Of the survey's span: by how much outlines are simplified at least."""
_SMALLEST_CORNERS = 64


def survey_notice(configuration: Configuration, survey: SurveyArea, corners: int = CORNERS) -> SurveyNotice:
    """What the shore is told of a survey before the autopilot's fence is known.

    Args:
        configuration: all of it.
        survey: what `survey` in the configuration describes.
        corners: of all outlines together, about; they are simplified until they have no more, and islands that are
            smaller than the simplification are left out.
    """
    sensor = configuration.sensor
    shapes = {
        "area": survey.ground,
        "land": survey.land,
        "keep_in": survey.keep_in,
        "keep_out": survey.keep_out,
    }
    lat, lon = np.transpose(survey.frame.to_geodetic(shapely.get_coordinates(survey.ground)))
    return SurveyNotice(
        name=configuration.survey.name,
        variable=sensor.variable,
        long_name=sensor.variable.replace("_", " "),
        units=sensor.units,
        valid_range=(_finite(sensor.minimum), _finite(sensor.maximum)),
        rho0=configuration.exploration.rho0,
        capacity=configuration.model.capacity,
        bounds_deg=(float(lat.min()), float(lon.min()), float(lat.max()), float(lon.max())),
        **_simplified(shapes, survey, max(corners, _SMALLEST_CORNERS)),
    )


def fence_rings(frame: LocalFrame, safeguards: Safeguards) -> tuple[Ring, ...]:
    """Outlines of all zones of the autopilot's fence."""
    zones = [zone for group in safeguards.inclusions for zone in group] + list(safeguards.exclusions)
    return tuple(_ring(frame, shapely.get_coordinates(_zone(frame, zone))[:-1]) for zone in zones)


def _finite(end: float) -> float | None:
    return float(end) if np.isfinite(end) else None


def _zone(frame: LocalFrame, zone: Zone) -> BaseGeometry:
    corners = frame.to_local(*np.transpose(zone.corners_deg))
    return shapely.Polygon(corners) if zone.radius_m is None else Point(corners[0]).buffer(zone.radius_m)


def _ring(frame: LocalFrame, corners_m: FloatArray) -> Ring:
    return tuple((lat, lon) for lat, lon in frame.to_geodetic(corners_m).round(6).tolist())


def _simplified(
    shapes: dict[str, BaseGeometry | None], survey: SurveyArea, corners: int
) -> dict[str, tuple[Ring, ...]]:
    """Rings of the shapes in degrees, each corner by less than the tolerance off, doubled until they are few enough."""
    tolerance_m = _FINEST_SHARE * survey.span_m
    while True:
        rings = {
            name: _rings(shape, tolerance_m) if shape is not None else [] for name, shape in shapes.items()
        }
        if sum(len(ring) for each in rings.values() for ring in each) <= corners:
            break
        tolerance_m *= 2.0
        if tolerance_m > survey.span_m:
            rings = {name: [] for name in rings}
            break
    return {name: tuple(_ring(survey.frame, ring) for ring in each) for name, each in rings.items()}


def _rings(shape: BaseGeometry, tolerance_m: float) -> list[FloatArray]:
    """Outer and inner outlines of polygons in local metres, without the last corner, which is the first again."""
    lines = shapely.get_rings(shapely.get_parts(shape))
    coarse = shapely.simplify(lines, tolerance_m, preserve_topology=False)
    kept = [shapely.get_coordinates(line)[:-1] for line in coarse if not line.is_empty]
    return [ring for ring in kept if len(ring) >= 3]
