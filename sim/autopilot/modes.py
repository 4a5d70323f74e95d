"""The modes of ArduPilot Rover and what a heartbeat says about them."""

from enum import IntEnum

from pymavlink.dialects.v20 import ardupilotmega as mav


class Mode(IntEnum):
    """Custom modes; the values are ArduPilot Rover's."""

    MANUAL = 0
    HOLD = 4
    LOITER = 5
    AUTO = 10
    RTL = 11
    SMART_RTL = 12
    GUIDED = 15

    @property
    def needs_position(self) -> bool:
        """Whether the mode is refused without a position estimate."""
        return self not in (Mode.MANUAL, Mode.HOLD)


class MissionState(IntEnum):
    """Values of MISSION_CURRENT.mission_state."""

    NO_MISSION = 1
    NOT_STARTED = 2
    ACTIVE = 3
    PAUSED = 4
    COMPLETE = 5


def base_mode(mode: Mode, armed: bool) -> int:
    """HEARTBEAT.base_mode, as Rover composes it."""
    flags: int = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if mode is Mode.MANUAL:
        flags |= mav.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    elif mode is not Mode.HOLD:
        flags |= mav.MAV_MODE_FLAG_GUIDED_ENABLED | mav.MAV_MODE_FLAG_STABILIZE_ENABLED
    if mode is Mode.AUTO:
        flags |= mav.MAV_MODE_FLAG_AUTO_ENABLED
    return flags | (mav.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0)
