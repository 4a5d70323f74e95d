"""One command to the autopilot, repeated until it is answered: a sans-io state machine."""

from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.mission_upload import retry_interval

_ANSWER_S = 1.5
_REPEATS = 5
_LATER = (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_IN_PROGRESS)


class Answer(Enum):
    """What became of an order."""

    WAITING = "not answered yet"
    ACCEPTED = "accepted"
    REFUSED = "refused"
    SILENT = "not answered"


class Order:
    """A COMMAND_LONG with some parameters, the rest of them 0."""

    def __init__(self, command: int, parameters: tuple[float, ...], route: Route, time_scale: float) -> None:
        self._command = command
        self._parameters = (*parameters, *(0.0,) * (7 - len(parameters)))
        self._route = route
        self._time_scale = time_scale
        self._repeats = 0
        self._deadline: float | None = None
        self.answer = Answer.WAITING

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called."""
        return self._deadline

    def start(self, now: float) -> list[Any]:
        """Send it."""
        self._deadline = now + retry_interval(_ANSWER_S, self._repeats, self._time_scale)
        target = (self._route.vehicle_system, self._route.vehicle_component)
        return [
            mavlink.MAVLink_command_long_message(*target, self._command, self._repeats, *self._parameters)
        ]

    def handle(self, message: Any) -> None:
        """Take in one message of the vehicle."""
        if self.answer is not Answer.WAITING or message.get_type() != "COMMAND_ACK":
            return
        if message.command != self._command or message.result in _LATER:
            return
        if self._route.is_from_vehicle(message) and self._route.is_for_us(message):
            accepted = message.result == mavlink.MAV_RESULT_ACCEPTED
            self._end(Answer.ACCEPTED if accepted else Answer.REFUSED)

    def on_deadline(self, now: float) -> list[Any]:
        """Send it again, or give up, if it is time to."""
        if self._deadline is None or now < self._deadline:
            return []
        if self._repeats >= _REPEATS:
            self._end(Answer.SILENT)
            return []
        self._repeats += 1
        return self.start(now)

    def _end(self, answer: Answer) -> None:
        self.answer, self._deadline = answer, None
