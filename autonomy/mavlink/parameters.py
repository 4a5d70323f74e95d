"""Reading a few of the autopilot's parameters, and its home: one sans-io state machine."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.mission_upload import retry_interval

_ANSWER_S = 1.5
_ROUNDS = 6


class ParameterReading:
    """Asks for parameters by name, all that are missing at once, and for HOME_POSITION with them.

    Six rounds, then what was not answered counts as unknown to the vehicle: ArduPilot says nothing about a name that
    it doesn't know. Home is not waited for, since there is none before the first fix. What is overheard later is
    taken in too.
    """

    def __init__(self, names: Sequence[str], route: Route, *, time_scale: float = 1.0) -> None:
        self._names = tuple(names)
        self._route = route
        self._time_scale = time_scale
        self._rounds = 0
        self._deadline: float | None = None
        self._values: dict[str, float] = {}
        self.home_deg: tuple[float, float] | None = None
        """Latitude and longitude of home."""

    @property
    def values(self) -> Mapping[str, float]:
        """What was answered."""
        return self._values

    @property
    def finished(self) -> bool:
        """Whether no answer is waited for any more."""
        return self._rounds > 0 and self._deadline is None

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called."""
        return self._deadline

    def start(self, now: float) -> list[Any]:
        """Ask for everything that is not known yet."""
        self._rounds = 0
        return self._ask(now)

    def handle(self, message: Any) -> bool:
        """Take in one message of the vehicle; returns whether it told something new."""
        kind = message.get_type()
        if kind not in ("PARAM_VALUE", "HOME_POSITION") or not self._route.is_from_vehicle(message):
            return False
        news = self._on_home(message) if kind == "HOME_POSITION" else self._on_value(message)
        if not self._missing_names():
            self._deadline = None
        return news

    def on_deadline(self, now: float) -> list[Any]:
        """Ask again for what is missing, if it is time to."""
        if self._deadline is None or now < self._deadline:
            return []
        if self._rounds >= _ROUNDS:
            self._deadline = None
            return []
        return self._ask(now)

    def _on_value(self, message: Any) -> bool:
        name, value = message.param_id, message.param_value
        if name not in self._names or not math.isfinite(value) or self._values.get(name) == value:
            return False
        self._values[name] = value
        return True

    def _on_home(self, message: Any) -> bool:
        home = (message.latitude * 1e-7, message.longitude * 1e-7)
        if home in ((0.0, 0.0), self.home_deg) or abs(home[0]) > 90.0 or abs(home[1]) > 180.0:
            return False
        self.home_deg = home
        return True

    def _missing_names(self) -> list[str]:
        return [name for name in self._names if name not in self._values]

    def _ask(self, now: float) -> list[Any]:
        missing = self._missing_names()
        self._deadline = now + retry_interval(_ANSWER_S, self._rounds, self._time_scale) if missing else None
        self._rounds += 1
        target = (self._route.vehicle_system, self._route.vehicle_component)
        asked = [mavlink.MAVLink_param_request_read_message(*target, name.encode(), -1) for name in missing]
        if self.home_deg is None:
            message = (mavlink.MAVLINK_MSG_ID_HOME_POSITION, 0, 0, 0, 0, 0, 0)
            command = mavlink.MAV_CMD_REQUEST_MESSAGE
            asked.append(mavlink.MAVLink_command_long_message(*target, command, 0, *message))
        return asked
