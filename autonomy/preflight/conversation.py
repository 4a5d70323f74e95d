"""Listening to a vehicle, and asking it what it has: sans-io. Nothing that is said here makes it do anything."""

import math
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration, MavlinkSection
from autonomy.mavlink.companion import Stream, StreamRequests, heartbeat, wanted_streams
from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.safeguards import SafeguardsReading
from autonomy.mavlink.telemetry import Telemetry
from autonomy.mavlink.vehicle import VehicleState

_HEARTBEAT_S = 1.0
_ASK_AGAIN_S = 1.5
_MOST_QUESTIONS = 6
_MOST_NAMES = 64
_KEPT_TEXTS = 20
_KEPT_OBSERVATIONS = 10_000


@dataclass
class Named:
    """What came in as NAMED_VALUE_FLOAT under one name."""

    count: int = 0
    first_s: float = math.nan
    last_s: float = math.nan
    systems: set[int] = field(default_factory=set)
    components: set[int] = field(default_factory=set)

    @property
    def rate_hz(self) -> float:
        """Readings a second, between the first and the last; NaN of one."""
        passed_s = self.last_s - self.first_s
        return (self.count - 1) / passed_s if self.count > 1 and passed_s > 0.0 else math.nan


class Conversation:
    """Follows the vehicle that is ours and asks it for streams, its version, its fence, rally points and failsafes.

    Times are protocol time. `handle` takes what arrives, `step` is to be called several times a second; both return
    what is to be sent.
    """

    def __init__(self, section: MavlinkSection, telemetry: Telemetry, streams: Sequence[Stream]) -> None:
        self._section = section
        self._wanted = tuple(streams)
        self._heartbeat_due = -math.inf
        self._questions = 0
        self._question_due = -math.inf
        self._streams: StreamRequests | None = None
        self._reading: SafeguardsReading | None = None
        self.telemetry = telemetry
        self.newest: dict[str, tuple[float, Any]] = {}
        """The autopilot's own last message of each type, with its time."""
        self.counts: Counter[str] = Counter()
        """How many of each type."""
        self.named: dict[str, Named] = {}
        self.autopilots: Counter[int] = Counter()
        """Heartbeats of autopilots, by system."""
        self.observations: deque[Observation] = deque(maxlen=_KEPT_OBSERVATIONS)
        self.texts: deque[str] = deque(maxlen=_KEPT_TEXTS)

    @classmethod
    def of(cls, configuration: Configuration) -> "Conversation":
        """With the vehicle and the instrument of a configuration, asking for what the service would."""
        section = configuration.mavlink
        # Asked for here they would be there now, and missing when the service, which only looks on, runs alone.
        looks_on = configuration.authority.mode == "observe"
        streams = () if looks_on else wanted_streams(section.position_rate_hz, battery=True)
        return cls(section, Telemetry.of(configuration), streams)

    @property
    def state(self) -> VehicleState | None:
        """The vehicle as last heard."""
        return self.telemetry.state

    @property
    def safeguards(self) -> SafeguardsReading | None:
        """What is known of its fence, rally points and failsafes; None before it was heard."""
        return self._reading

    @property
    def version(self) -> Any | None:
        """Its AUTOPILOT_VERSION."""
        return self.newest.get("AUTOPILOT_VERSION", (0.0, None))[1]

    def handle(self, now: float, message: Any) -> list[Any]:
        """Take in one message that arrived at `now`."""
        kind = message.get_type()
        if kind == "HEARTBEAT" and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
            self.autopilots[message.get_srcSystem()] += 1
        elif kind == "NAMED_VALUE_FLOAT":
            self._on_named(now, message)
        self.observations.extend(self.telemetry.handle(now, message))
        self.texts.extend(each.text for each in self.telemetry.take_texts())
        state = self.state
        if state is None:
            return []
        if (message.get_srcSystem(), message.get_srcComponent()) == (state.system_id, state.component_id):
            self.newest[kind] = (now, message)
            self.counts[kind] += 1
        sent = self._streams.handle(now, message) if self._streams is not None else []
        return sent + (self._reading.handle(now, message) if self._reading is not None else [])

    def step(self, now: float) -> list[Any]:
        """What is to be sent now."""
        sent = []
        if now >= self._heartbeat_due:
            sent.append(heartbeat(active=False))
            self._heartbeat_due = now + _HEARTBEAT_S
        state = self.state
        if state is None:
            return sent
        if self._reading is None or self._streams is None:
            route = Route(state.system_id, self._section.component_id, state.system_id, state.component_id)
            self._reading = SafeguardsReading(route, autopilot=state.autopilot)
            self._streams = StreamRequests(self._wanted, route)
            return sent + self._reading.start(now) + (self._streams.start(now) if self._wanted else [])
        return sent + self._reading.step(now) + self._streams.on_deadline(now) + self._ask_version(now, state)

    def _ask_version(self, now: float, state: VehicleState) -> list[Any]:
        if self.version is not None or now < self._question_due or self._questions >= _MOST_QUESTIONS:
            return []
        self._questions += 1
        self._question_due = now + _ASK_AGAIN_S
        wanted = (mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0)
        return [
            mavlink.MAVLink_command_long_message(
                state.system_id, state.component_id, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, *wanted
            )
        ]

    def _on_named(self, now: float, message: Any) -> None:
        name = message.name if isinstance(message.name, str) else message.name.decode(errors="replace")
        name = name.split("\0", 1)[0]
        if name not in self.named and len(self.named) >= _MOST_NAMES:
            return
        seen = self.named.setdefault(name, Named(first_s=now))
        seen.count, seen.last_s = seen.count + 1, now
        seen.systems.add(message.get_srcSystem())
        seen.components.add(message.get_srcComponent())
