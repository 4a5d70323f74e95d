"""Making a verified mission the one that is sailed, from its first waypoint: one sans-io state machine."""

from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import Route, has_home_item
from autonomy.mavlink.mission_upload import COUNT_INTERVAL_S, SILENCE_S, retry_interval

_COMMAND = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
_PATIENCE_S = 3 * SILENCE_S


class MakingCurrent(Enum):
    """Where the change of the current item stands."""

    IDLE = "not started"
    COMMANDED = "waiting for the command's answer"
    CONFIRMING = "waiting for MISSION_CURRENT"
    SETTING = "set the old-fashioned way, waiting for MISSION_CURRENT"
    DONE = "the mission is being sailed"
    FAILED = "refused, or not confirmed"


class MakeCurrent:
    """Sends the boat to the first waypoint of the mission on board, also when that mission was complete.

    Theory of operation. After an upload in AUTO the autopilot may keep its old index, or have finished.
    DO_SET_MISSION_CURRENT heals both; for a complete mission its param2 asks for a restart.

        state       accepted    unsupported   refused   later, failed   MISSION_CURRENT active   complete    timer
        COMMANDED   CONFIRMING  SETTING       FAILED    COMMANDED       -                        -           command again
        CONFIRMING  -           -             -         -               DONE                     [a]         ask for MISSION_CURRENT
        SETTING     -           -             -         -               DONE                     -           set again

    [a] COMMANDED, at once if a restart was not asked for yet; else when the timer comes: an autopilot that stays
        complete whatever it accepts would be commanded, and answer, as fast as the link is.

    Before the command is accepted MISSION_CURRENT still tells about the old mission. Twelve seconds without
    success: FAILED. An autopilot that doesn't tell its mission state (0) counts as active.
    """  # noqa: E501

    def __init__(
        self, route: Route, *, autopilot: int, mission_state: int = 0, time_scale: float = 1.0
    ) -> None:
        self._route = route
        self._first = 1 if has_home_item(autopilot) else 0
        self._restart = mission_state == mavlink.MISSION_STATE_COMPLETE
        self._time_scale = time_scale
        self._give_up_at = 0.0
        self._repeats = 0
        self._deadline: float | None = None
        self._last_heard = "nothing"
        self.state = MakingCurrent.IDLE
        self.reason = ""
        self.refused = False
        """Whether the vehicle will not do it, now or later."""

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called."""
        return self._deadline

    def start(self, now: float) -> list[Any]:
        """Send the command."""
        self._give_up_at = now + _PATIENCE_S
        return self._command(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """React to one message of the vehicle; returns what to send."""
        kind = message.get_type()
        if kind == "COMMAND_ACK" and message.command == _COMMAND and self._route.is_from_vehicle(message):
            return self._on_ack(now, message.result) if self._route.is_for_us(message) else []
        if kind == "MISSION_CURRENT" and self._route.is_from_vehicle(message):
            return self._on_current(now, message)
        return []

    def on_deadline(self, now: float) -> list[Any]:
        """Repeat what may have been lost, if it is time to."""
        if self._deadline is None or now < self._deadline:
            return []
        if now >= self._give_up_at:
            return self._fail(f"not confirmed: {self.state.value}, last heard: {self._last_heard}")
        self._repeats += 1
        self._wait(now)
        if self.state is MakingCurrent.COMMANDED:
            return [self._command_message(self._repeats)]
        return [self._set_message() if self.state is MakingCurrent.SETTING else self._request_message()]

    def _on_ack(self, now: float, result: int) -> list[Any]:
        if self.state is not MakingCurrent.COMMANDED:
            return []
        self._last_heard = f"command result {result}"
        if result == mavlink.MAV_RESULT_ACCEPTED:
            self.state = MakingCurrent.CONFIRMING
            self._repeats = 0
            self._wait(now)
        elif result == mavlink.MAV_RESULT_UNSUPPORTED:
            self.state = MakingCurrent.SETTING
            self._repeats = 0
            self._wait(now)
            return [self._set_message()]
        elif result == mavlink.MAV_RESULT_DENIED:
            self.refused = True
            return self._fail("the vehicle refuses to set the current mission item")
        return []  # temporarily rejected, failed, in progress: the timer asks again

    def _on_current(self, now: float, message: Any) -> list[Any]:
        if self.state not in (MakingCurrent.CONFIRMING, MakingCurrent.SETTING):
            return []
        self._last_heard = f"MISSION_CURRENT {message.seq}, state {message.mission_state}"
        if message.mission_state == mavlink.MISSION_STATE_COMPLETE:
            if self.state is MakingCurrent.SETTING:
                return []
            if self._restart:
                self.state = MakingCurrent.COMMANDED
                return []
            self._restart = True
            return self._command(now)
        active = (mavlink.MISSION_STATE_UNKNOWN, mavlink.MISSION_STATE_ACTIVE)
        if message.seq >= self._first and message.mission_state in active:
            self.state = MakingCurrent.DONE
            self._deadline = None
        return []

    def _command(self, now: float) -> list[Any]:
        self.state = MakingCurrent.COMMANDED
        self._repeats = 0
        self._wait(now)
        return [self._command_message(0)]

    def _wait(self, now: float) -> None:
        self._deadline = now + retry_interval(COUNT_INTERVAL_S, self._repeats, self._time_scale)

    def _command_message(self, confirmation: int) -> Any:
        route, restart = self._route, float(self._restart)
        return mavlink.MAVLink_command_long_message(
            route.vehicle_system,
            route.vehicle_component,
            _COMMAND,
            min(confirmation, 255),
            self._first,
            restart,
            0,
            0,
            0,
            0,
            0,
        )

    def _set_message(self) -> Any:
        route = self._route
        return mavlink.MAVLink_mission_set_current_message(
            route.vehicle_system, route.vehicle_component, self._first
        )

    def _request_message(self) -> Any:
        route, wanted = self._route, mavlink.MAVLINK_MSG_ID_MISSION_CURRENT
        return mavlink.MAVLink_command_long_message(
            route.vehicle_system,
            route.vehicle_component,
            mavlink.MAV_CMD_REQUEST_MESSAGE,
            0,
            wanted,
            0,
            0,
            0,
            0,
            0,
            0,
        )

    def _fail(self, reason: str) -> list[Any]:
        self.state = MakingCurrent.FAILED
        self.reason = reason
        self._deadline = None
        return []
