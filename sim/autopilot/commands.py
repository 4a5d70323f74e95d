"""MAV_CMDs that arrive as COMMAND_LONG or COMMAND_INT, and what they answer."""

import math
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot.modes import Mode
from sim.autopilot.navigation import Navigator
from sim.autopilot.reports import Reports
from sim.autopilot.streams import Streams
from sim.vessel import Position

_FORCE = 21196.0
ACCEPTED = mav.MAV_RESULT_ACCEPTED
DENIED = mav.MAV_RESULT_DENIED
FAILED = mav.MAV_RESULT_FAILED
UNSUPPORTED = mav.MAV_RESULT_UNSUPPORTED


@dataclass(frozen=True)
class Command:
    """One command, whichever message brought it; `lat_deg`, `lon_deg` are params 5 and 6 as a position."""

    now: float
    client: Hashable
    command: int
    params: tuple[float, float, float, float]
    lat_deg: float
    lon_deg: float

    @classmethod
    def from_message(cls, now: float, client: Hashable, message: Any) -> "Command":
        """Read a COMMAND_LONG or a COMMAND_INT."""
        params = (message.param1, message.param2, message.param3, message.param4)
        if message.get_type() == "COMMAND_INT":
            return cls(now, client, message.command, params, message.x * 1e-7, message.y * 1e-7)
        return cls(now, client, message.command, params, message.param5, message.param6)

    @property
    def position(self) -> Position | None:
        """The position meant, or None if the numbers are none."""
        if not (abs(self.lat_deg) <= 90.0 and abs(self.lon_deg) <= 180.0):
            return None
        return Position(self.lat_deg, self.lon_deg)


@dataclass(frozen=True)
class Answer:
    """The result of a command and the messages to send to the asker after its COMMAND_ACK."""

    result: int
    messages: tuple[Any, ...] = ()


class Commands:
    """The table of commands this autopilot knows; every other one is UNSUPPORTED."""

    def __init__(
        self, navigator: Navigator, reports: Reports, streams: Streams, arming_checks: bool, deaf: int = 0
    ) -> None:
        self._navigator = navigator
        self._reports = reports
        self._streams = streams
        self._arming_checks = arming_checks
        self._deaf = deaf
        self._table: dict[int, Callable[[Command], Answer]] = {
            mav.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mav.MAV_CMD_DO_SET_MODE: self._set_mode,
            mav.MAV_CMD_MISSION_START: self._start_mission,
            mav.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            mav.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda command: self._enter(Mode.RTL),
            mav.MAV_CMD_NAV_LOITER_UNLIM: lambda command: self._enter(Mode.LOITER),
            mav.MAV_CMD_DO_REPOSITION: self._reposition,
            mav.MAV_CMD_DO_CHANGE_SPEED: self._change_speed,
            mav.MAV_CMD_DO_SET_HOME: self._set_home,
            mav.MAV_CMD_GET_HOME_POSITION: lambda command: Answer(ACCEPTED, (reports.home_position(),)),
            mav.MAV_CMD_REQUEST_MESSAGE: self._request_message,
            mav.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mav.MAV_CMD_GET_MESSAGE_INTERVAL: self._get_interval,
            mav.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda command: Answer(
                ACCEPTED, (reports.autopilot_version(),)
            ),
        }

    def run(self, command: Command) -> Answer:
        """Do what a command says."""
        action = self._table.get(command.command)
        return Answer(UNSUPPORTED) if action is None else action(command)

    def _arm(self, command: Command) -> Answer:
        wanted, force = command.params[0], command.params[1] == _FORCE
        navigator = self._navigator
        if wanted not in (0.0, 1.0):
            return Answer(UNSUPPORTED)
        if wanted == 1.0 and self._arming_checks and not navigator.position_ok and not force:
            navigator.say(mav.MAV_SEVERITY_CRITICAL, "Arm: need position estimate")
            return Answer(FAILED)
        if navigator.armed != (wanted == 1.0):
            navigator.armed = wanted == 1.0
            navigator.say(mav.MAV_SEVERITY_INFO, "Throttle armed" if navigator.armed else "Throttle disarmed")
        return Answer(ACCEPTED)

    def _set_mode(self, command: Command) -> Answer:
        # Ground stations may add other flags of the base mode, such as "armed"; this one must be there.
        base = command.params[0]
        if not math.isfinite(base) or not int(base) & mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return Answer(DENIED)
        return self.enter_number(command.params[1])

    def enter_number(self, custom_mode: float) -> Answer:
        """Enter the mode with ArduPilot's number, as DO_SET_MODE and SET_MODE want it."""
        try:
            mode = Mode(int(custom_mode))
        except (ValueError, OverflowError):
            return Answer(FAILED)
        return self._enter(mode)

    def _enter(self, mode: Mode) -> Answer:
        return Answer(ACCEPTED if self._navigator.set_mode(mode) else FAILED)

    def _start_mission(self, command: Command) -> Answer:
        if command.params[0] != 0.0 or command.params[1] != 0.0:
            return Answer(DENIED)  # a first and a last item are not supported
        return self._enter(Mode.AUTO)

    def _set_mission_current(self, command: Command) -> Answer:
        seq, restart = command.params[0], command.params[1] == 1.0
        if not math.isfinite(seq):
            return Answer(DENIED)
        number = self._navigator.current if seq == -1.0 else int(seq)
        if self._deaf:
            self._deaf -= 1
            return Answer(ACCEPTED, (self._reports.mission_current(),))
        if not self._navigator.set_current(number, restart):
            return Answer(FAILED)
        return Answer(ACCEPTED, (self._reports.mission_current(),))

    def _reposition(self, command: Command) -> Answer:
        position = command.position
        if position is None:
            return Answer(DENIED)
        may_change_mode = math.isfinite(command.params[1]) and int(command.params[1]) & 1
        if self._navigator.mode is not Mode.GUIDED:
            if not may_change_mode:
                return Answer(DENIED)
            if not self._navigator.set_mode(Mode.GUIDED):
                return Answer(FAILED)
        self._navigator.guide_to(position)
        return Answer(ACCEPTED)

    def _change_speed(self, command: Command) -> Answer:
        speed_mps = command.params[1]
        if not (math.isfinite(speed_mps) and speed_mps > 0.0):
            return Answer(DENIED)
        self._navigator.set_speed(speed_mps)
        return Answer(ACCEPTED)

    def _set_home(self, command: Command) -> Answer:
        here = command.params[0] == 1.0
        position = self._navigator.vessel.position if here else command.position
        if position is None:
            return Answer(DENIED)
        self._navigator.store.home = position
        return Answer(ACCEPTED, (self._reports.home_position(),))

    def _request_message(self, command: Command) -> Answer:
        number = command.params[0]
        message = self._reports.build(int(number)) if math.isfinite(number) else None
        return Answer(FAILED) if message is None else Answer(ACCEPTED, (message,))

    def _set_interval(self, command: Command) -> Answer:
        message_id, interval_us = command.params[0], command.params[1]
        if not (math.isfinite(message_id) and math.isfinite(interval_us)):
            return Answer(DENIED)
        done = self._streams.set_interval(command.now, command.client, int(message_id), interval_us)
        return Answer(ACCEPTED if done else FAILED)

    def _get_interval(self, command: Command) -> Answer:
        if not 0.0 <= command.params[0] <= 0xFFFF:
            return Answer(FAILED)
        message_id = int(command.params[0])
        interval = self._streams.interval_us(command.client, message_id)
        return Answer(ACCEPTED, (mav.MAVLink_message_interval_message(message_id, interval),))
