"""What the bridge says to the vehicle and hears from it. Sans-io: times are this computer's, and come as arguments."""

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.bridge.clock import VehicleClock
from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.lag import Timed
from autonomy.mavlink.companion import Stream, StreamRequests, heartbeat, status_text
from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.telemetry import Telemetry
from autonomy.mavlink.vehicle import VehicleState

_HEARTBEAT_S = 1.0
_WORDS_S = 10.0
_STAMPED = frozenset({"SYSTEM_TIME", "GLOBAL_POSITION_INT", "ATTITUDE"})
"""Stamped by ArduPilot when they are sent."""

_STREAMS = (Stream(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 2.0, mavlink.MAV_DATA_STREAM_EXTRA3),)


class VehicleLink:
    """Follows the vehicle and its clock; makes the messages that carry readings.

    It asks the vehicle for nothing but its time, and commands nothing.
    """

    def __init__(self, configuration: BridgeConfiguration) -> None:
        self._section = configuration.mavlink
        pump = configuration.pump
        self._pump_name = None if pump is None else pump.message_name
        self._telemetry = Telemetry("", vehicle_system_id=self._section.system_id)
        self._requests: StreamRequests | None = None
        self._asked_of = 0
        self._heartbeat_due = -math.inf
        self._words_due = -math.inf
        self._words: tuple[str, int] | None = None
        self._last_ms: dict[str, int] = {}
        self.clock = VehicleClock()

    @property
    def vehicle(self) -> VehicleState | None:
        """The vehicle; None before it was heard."""
        return self._telemetry.state

    def handle(self, now: float, message: Any) -> tuple[list[Any], float | None]:
        """Take in a message; returns what is to be sent, and the value that it tells of the pump, if it does."""
        kind = message.get_type()
        if kind == "NAMED_VALUE_FLOAT":
            return [], self._pump_value(message)
        self._telemetry.handle(now, message)
        self._telemetry.take_texts()
        if kind in _STAMPED and self._telemetry.is_from_autopilot(message):
            reboots = self.clock.reboots
            self.clock.observe(now, message.time_boot_ms)
            if self.clock.reboots != reboots:
                self._last_ms.clear()
        return ([] if self._requests is None else self._requests.handle(now, message)), None

    def step(self, now: float, *, active: bool) -> list[Any]:
        """What is to be sent by now; to be called several times a second. `active`: readings are being sent."""
        sent = []
        if now >= self._heartbeat_due:
            sent.append(heartbeat(active))
            self._heartbeat_due = now + _HEARTBEAT_S
        if self._words is not None and now >= self._words_due:
            sent.append(status_text(*self._words))
            self._words, self._words_due = None, now + _WORDS_S
        state = self.vehicle
        if state is None:
            return sent
        if self._requests is None or self._asked_of != self.clock.reboots:
            # Its wishes are forgotten by a vehicle that has started again.
            self._asked_of = self.clock.reboots
            route = Route(state.system_id, self._section.component_id, state.system_id, state.component_id)
            self._requests = StreamRequests(_STREAMS, route)
            return sent + self._requests.start(now)
        return sent + self._requests.on_deadline(now)

    def tell(self, text: str, *, warning: bool) -> None:
        """Have the operator told, unless something newer comes before it is time for another line."""
        self._words = text, mavlink.MAV_SEVERITY_WARNING if warning else mavlink.MAV_SEVERITY_INFO

    def reading(self, now: float, name: str, timed: Timed) -> Any | None:
        """The message for a reading; None as long as the vehicle's time then is not known."""
        stamp_ms = self.clock.stamp(now, timed.taken_s)
        if self.vehicle is None or stamp_ms is None:
            return None
        last_ms = self._last_ms.get(name)
        if last_ms is not None and 0 <= last_ms - stamp_ms < 1000:
            stamp_ms = (
                last_ms + 1
            )  # the estimate of the vehicle's clock may sink a little between two readings
        self._last_ms[name] = stamp_ms
        return mavlink.MAVLink_named_value_float_message(stamp_ms, name.encode(), timed.value)

    def _pump_value(self, message: Any) -> float | None:
        state, wanted = self.vehicle, self._pump_name
        if wanted is None or state is None or message.get_srcSystem() != state.system_id:
            return None
        name = message.name if isinstance(message.name, str) else message.name.decode(errors="replace")
        return float(message.value) if name.split("\0", 1)[0] == wanted else None
