"""A plan as GeoJSON (RFC 7946), for charts and ground stations: its route as a line, its spots as points."""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from autonomy.geometry import LocalFrame
from autonomy.planning.plan import Plan

_DIGITS = 7
"""Of a degree: a centimetre."""


def plan_geojson(plan: Plan, frame: LocalFrame, properties: Mapping[str, Any]) -> dict[str, Any]:
    """A FeatureCollection: the route from its start, with what the plan says of itself and `properties`, and the spots.

    Positions are longitude, latitude, from -180 to 180 degrees; a route across the antimeridian is cut there, as
    section 3.1.9 asks. Numbers that are not finite become null.
    """
    points_m = np.vstack([plan.start_m, plan.route_m])
    positions = [position(lat, lon) for lat, lon in frame.to_geodetic(points_m).tolist()]
    legs = np.diff(points_m, axis=0)
    along_km = np.cumsum(np.hypot(legs[:, 0], legs[:, 1])) / 1e3
    route = {
        "kind": "route",
        "planner": plan.planner,
        "reason": plan.reason,
        "length_km": round(plan.length_m / 1e3, 3),
        "spots": len(plan.spots_m),
        "home_corners": plan.home_corners,
        "mutual_information": plan.mutual_information if plan.mutual_information > 0.0 else None,
        "objective_before": plan.objective_before,
        "objective_after": plan.objective_after,
        "rejected": [list(each) for each in plan.rejected],
        "expected_rmse": plan.expected_rmse,
        "seed": plan.seed,
        "model_version": plan.model_version,
        **properties,
    }
    rows = [int(row) for row in np.flatnonzero(np.asarray(plan.is_spot, dtype=bool))]
    spots = [
        feature(
            {"type": "Point", "coordinates": positions[row + 1]},
            {"kind": "spot", "number": number, "along_km": round(float(along_km[row]), 3)},
        )
        for number, row in enumerate(rows, start=1)
    ]
    return {"type": "FeatureCollection", "features": [feature(line(positions), route), *spots]}


def feature(geometry: dict[str, Any], properties: Mapping[str, Any]) -> dict[str, Any]:
    """A Feature; numbers that are not finite become null."""
    return {
        "type": "Feature",
        "geometry": geometry,
        "properties": {k: _known(v) for k, v in properties.items()},
    }


def _known(value: Any) -> Any:
    """JSON has neither NaN nor infinities."""
    if isinstance(value, list):
        return [_known(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def position(lat_deg: float, lon_deg: float) -> list[float]:
    """Longitude, from -180 to 180 degrees, and latitude."""
    lon_deg = (lon_deg + 180.0) % 360.0 - 180.0
    return [round(lon_deg, _DIGITS), round(lat_deg, _DIGITS)]


def line(positions: list[list[float]]) -> dict[str, Any]:
    """A LineString through positions; a MultiLineString if it crosses the antimeridian, cut there."""
    parts = [[positions[0]]]
    for before, after in pairwise(positions):
        if abs(after[0] - before[0]) > 180.0:
            edge = math.copysign(180.0, before[0])
            # Longitudes of both on the side of the first.
            lon = after[0] + 2.0 * edge
            share = 0.0 if lon == before[0] else (edge - before[0]) / (lon - before[0])
            lat = round(before[1] + share * (after[1] - before[1]), _DIGITS)
            parts[-1].append([edge, lat])
            parts.append([[-edge, lat]])
        parts[-1].append(after)
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}
