"""Missions to the simulated vessel, a process of its own, over real UDP that loses, doubles, reorders and damages.

HALOCLINE_UPLOADS sets how many are sent at the wall clock's pace (one, unless set); two go at ten times it beside them.
"""

import asyncio
import os
import sys
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.companion import heartbeat
from autonomy.mavlink.mission import MissionTransfer, Route, Verified, time_scale, waypoint
from autonomy.mavlink.telemetry import Telemetry
from autonomy.shell.transports import open_transport
from sim.link import BadLink, UdpProxy

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes

UPLOADS = int(os.environ.get("HALOCLINE_UPLOADS", "1"))
LENGTH = 30
LIMIT_S = 60.0
START = (33.5, -118.9)

pytestmark = pytest.mark.process


def bad_link(seed: int) -> BadLink:
    """One direction: three in ten are lost, one doubled, one in a hundred damaged, and what arrives is mixed up."""
    rng = np.random.default_rng(seed)
    return BadLink(
        rng, loss=0.3, duplication=0.1, reordering=0.1, corruption=0.01, jitter_s=0.03, held_s=0.05
    )


class Companion:
    """The least that carries a transfer over a transport."""

    def __init__(self, endpoint: str) -> None:
        self.codec = Codec(1, 191)
        self.telemetry = Telemetry("SALT")
        self.transfer: MissionTransfer | None = None
        self.transport = open_transport(endpoint, self._received, lambda: None, lambda reason: None)
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
        turns = 0
        async with asyncio.timeout(LIMIT_S):
            while turns < 30 or self.telemetry.state is None:
                self.send([heartbeat(active=False)])
                await asyncio.sleep(0.1)
                turns += 1

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


async def run(name: str, uploads: int, *options: str) -> None:
    with Processes() as processes:
        vessel = await asyncio.to_thread(processes.vessel, *options)
        async with UdpProxy(
            ("127.0.0.1", 0), ("127.0.0.1", vessel.port), up=bad_link(1), down=bad_link(2)
        ) as proxy:
            companion = Companion(f"udpout:127.0.0.1:{proxy.address[1]}")
            try:
                await companion.measure()
                for number in range(uploads):
                    await upload_once(companion, name, number)
            finally:
                await companion.transport.close()
        assert await asyncio.to_thread(vessel.stop) == 0


async def upload_once(companion: Companion, name: str, number: int) -> None:
    items = [
        waypoint(START[0] + (n + number) / 1e4, START[1], acceptance_radius_m=5.0) for n in range(LENGTH)
    ]
    state, pace = companion.telemetry.state, time_scale(companion.telemetry.clock_rate)
    assert state is not None
    route = Route(1, 191, state.system_id, state.component_id)
    transfer = MissionTransfer(items, route, autopilot=state.autopilot, time_scale=pace, limit_s=LIMIT_S)
    seconds = await companion.upload(transfer)
    print(
        f"{name}: upload {number + 1}: {seconds:.1f} s at pace {pace:.2f}, {transfer.outcome.__class__.__name__}"
    )
    assert isinstance(transfer.outcome, Verified), transfer.outcome


@pytest.mark.timeout(60 + LIMIT_S * UPLOADS)
def test_at_the_wall_clocks_pace_and_to_a_simulation_ten_times_as_fast() -> None:
    async def both() -> None:
        async with asyncio.TaskGroup() as group:
            group.create_task(run("wall clock", UPLOADS))
            group.create_task(run("ten times", 2, "--speedup", "10", "--sitl-timers"))

    asyncio.run(both())
