"""Missions as values: items, how they travel, and when two missions are the same."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_SAME_ON_BOARD = {
    mavlink.MAV_FRAME_GLOBAL_INT: mavlink.MAV_FRAME_GLOBAL,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}
_ALTITUDE_TOLERANCE_M = 0.011  # ArduPilot keeps centimetres
_PARAMETER_TOLERANCE = 1e-3
_NEAR_E7 = 300  # three metres: more than a single-precision degree is rounded by


@dataclass(frozen=True)
class Route:
    """Who talks to whom: our identity and the autopilot's."""

    own_system: int
    own_component: int
    vehicle_system: int
    vehicle_component: int

    def is_from_vehicle(self, message: Any) -> bool:
        """Whether the autopilot itself sent `message`."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        return bool(source == (self.vehicle_system, self.vehicle_component))

    def is_answer(self, message: Any, mission_type: int = mavlink.MAV_MISSION_TYPE_MISSION) -> bool:
        """Whether a message of the mission protocol belongs to our transfer of waypoints, or of another kind."""
        return bool(
            self.is_from_vehicle(message)
            and self.is_for_us(message)
            and int(message.mission_type) == mission_type
        )

    def is_for_us(self, message: Any) -> bool:
        """Whether `message` (which has target fields) is meant for us or for everybody."""
        system_fits = message.target_system in (0, self.own_system)
        component_fits = message.target_component in (0, self.own_component)
        return system_fits and component_fits


@dataclass(frozen=True)
class MissionItem:
    """One item of a mission; its number is its place in the mission."""

    frame: int
    command: int
    x: int
    """Latitude in units of 1e-7 degrees."""
    y: int
    """Longitude in units of 1e-7 degrees."""
    z: float = 0.0
    """Altitude in metres, in the item's frame."""
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0

    @property
    def lat_deg(self) -> float:
        """Latitude in degrees."""
        return self.x * 1e-7

    @property
    def lon_deg(self) -> float:
        """Longitude in degrees."""
        return self.y * 1e-7

    def to_message(self, route: Route, seq: int) -> Any:
        """The MISSION_ITEM_INT that carries this item as number `seq` to the vehicle."""
        return mavlink.MAVLink_mission_item_int_message(
            route.vehicle_system,
            route.vehicle_component,
            seq,
            self.frame,
            self.command,
            0,
            1,
            self.param1,
            self.param2,
            self.param3,
            self.param4,
            self.x,
            self.y,
            self.z,
            mavlink.MAV_MISSION_TYPE_MISSION,
        )

    @staticmethod
    def from_message(message: Any) -> "MissionItem":
        """The item that a MISSION_ITEM_INT carries."""
        return MissionItem(
            message.frame,
            message.command,
            message.x,
            message.y,
            message.z,
            message.param1,
            message.param2,
            message.param3,
            message.param4,
        )


Mission = tuple[MissionItem, ...]
"""Waypoints without home."""


def waypoint(
    lat_deg: float, lon_deg: float, *, acceptance_radius_m: float, hold_s: float = 0.0
) -> MissionItem:
    """A position to sail to, at the surface, in the frame that positions relative to home's altitude use.

    Longitudes of 180 to 360 degrees are turned into negative ones. Raises ValueError outside the Earth.
    ArduPilot keeps whole seconds of `hold_s` only, and takes its acceptance radius from WP_RADIUS.
    """
    if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 360.0):
        raise ValueError(f"no such place: latitude {lat_deg}, longitude {lon_deg} degrees")
    lon_deg = lon_deg - 360.0 if lon_deg > 180.0 else lon_deg
    return MissionItem(
        frame=mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        command=mavlink.MAV_CMD_NAV_WAYPOINT,
        x=round(lat_deg * 1e7),
        y=round(lon_deg * 1e7),
        param1=hold_s,
        param2=acceptance_radius_m,
    )


def has_home_item(autopilot: int) -> bool:
    """Whether item 0 of this autopilot's missions is home (ArduPilot) or the first waypoint (PX4, others)."""
    return autopilot == int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)


def with_home(items: Sequence[MissionItem], autopilot: int) -> Mission:
    """`items` as they are uploaded: ArduPilot wants an item 0, whose content it replaces by its own home."""
    if not has_home_item(autopilot):
        return tuple(items)
    home = MissionItem(mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_CMD_NAV_WAYPOINT, items[0].x, items[0].y)
    return (home, *items)


def missions_equal(sent: Sequence[MissionItem], on_board: Sequence[MissionItem]) -> bool:
    """Whether a mission read back is the one that was sent (both without home).

    Places, commands and frames must agree exactly, except that the *_INT frames may read back as their plain
    twins. Autopilots store parameters coarsely: param1 may be cut to an integer, param2 to param4 to zero.
    """
    return len(sent) == len(on_board) and all(map(_items_equal, sent, on_board))


def only_known_places(items: Sequence[MissionItem], missions: Iterable[Sequence[MissionItem]]) -> bool:
    """Whether each item lies within some metres of an item of one of `missions`.

    What an upload of ours makes of these missions does, half done or altered by the autopilot; what another station
    has sent does not.
    """
    known = [item for mission in missions for item in mission]
    return all(any(_is_near(one, item) for one in known) for item in items)


def _is_near(one: MissionItem, other: MissionItem) -> bool:
    return abs(one.x - other.x) <= _NEAR_E7 and abs(one.y - other.y) <= _NEAR_E7


def _items_equal(sent: MissionItem, on_board: MissionItem) -> bool:
    return bool(
        (sent.x, sent.y, sent.command) == (on_board.x, on_board.y, on_board.command)
        and _plain_frame(sent.frame) == _plain_frame(on_board.frame)
        and abs(sent.z - on_board.z) <= _ALTITUDE_TOLERANCE_M
        and (_close(sent.param1, on_board.param1) or on_board.param1 == math.trunc(sent.param1))
        and _kept_or_zeroed(sent.param2, on_board.param2)
        and _kept_or_zeroed(sent.param3, on_board.param3)
        and _kept_or_zeroed(sent.param4, on_board.param4)
    )


def _plain_frame(frame: int) -> int:
    return int(_SAME_ON_BOARD.get(frame, frame))


def _close(sent: float, on_board: float) -> bool:
    return abs(sent - on_board) <= _PARAMETER_TOLERANCE * max(1.0, abs(sent))


def _kept_or_zeroed(sent: float, on_board: float) -> bool:
    return on_board == 0.0 or _close(sent, on_board)
