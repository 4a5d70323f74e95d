"""From a plan to mission items: where the autopilot shall sail, how near it must get, and where it waits."""

import math
from dataclasses import dataclass

import numpy as np

from autonomy.config import Configuration
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.mavlink.mission_items import Mission, waypoint
from autonomy.planning.plan import Plan

LEAST_RADIUS_M = 2.0
"""Positions are not surer than this, and a waypoint that is never quite reached is circled."""

_SHARPEST_RAD = math.radians(150.0)
"""The tangent of half the turn has no end at a reversal, which no radius makes smooth."""


@dataclass(frozen=True)
class Handling:
    """How the vessel takes corners.

    Attributes:
        speed_mps: over ground.
        turn_rate_rad_s: how quickly it turns at that speed.
        clearance_m: a corner may be cut within half of this.
        fixed_radius_m: radius to use whatever these say; None: by these.
        hold_s: how long to stay at each sampling spot.
    """

    speed_mps: float
    turn_rate_rad_s: float
    clearance_m: float
    fixed_radius_m: float | None = None
    hold_s: float = 0.0


def handling_of(configuration: Configuration, speed_mps: float) -> Handling:
    """What the configuration says, at a speed over ground."""
    return Handling(
        speed_mps=speed_mps,
        turn_rate_rad_s=math.radians(configuration.vehicle.turn_rate_deg_s),
        clearance_m=min(configuration.survey.standoff_m, configuration.authority.fence_margin_m),
        fixed_radius_m=configuration.mavlink.acceptance_radius_m,
        hold_s=configuration.planning.hold_s,
    )


def compile_mission(plan: Plan, frame: LocalFrame, handling: Handling) -> Mission:
    """One NAV_WAYPOINT for each corner of a plan, its k-th item for corner k."""
    radii_m = acceptance_radii_m(np.vstack([plan.start_m, plan.route_m]), handling)
    places = frame.to_geodetic(plan.route_m).reshape(-1, 2).tolist()
    return tuple(
        waypoint(lat, lon, acceptance_radius_m=round(radius_m, 1), hold_s=handling.hold_s if is_spot else 0.0)
        for (lat, lon), radius_m, is_spot in zip(places, radii_m, plan.is_spot, strict=True)
    )


def acceptance_radii_m(points_m: FloatArray, handling: Handling) -> list[float]:
    """At which distance from each corner the vessel may turn towards the next; (k + 1, 2) points give k radii.

    A boat of turning radius r = speed / turn rate that begins to turn by an angle a at r tan(a / 2) before the corner
    comes out on the next leg. Less than that, and it overshoots; but no more than half the clearance, within which
    it then stays of its route whatever it does, and no more than half of either leg, or a corner would be passed over.
    """
    if handling.fixed_radius_m is not None:
        return [handling.fixed_radius_m] * (len(points_m) - 1)
    turning_radius_m = handling.speed_mps / handling.turn_rate_rad_s
    legs = np.diff(points_m, axis=0)
    lengths_m, headings = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])
    turns = np.abs((np.diff(headings) + math.pi) % (2.0 * math.pi) - math.pi)
    wanted_m = turning_radius_m * np.tan(0.5 * np.minimum(turns, _SHARPEST_RAD))
    most_m = np.minimum(0.5 * handling.clearance_m, 0.5 * np.minimum(lengths_m[:-1], lengths_m[1:]))
    return [*np.maximum(LEAST_RADIUS_M, np.minimum(wanted_m, most_m)).tolist(), LEAST_RADIUS_M]
