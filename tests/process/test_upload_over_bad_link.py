"""Missions to the simulated vessel, a process of its own, over real UDP that loses, doubles and reorders.

HALOCLINE_UPLOADS sets how many are sent at the wall clock's pace (one, unless set); two go at ten times it.
"""

import asyncio
import os
import random
import signal
import socket
import sys
from collections.abc import Hashable
from typing import Any

import pytest

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.companion import heartbeat
from autonomy.mavlink.mission import MissionTransfer, Route, Verified, time_scale, waypoint
from autonomy.mavlink.telemetry import Telemetry
from autonomy.shell.transport import Transport

UPLOADS = int(os.environ.get("HALOCLINE_UPLOADS", "1"))
LENGTH, LOSS, DOUBLED, DELAY_S = 30, 0.2, 0.1, 0.03
LIMIT_S = 60.0
START = (33.5, -118.9)

pytestmark = pytest.mark.process


class BadLink(asyncio.DatagramProtocol):
    """Stands between one client and the vessel's address, treats each datagram by its own dice."""

    def __init__(self, vessel: tuple[str, int], seed: int) -> None:
        self._vessel = vessel
        self._client: Any = None
        self._dice = random.Random(seed)
        self._transport: Any = None

    def connection_made(self, transport: Any) -> None:
        self._transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        if addr != self._vessel:
            self._client = addr
        to = self._client if addr == self._vessel else self._vessel
        for _ in range(2 if self._dice.random() < DOUBLED else 1):
            if self._dice.random() >= LOSS and to is not None:
                asyncio.get_running_loop().call_later(
                    DELAY_S * self._dice.random(), self._transport.sendto, data, to
                )


class Companion:
    """The least that carries a transfer over a transport."""

    def __init__(self, endpoint: str) -> None:
        self.codec = Codec(1, 191)
        self.telemetry = Telemetry("SALT")
        self.transfer: MissionTransfer | None = None
        self.transport = Transport.open(endpoint, self._received, lambda: None, lambda reason: None)
        self._loop = asyncio.get_running_loop()

    def send(self, messages: list[Any]) -> None:
        for message in messages:
            self.transport.send(self.codec.encode(message))

    def _received(self, data: bytes, peer: Hashable) -> None:
        for message in self.codec.decode(data, peer):
            self.telemetry.handle(self._loop.time(), message)
            if self.transfer is not None:
                self.send(self.transfer.handle(self._loop.time(), message))

    async def measure(self) -> None:
        """Wait until the vehicle and the pace of its clock are known."""
        for _ in range(30):
            self.send([heartbeat(active=False)])
            await asyncio.sleep(0.1)
        assert self.telemetry.state is not None

    async def upload(self, transfer: MissionTransfer) -> float:
        started = self._loop.time()
        self.transfer = transfer
        self.send(transfer.start(started))
        while transfer.outcome is None:
            deadline = transfer.next_deadline()
            assert deadline is not None
            await asyncio.sleep(min(0.01, max(0.0, deadline - self._loop.time())))
            self.send(transfer.on_deadline(self._loop.time()))
        return self._loop.time() - started


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def start_vessel(port: int, *options: str) -> asyncio.subprocess.Process:
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        *("-m", "sim", "vessel", "--listen", f"udpin:127.0.0.1:{port}", *options),
        stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    async with asyncio.timeout(60):
        assert b"ready" in await process.stdout.readline()
    return process


async def run(uploads: int, *options: str) -> None:
    port = free_port()
    vessel = await start_vessel(port, *options)
    loop = asyncio.get_running_loop()
    link, _ = await loop.create_datagram_endpoint(
        lambda: BadLink(("127.0.0.1", port), seed=1), local_addr=("127.0.0.1", 0)
    )
    companion = Companion(f"udpout:127.0.0.1:{link.get_extra_info('sockname')[1]}")
    try:
        await companion.measure()
        for number in range(uploads):
            await upload_once(companion, number)
    finally:
        await companion.transport.close()
        link.close()
        vessel.send_signal(signal.SIGTERM)
        await vessel.communicate()
    assert vessel.returncode == 0


async def upload_once(companion: Companion, number: int) -> None:
    items = [
        waypoint(START[0] + (n + number) / 1e4, START[1], acceptance_radius_m=5.0) for n in range(LENGTH)
    ]
    state, pace = companion.telemetry.state, time_scale(companion.telemetry.clock_rate)
    assert state is not None
    route = Route(1, 191, state.system_id, state.component_id)
    transfer = MissionTransfer(items, route, autopilot=state.autopilot, time_scale=pace, limit_s=LIMIT_S)
    seconds = await companion.upload(transfer)
    print(f"upload {number + 1}: {seconds:.1f} s at pace {pace:.2f}, {transfer.outcome.__class__.__name__}")
    assert isinstance(transfer.outcome, Verified), transfer.outcome


@pytest.mark.timeout(60 + LIMIT_S * UPLOADS)
def test_at_the_wall_clocks_pace() -> None:
    asyncio.run(run(UPLOADS))


def test_a_simulation_whose_timers_run_ten_times_as_fast() -> None:
    asyncio.run(run(2, "--speedup", "10", "--sitl-timers"))
