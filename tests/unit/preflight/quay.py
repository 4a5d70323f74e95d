"""A simulated autopilot on a real socket, within the test's own process."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from autonomy.mavlink.signing import Signing
from sim.autopilot import Autopilot
from sim.endpoints import Endpoint
from sim.server import VesselServer


@contextmanager
def served(autopilot: Autopilot, signing: Signing | None = None) -> Iterator[int]:
    """The autopilot on a free UDP port of the loopback interface."""
    ready = threading.Event()
    opened: list[tuple[VesselServer, asyncio.AbstractEventLoop]] = []

    async def serve() -> None:
        server = VesselServer(autopilot, [Endpoint("udpin", "127.0.0.1", 0)], signing=signing)
        await server.start()
        opened.append((server, asyncio.get_running_loop()))
        ready.set()
        try:
            await server.run()
        finally:
            server.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(30.0)
    server, loop = opened[0]
    try:
        yield server.endpoints[0].port
    finally:
        loop.call_soon_threadsafe(server.stop)
        thread.join()
