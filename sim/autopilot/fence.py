"""The fence as ArduPilot Rover keeps it: with avoidance the boat stops inside, silently; without, a breach acts."""

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot.missions import MissionItem, MissionStore
from sim.autopilot.parameters import Parameters
from sim.vessel import Position

_CIRCLE_ABOUT_HOME, _POLYGONS = 2, 4  # of FENCE_TYPE
_AVOIDS_FENCE = 1  # of AVOID_ENABLE
_POLYGON = (
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
)
_INCLUSIONS = (
    mav.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
    mav.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
)


class Fence:
    """The fence on board, under the parameters in force."""

    def __init__(self, store: MissionStore, parameters: Parameters) -> None:
        self._store = store
        self._parameters = parameters

    @property
    def is_on(self) -> bool:
        """Whether it is enabled."""
        return self._parameters["FENCE_ENABLE"] != 0.0

    @property
    def stops_the_boat(self) -> bool:
        """Whether the boat stops before it; otherwise a breach has its action."""
        return bool(int(self._parameters["AVOID_ENABLE"]) & _AVOIDS_FENCE)

    def room_m(self, here: Position) -> float:
        """Distance to the nearest edge of the fence, negative outside of it; infinite without a fence."""
        if not self.is_on:
            return math.inf
        kind = int(self._parameters["FENCE_TYPE"])
        rooms = list(self._zones(here)) if kind & _POLYGONS else []
        if kind & _CIRCLE_ABOUT_HOME:
            rooms.append(self._parameters["FENCE_RADIUS"] - here.distance_to(self._store.home))
        return min(rooms, default=math.inf)

    def _zones(self, here: Position) -> Iterator[float]:
        items, k = self._store.fence, 0
        while k < len(items):
            item = items[k]
            count = max(1, int(item.params[0])) if item.command in _POLYGON else 1
            inside_m = (
                _polygon_m(here, items[k : k + count])
                if item.command in _POLYGON
                else item.params[0] - here.distance_to(item.position)
            )
            yield inside_m if item.command in _INCLUSIONS else -inside_m
            k += count


def _polygon_m(here: Position, corners: list[MissionItem]) -> float:
    """Distance from a place to the edges of a polygon, negative outside of it."""
    points = [here.offset_to(corner.position) for corner in corners]
    inside, nearest = False, math.inf
    for (ax, ay), (bx, by) in zip(points, points[1:] + points[:1], strict=True):
        if (ay > 0.0) != (by > 0.0) and ax + (bx - ax) * ay / (ay - by) > 0.0:
            inside = not inside
        length2 = (bx - ax) ** 2 + (by - ay) ** 2
        t = 0.0 if length2 == 0.0 else min(1.0, max(0.0, -(ax * (bx - ax) + ay * (by - ay)) / length2))
        nearest = min(nearest, math.hypot(ax + t * (bx - ax), ay + t * (by - ay)))
    return nearest if inside else -nearest
