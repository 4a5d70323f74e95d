"""The autopilot's fence as it travels: zones the vehicle must stay in, or out of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import MissionItem

_VERTICES = {
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION: False,
}
_CIRCLES = {
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION: True,
    mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION: False,
}
_FEWEST_VERTICES = 3


class FenceError(ValueError):
    """The items on board make no fence; says why."""


@dataclass(frozen=True)
class Zone:
    """One part of a fence.

    Attributes:
        is_inclusion: whether the vehicle must stay inside, or outside.
        corners_deg: latitude, longitude of a polygon's corners, or of a circle's centre alone.
        radius_m: the circle's; None for a polygon.
    """

    is_inclusion: bool
    corners_deg: tuple[tuple[float, float], ...]
    radius_m: float | None = None


def parse_fence(items: Sequence[MissionItem]) -> tuple[Zone, ...]:
    """The zones of a fence that was read; an older fence's return point is none.

    Raises:
        FenceError: vertices are missing, a circle has no radius, a place is not on Earth, or an item is nothing of a
            fence.
    """
    zones: list[Zone] = []
    k = 0
    while k < len(items):
        item = items[k]
        if item.command in _VERTICES:
            zones.append(_polygon(items, k))
            k += len(zones[-1].corners_deg)
            continue
        if item.command in _CIRCLES:
            if not (math.isfinite(item.param1) and item.param1 > 0.0):
                raise FenceError(f"item {k} of the fence is a circle with a radius of {item.param1:g} m")
            zones.append(Zone(_CIRCLES[item.command], (_place(item),), item.param1))
        elif item.command != mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT:
            raise FenceError(
                f"item {k} of the fence is a command {item.command}, which is no part of a fence"
            )
        k += 1
    return tuple(zones)


def _polygon(items: Sequence[MissionItem], first: int) -> Zone:
    """The polygon whose first vertex is item `first`; each of them tells how many there are."""
    command, wanted = items[first].command, items[first].param1
    corners = items[first : first + int(max(0.0, min(wanted, len(items))))]
    alike = all((item.command, item.param1) == (command, wanted) for item in corners)
    if len(corners) != wanted or wanted < _FEWEST_VERTICES or not alike:
        raise FenceError(
            f"item {first} of the fence begins a polygon of {wanted:g} vertices, which are not there"
        )
    return Zone(_VERTICES[command], tuple(map(_place, corners)))


def _place(item: MissionItem) -> tuple[float, float]:
    if abs(item.lat_deg) > 90.0 or abs(item.lon_deg) > 180.0:
        raise FenceError(f"no such place: latitude {item.lat_deg:g}, longitude {item.lon_deg:g} degrees")
    return item.lat_deg, item.lon_deg
