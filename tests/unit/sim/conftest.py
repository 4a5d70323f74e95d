"""A ground station's end of the simulated autopilot: every message is really packed and parsed."""

from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot import ALL, Autopilot, Options
from sim.sensor import Sensor
from sim.vessel import Position, Vessel

START = Position(33.70, -118.40)


class Flat:
    """A field whose value is the time, so that a reading tells when it was taken."""

    def value(self, lat_deg: Any, lon_deg: Any, time_s: Any) -> Any:
        return np.asarray(time_s, dtype=float)

    def is_land(self, lat_deg: Any, lon_deg: Any) -> Any:
        return np.zeros(np.shape(lat_deg), dtype=bool)


class Station:
    """One client with a MAVLink identity; `heard` holds what was sent to it, parsed again."""

    def __init__(self, bench: "Bench", name: Hashable, system: int, component: int) -> None:
        self.bench = bench
        self.name = name
        self.heard: list[Any] = []
        self._packer = mav.MAVLink(None, system, component)

    def send(self, kind: str, *fields: Any, **named: Any) -> list[Any]:
        """Send a message of a kind such as "mission_count"; the answers to us alone (`heard` has the rest)."""
        message = getattr(mav, f"MAVLink_{kind}_message")(*fields, **named)
        (parsed,) = mav.MAVLink(None).parse_buffer(message.pack(self._packer))
        outgoing = self.bench.autopilot.handle(self.bench.now, parsed, self.name)
        self.bench.deliver(outgoing)
        return [each for target, each in outgoing if target == self.name]

    def command(self, command: int, *params: float) -> int:
        """Send a COMMAND_LONG; the result in its acknowledgement."""
        answers = self.send("command_long", 1, 1, command, 0, *params, *[0.0] * (7 - len(params)))
        (result,) = [each.result for each in answers if each.get_type() == "COMMAND_ACK"]
        return int(result)

    def item(self, seq: int, position: Position = START, command: int = 16, **named: Any) -> list[Any]:
        """Send MISSION_ITEM_INT number `seq`."""
        fields = {
            "frame": 6,
            "current": 0,
            "autocontinue": 0,
            "param1": 0.0,
            "param2": 0.0,
            "param3": 0.0,
            "param4": 0.0,
            "x": round(position.lat_deg * 1e7),
            "y": round(position.lon_deg * 1e7),
            "z": 0.0,
            "mission_type": 0,
        } | named
        return self.send(
            "mission_item_int", target_system=1, target_component=1, seq=seq, command=command, **fields
        )

    def upload(self, *positions: Position, hold_s: float = 0.0) -> int:
        """Upload home and waypoints; the result of the final acknowledgement."""
        self.send("mission_count", 1, 1, len(positions) + 1, 0)
        answers = self.item(0)
        for seq, position in enumerate(positions, start=1):
            answers = self.item(seq, position, param1=hold_s)
        return int(answers[-1].type)

    def of(self, kind: str) -> list[Any]:
        """Everything of one type that was heard."""
        return [each for each in self.heard if each.get_type() == kind]

    def texts(self) -> list[str]:
        """Texts of the STATUSTEXTs heard."""
        return [each.text for each in self.of("STATUSTEXT")]


class Bench:
    """An autopilot and its clients on one clock."""

    def __init__(self, **options: Any) -> None:
        self.now = 100.0
        sensor = Sensor(Flat(), np.random.default_rng(0))
        self.autopilot = Autopilot(Vessel(START), sensor, Options(**options))
        self.stations: dict[Hashable, Station] = {}
        self._packer = mav.MAVLink(None, 1, 1)

    def station(self, name: Hashable = "gcs", system: int = 255, component: int = 190) -> Station:
        """A new client that has joined."""
        station = self.stations[name] = Station(self, name, system, component)
        self.autopilot.join(self.now, name)
        return station

    def deliver(self, outgoing: list[tuple[Any, Any]]) -> None:
        """Hand messages to the stations they are for."""
        for target, message in outgoing:
            packet = message.pack(self._packer)
            for name, station in self.stations.items():
                if target is ALL or target == name:
                    station.heard += mav.MAVLink(None).parse_buffer(packet)

    def advance(self, seconds: float, speedup: float = 1.0, step_s: float = 0.5) -> None:
        """Let protocol time pass, with simulated time running `speedup` times as fast."""
        for _ in range(round(seconds / step_s)):
            self.now += step_s
            self.deliver(self.autopilot.advance(self.now, step_s * speedup))


@pytest.fixture
def bench() -> Bench:
    """A bench with ArduPilot's habits."""
    return Bench()


@pytest.fixture
def make_bench() -> Callable[..., Bench]:
    """Makes a bench with other options of the autopilot."""
    return Bench


@pytest.fixture
def gcs(bench: Bench) -> Station:
    """A ground station at the bench."""
    return bench.station()
