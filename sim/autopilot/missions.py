"""What the autopilot stores: the mission, fence and rally points, rounded as ArduPilot rounds."""

import math
from dataclasses import dataclass, field, replace
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.vessel import Position

MOST_ITEMS = 655
MISSION = mav.MAV_MISSION_TYPE_MISSION
FENCE = mav.MAV_MISSION_TYPE_FENCE
RALLY = mav.MAV_MISSION_TYPE_RALLY
STORED_TYPES = (MISSION, FENCE, RALLY)

_GLOBAL_FRAMES = {
    mav.MAV_FRAME_GLOBAL: mav.MAV_FRAME_GLOBAL,
    mav.MAV_FRAME_GLOBAL_INT: mav.MAV_FRAME_GLOBAL,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT: mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
    mav.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: mav.MAV_FRAME_GLOBAL_RELATIVE_ALT,
}
_PLACES = (
    mav.MAV_CMD_NAV_WAYPOINT,
    mav.MAV_CMD_NAV_LOITER_UNLIM,
    mav.MAV_CMD_NAV_LOITER_TIME,
)
_COMMANDS = (*_PLACES, mav.MAV_CMD_NAV_RETURN_TO_LAUNCH, mav.MAV_CMD_DO_CHANGE_SPEED)


class Refused(Exception):  # noqa: N818 (an answer to the sender, not an error of ours)
    """An item that cannot be stored; `result` is the MAV_MISSION_RESULT to answer with."""

    def __init__(self, result: int) -> None:
        super().__init__(f"MAV_MISSION_RESULT {result}")
        self.result = result


@dataclass(frozen=True)
class MissionItem:
    """One stored item; `x`, `y` are degrees × 1e7."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float

    @property
    def position(self) -> Position:
        """Where the item lies."""
        return Position(self.x * 1e-7, self.y * 1e-7)

    @property
    def is_place(self) -> bool:
        """Whether the boat drives to this item."""
        return self.command in _PLACES

    @classmethod
    def at(cls, position: Position) -> "MissionItem":
        """A plain waypoint on the sea surface, as home is stored."""
        lat, lon = round(position.lat_deg * 1e7), round(position.lon_deg * 1e7)
        return cls(mav.MAV_FRAME_GLOBAL, mav.MAV_CMD_NAV_WAYPOINT, (0.0,) * 4, lat, lon, 0.0)


def from_message(message: Any, mission_type: int) -> MissionItem:
    """The item in a MISSION_ITEM_INT or a MISSION_ITEM, as it will be stored.

    Raises:
        Refused: the command, the frame, a parameter or the position cannot be stored.
    """
    params = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "MISSION_ITEM":
        x, y = _scaled(message.x), _scaled(message.y)
    else:
        x, y = message.x, message.y
    item = MissionItem(message.frame, message.command, params, x, y, float(message.z))
    return _stored_waypoint(item) if mission_type == MISSION else _stored_point(item)


def to_message(item: MissionItem, seq: int, mission_type: int, to: tuple[int, int], integers: bool) -> Any:
    """MISSION_ITEM_INT of a stored item, or MISSION_ITEM for a client that asked with the old request."""
    head = (*to, seq, item.frame, item.command, 0, 1, *item.params)
    if integers:
        return mav.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, mission_type)
    return mav.MAVLink_mission_item_message(*head, item.x * 1e-7, item.y * 1e-7, item.z, mission_type)


def _scaled(degrees: float) -> int:
    if not math.isfinite(degrees):
        raise Refused(mav.MAV_MISSION_INVALID_PARAM5_X)
    return round(degrees * 1e7)


def _check_position(item: MissionItem) -> None:
    if abs(item.x) > 900_000_000:
        raise Refused(mav.MAV_MISSION_INVALID_PARAM5_X)
    if abs(item.y) > 1_800_000_000:
        raise Refused(mav.MAV_MISSION_INVALID_PARAM6_Y)


def _stored_waypoint(item: MissionItem) -> MissionItem:
    """A mission item after ArduPilot's storage: whole param1, no param2–4, altitude in cm."""
    if item.command not in _COMMANDS:
        raise Refused(mav.MAV_MISSION_UNSUPPORTED)
    for index, param in enumerate(item.params):
        if not math.isfinite(param) and not (index == 3 and item.is_place):  # an open yaw is legal
            raise Refused(mav.MAV_MISSION_INVALID_PARAM1 + index)
    if not item.is_place:
        return replace(item, frame=mav.MAV_FRAME_GLOBAL)
    if item.frame not in _GLOBAL_FRAMES:
        raise Refused(mav.MAV_MISSION_UNSUPPORTED_FRAME)
    if not math.isfinite(item.z):
        raise Refused(mav.MAV_MISSION_INVALID_PARAM7)
    _check_position(item)
    params = (float(int(item.params[0])), 0.0, 0.0, 0.0)
    return replace(item, frame=_GLOBAL_FRAMES[item.frame], params=params, z=round(item.z, 2))


def _stored_point(item: MissionItem) -> MissionItem:
    """A fence or rally point."""
    if item.frame not in _GLOBAL_FRAMES:
        raise Refused(mav.MAV_MISSION_UNSUPPORTED_FRAME)
    _check_position(item)
    p1, p2, p3, p4 = (param if math.isfinite(param) else 0.0 for param in item.params)
    return replace(item, frame=_GLOBAL_FRAMES[item.frame], params=(p1, p2, p3, p4), z=0.0)


@dataclass
class MissionStore:
    """The mission on board; item 0 is always home, whatever was uploaded there."""

    home: Position
    _items: list[MissionItem] = field(default_factory=list)
    fence: list[MissionItem] = field(default_factory=list)
    rally: list[MissionItem] = field(default_factory=list)

    def __len__(self) -> int:
        """Number of mission items, home included; 0 without a mission."""
        return len(self._items)

    def __getitem__(self, seq: int) -> MissionItem:
        """The mission item `seq`."""
        return MissionItem.at(self.home) if seq == 0 else self._items[seq]

    @property
    def total(self) -> int:
        """Number of mission items that can be driven: home does not count."""
        return max(0, len(self._items) - 1)

    def write(self, seq: int, item: MissionItem) -> None:
        """Replace or append a mission item at once; there is no way back to the old mission."""
        if seq < len(self._items):
            self._items[seq] = item
        else:
            self._items.append(item)

    def truncate(self, count: int) -> None:
        """Cut the mission down to at most `count` items."""
        del self._items[count:]

    def items(self, mission_type: int) -> list[MissionItem]:
        """All items of one of the stored types, home first in a mission."""
        if mission_type == FENCE:
            return self.fence
        if mission_type == RALLY:
            return self.rally
        return [self[seq] for seq in range(len(self))]
