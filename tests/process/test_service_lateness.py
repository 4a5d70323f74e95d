"""While a planning job burns a core, the service keeps its hours.

HALOCLINE_BURN_S sets for how long the job burns (3 s, unless set).
"""

import contextlib
import os
import pickle
import select
import socket
import struct
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import configure
from bad_line import BadLine
from processes import SOON_S, Processes, Running
from shore_helpers import free_endpoint, router

from autonomy.mavlink.codec import Codec
from autonomy.shore.subscriber import Subscriber
from sim.autopilot import Autopilot, Options
from sim.autopilot.modes import Mode
from sim.field import open_field
from sim.router import Packets, Router
from sim.sensor import Sensor
from sim.vessel import Position, Vessel

pytestmark = pytest.mark.process

BURN_S = float(os.environ.get("HALOCLINE_BURN_S", "3"))
LATE_S = 0.3
ATTEMPTS = 4
HEARTBEAT_S = 1.0
START = Position(33.945, -118.810)
AREA = [[33.940, -118.815], [33.940, -118.805], [33.950, -118.805], [33.950, -118.815]]
_SO_TIMESTAMPNS = 35  # asm-generic/socket.h; the ancillary message has the same number
_AUTO, _ARM, _SET_MODE = 10.0, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE


class PromptVehicle:
    """An autopilot that sails by the wall clock and stamps messages with it; its operator starts every mission.

    The kernel notes when our datagrams come in: what is measured is the service, not this process.
    """

    def __init__(self) -> None:
        field = open_field("synthetic-patch", None)
        sensor = Sensor(field, np.random.default_rng(0), interval_s=0.1, noise_std=0.01)
        self._autopilot = Autopilot(Vessel(START), sensor, Options(speed_mps=10.0))
        self._router = Router(self._autopilot)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._operator = Codec(255, 190)
        self._listener = Codec(254, 1)
        self.port = int(self._socket.getsockname()[1])
        self.heartbeats_s: list[float] = []
        self.epoch_s = self._before = time.monotonic()

    def close(self) -> None:
        self._socket.close()

    def sail(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            readable, _, _ = select.select([self._socket], [], [], 0.01)
            if readable:
                self._receive()
            now = time.monotonic()
            self._send(self._router.advance(now, now - self._before))
            self._before = now
            self._start_survey(now)

    def _receive(self) -> None:
        data, ancillary, _, client = self._socket.recvmsg(2048, 64)
        seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
        for message in self._listener.decode(data):
            if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 191:
                self.heartbeats_s.append(seconds + nanoseconds / 1e9)
        self._send(self._router.receive(time.monotonic(), client, data))

    def _send(self, packets: Packets) -> None:
        for client, packet in packets:
            if client != "operator":
                self._socket.sendto(packet, client)

    def _start_survey(self, now: float) -> None:
        navigator = self._autopilot.navigator
        if self._autopilot.store.total and not navigator.armed:
            self._command(now, _ARM, 1.0)
        elif navigator.armed and navigator.mode is not Mode.AUTO:
            self._command(now, _SET_MODE, float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), _AUTO)

    def _command(self, now: float, command: int, *parameters: float) -> None:
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        message: Any = mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded)
        self._send(self._router.receive(now, "operator", self._operator.encode(message)))


def sail_until(vehicle: PromptVehicle, service: Running, words: str, count: int, within_s: float) -> None:
    deadline = time.monotonic() + within_s
    while service.said.count(words) < count:
        assert time.monotonic() < deadline, f"{words!r} not said {count} times within {within_s} s"
        vehicle.sail(0.2)


@dataclass(frozen=True)
class Hours:
    """How a service kept its hours: seconds that its job took, heartbeats came late, messages waited."""

    job_s: float
    late_s: list[float]
    waits_s: list[float]

    @property
    def kept(self) -> bool:
        """Whether nothing was late."""
        return max(self.late_s) <= LATE_S and max(self.waits_s) <= LATE_S

    def __str__(self) -> str:
        return (
            f"job of {self.job_s:.1f} s: {len(self.late_s) + 1} heartbeats, latest by {max(self.late_s):.3f} s; "
            f"{len(self.waits_s)} messages, longest wait {max(self.waits_s):.3f} s"
        )


def serve(folder: Path, **shore: Any) -> Hours:
    """One service from its start until the second plan is on board; `shore` goes into its configuration."""
    vehicle = PromptVehicle()
    config = configure(
        folder,
        f"udpout:127.0.0.1:{vehicle.port}",
        survey={"area": AREA},
        sampling={"spacing_m": 2.0},
        exploration={"minimum_basis": 2},
        model={"centring_samples": 5},
        shore=shore,
    )
    notes = folder / "notes"
    program = str(Path(__file__).with_name("witness.py"))
    with contextlib.closing(vehicle), Processes() as processes:
        service = processes.start(program, str(config), repr(vehicle.epoch_s), str(BURN_S), str(notes))
        sail_until(vehicle, service, "plan 2", 1, SOON_S + BURN_S)
        sail_until(vehicle, service, "waypoints verified on board", 2, SOON_S)
        vehicle.sail(1.0)
        assert service.stop() == 0
    seen = pickle.loads(notes.read_bytes())
    (_, began), (_, ended) = [job for job in seen["jobs"] if job[0] == "started"][1], seen["jobs"][3]
    return Hours(ended - began, (np.diff(vehicle.heartbeats_s) - HEARTBEAT_S).tolist(), seen["waits_s"])


@pytest.mark.timeout(ATTEMPTS * (200 + 2 * BURN_S))
def test_a_planning_job_delays_neither_heartbeats_nor_messages(tmp_path: Path) -> None:
    """A service that waits for its jobs does so every time; a busy machine holds it up now and then."""
    _expect_kept(tmp_path)


@pytest.mark.skipif("HALOCLINE_THIN_S" not in os.environ, reason="HALOCLINE_THIN_S is not set")
@pytest.mark.timeout(ATTEMPTS * (200 + 2 * BURN_S))
@pytest.mark.parametrize("rate", [200.0, None], ids=["limited", "flooded"])
def test_nor_does_a_thin_link_ashore(tmp_path: Path, rate: float | None) -> None:
    """2400 bits per second, with a limit below that, and without one: then zenoh's buffers are always full."""
    endpoint = free_endpoint()
    with (
        router(endpoint),
        BadLine(endpoint, bytes_per_s=300.0) as line,
        Subscriber("*", connect=[endpoint]) as ashore,
    ):
        _expect_kept(tmp_path, connect=[line.endpoint], rate_limit_bytes_per_s=rate)
        assert ashore.vehicles() == ["boat1"]


def _expect_kept(tmp_path: Path, **shore: Any) -> None:
    for attempt in range(ATTEMPTS):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        hours = serve(folder, **shore)
        print(hours)
        assert hours.job_s >= BURN_S
        assert len(hours.late_s) >= BURN_S
        assert len(hours.waits_s) >= 20 * BURN_S
        if hours.kept:
            break
    assert hours.kept
