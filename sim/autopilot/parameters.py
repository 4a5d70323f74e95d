"""The parameters of a boat under ArduPilot Rover: the few that act here, and those that people look for."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

_INT8 = mav.MAV_PARAM_TYPE_INT8
_INT16 = mav.MAV_PARAM_TYPE_INT16
_INT32 = mav.MAV_PARAM_TYPE_INT32
_REAL = mav.MAV_PARAM_TYPE_REAL32

_TABLE: tuple[tuple[str, float, int], ...] = (
    ("ARMING_CHECK", 1, _INT32),
    ("ARMING_REQUIRE", 1, _INT8),
    ("ATC_BRAKE", 1, _INT8),
    ("ATC_DECEL_MAX", 0, _REAL),
    ("ATC_STR_RAT_MAX", 120, _REAL),
    ("AVOID_ENABLE", 3, _INT8),
    ("AVOID_MARGIN", 2, _REAL),
    ("BATT_CAPACITY", 0, _INT32),
    ("BATT_CRT_VOLT", 0, _REAL),
    ("BATT_FS_CRT_ACT", 0, _INT8),
    ("BATT_FS_LOW_ACT", 0, _INT8),
    ("BATT_LOW_VOLT", 0, _REAL),
    ("BATT_MONITOR", 4, _INT8),
    ("COMPASS_USE", 1, _INT8),
    ("CRUISE_SPEED", 2, _REAL),
    ("CRUISE_THROTTLE", 50, _INT8),
    ("EK3_ENABLE", 1, _INT8),
    ("FENCE_ACTION", 1, _INT8),
    ("FENCE_ENABLE", 0, _INT8),
    ("FENCE_MARGIN", 2, _REAL),
    ("FENCE_OPTIONS", 0, _INT16),
    ("FENCE_RADIUS", 300, _REAL),
    ("FENCE_TOTAL", 0, _INT8),
    ("FENCE_TYPE", 6, _INT8),
    ("FRAME_CLASS", 2, _INT8),
    ("FRAME_TYPE", 0, _INT8),
    ("FS_ACTION", 2, _INT8),
    ("FS_CRASH_CHECK", 0, _INT8),
    ("FS_EKF_ACTION", 1, _INT8),
    ("FS_EKF_THRESH", 0.8, _REAL),
    ("FS_GCS_ENABLE", 0, _INT8),
    ("FS_GCS_TIMEOUT", 5, _REAL),
    ("FS_OPTIONS", 0, _INT32),
    ("FS_THR_ENABLE", 1, _INT8),
    ("FS_THR_VALUE", 910, _INT16),
    ("FS_TIMEOUT", 1.5, _REAL),
    ("GPS1_TYPE", 1, _INT8),
    ("INITIAL_MODE", 0, _INT8),
    ("LOIT_RADIUS", 2, _REAL),
    ("LOIT_TYPE", 0, _INT8),
    ("MAV_GCS_SYSID", 255, _INT16),
    ("MAV_OPTIONS", 0, _INT16),
    ("MAV_SYSID", 1, _INT16),
    ("MIS_DONE_BEHAVE", 1, _INT8),
    ("MIS_OPTIONS", 0, _INT16),
    ("MIS_RESTART", 0, _INT8),
    ("MIS_TOTAL", 0, _INT16),
    ("MODE1", 0, _INT8),
    ("MODE6", 0, _INT8),
    ("MODE_CH", 8, _INT8),
    ("MOT_THR_MAX", 100, _INT8),
    ("MOT_THR_MIN", 0, _INT8),
    ("RALLY_TOTAL", 0, _INT8),
    ("RTL_SPEED", 0, _REAL),
    ("SERVO1_FUNCTION", 26, _INT16),
    ("SERVO3_FUNCTION", 70, _INT16),
    ("SYSID_THISMAV", 1, _INT16),
    ("TURN_RADIUS", 0.9, _REAL),
    ("WP_ACCEL", 0, _REAL),
    ("WP_RADIUS", 2, _REAL),
    ("WP_SPEED", 0, _REAL),
)
_INTEGERS = (_INT8, _INT16, _INT32)


class Parameters:
    """Names, values and types; indices are positions in the table, as PARAM_VALUE wants them."""

    def __init__(self, **initial: float) -> None:
        """Start from the defaults, changed by `initial`.

        Raises:
            KeyError: a name in `initial` is not a parameter.
        """
        self._values = {name: float(value) for name, value, _ in _TABLE}
        self._types = {name: kind for name, _, kind in _TABLE}
        self._names = [name for name, _, _ in _TABLE]
        for name, value in initial.items():
            self.set(name, value)

    def __getitem__(self, name: str) -> float:
        """The value of a parameter."""
        return self._values[name]

    def __contains__(self, name: str) -> bool:
        """Whether there is such a parameter."""
        return name in self._values

    def set(self, name: str, value: float) -> None:
        """Set a parameter; integers are rounded, as ArduPilot does.

        Raises:
            KeyError: there is no such parameter.
        """
        kind = self._types[name]
        self._values[name] = float(round(value)) if kind in _INTEGERS else float(value)

    def name_of(self, identity: str, index: int) -> str | None:
        """The parameter that a PARAM_REQUEST_READ means: by index, or by name when the index is -1."""
        if index >= 0:
            return self._names[index] if index < len(self._names) else None
        return identity if identity in self._values else None

    def message(self, name: str) -> Any:
        """PARAM_VALUE of one parameter."""
        return mav.MAVLink_param_value_message(
            name.encode(), self._values[name], self._types[name], len(self._names), self._names.index(name)
        )

    def messages(self) -> list[Any]:
        """PARAM_VALUE of every parameter, in order."""
        return [self.message(name) for name in self._names]

    @property
    def waypoint_speed_mps(self) -> float:
        """Speed in missions: WP_SPEED, or CRUISE_SPEED where that is zero."""
        return self["WP_SPEED"] or self["CRUISE_SPEED"]

    @property
    def return_speed_mps(self) -> float:
        """Speed in RTL: RTL_SPEED, or the waypoint speed where that is zero."""
        return self["RTL_SPEED"] or self.waypoint_speed_mps
