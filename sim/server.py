"""The simulated vessel on real sockets, its clock running `speedup` times as fast as the wall's."""

import asyncio
import logging
from collections.abc import Sequence

from autonomy.mavlink.signing import Signing
from sim.autopilot import Autopilot
from sim.endpoints import Callbacks, Client, Endpoint, OpenEndpoint, TcpClient, open_endpoint
from sim.router import Packets, Router

LOG = logging.getLogger("sim.vessel")
_TICK_S = 0.02
_BUSY_S = 0.1
_MOST_BEHIND_S = 0.5


class CannotListenError(OSError):
    """An endpoint cannot be opened; the message names it and says why."""


class VesselServer:
    """Serves one autopilot to any number of clients until told to stop.

    Simulated time advances by whole steps of `step_s`. A machine that cannot keep up makes the simulation
    slower than asked, which is logged once: steps are never skipped and never grow.
    """

    def __init__(
        self,
        autopilot: Autopilot,
        endpoints: Sequence[Endpoint],
        speedup: float = 1.0,
        sitl_timers: bool = False,
        signing: Signing | None = None,
    ) -> None:
        if not speedup > 0.0:
            raise ValueError(f"the speed-up must be positive, got {speedup}")
        self.autopilot = autopilot
        self.speedup = speedup
        self.step_s = min(1.0, _TICK_S * speedup)
        self._endpoints = endpoints
        self._sitl_timers = sitl_timers
        self._router = Router(autopilot, signing)
        self._open: list[OpenEndpoint] = []
        self._clients: dict[Client, None] = {}
        self._behind_told = False
        self._stop = asyncio.Event()

    @property
    def endpoints(self) -> list[Endpoint]:
        """The endpoints that are open, with their real ports."""
        return [each.endpoint for each in self._open]

    async def start(self) -> None:
        """Open every endpoint.

        Raises:
            CannotListenError: one of them cannot be opened; the others are closed again.
        """
        callbacks = Callbacks(self._joined, self._received, self._left)
        for endpoint in self._endpoints:
            try:
                self._open.append(await open_endpoint(endpoint, callbacks))
            except OSError as error:
                self.close()
                raise CannotListenError(f"{endpoint}: {error.strerror or error}") from error

    def stop(self) -> None:
        """Make `run` return."""
        self._stop.set()

    def close(self) -> None:
        """Close every socket."""
        for each in self._open:
            each.close()
        self._open.clear()
        for client in list(self._clients):
            if isinstance(client, TcpClient):
                client.close()

    async def run(self) -> None:
        """Sail until `stop` is called."""
        loop = asyncio.get_running_loop()
        before, owed_s = loop.time(), 0.0
        while not self._stop.is_set():
            now = loop.time()
            owed_s += (now - before) * self.speedup
            before = now
            owed_s = self._bounded(self._catch_up(owed_s, now + _BUSY_S))
            try:
                async with asyncio.timeout(max(0.0, now + _TICK_S - loop.time())):
                    await self._stop.wait()
            except TimeoutError:
                continue

    def _catch_up(self, owed_s: float, until: float) -> float:
        """Advance by the steps that are owed, but not past `until` on the wall; what is still owed."""
        loop = asyncio.get_running_loop()
        packets: Packets = []
        while owed_s >= self.step_s and loop.time() < until:
            packets += self._router.advance(self._now(), self.step_s)
            owed_s -= self.step_s
        self._send(packets)
        return owed_s

    def _bounded(self, owed_s: float) -> float:
        most_s = max(self.step_s, _MOST_BEHIND_S * self.speedup)
        if owed_s <= most_s:
            return owed_s
        if not self._behind_told:
            self._behind_told = True
            LOG.warning("this machine cannot keep up with a speed-up of %g; sailing slower", self.speedup)
        return most_s

    def _now(self) -> float:
        return self.autopilot.time_s if self._sitl_timers else asyncio.get_running_loop().time()

    def _joined(self, client: Client) -> None:
        LOG.info("%s: client joined", client.name)
        self._clients[client] = None
        self._router.join(self._now(), client)

    def _left(self, client: Client) -> None:
        LOG.info("%s: client left", client.name)
        self._clients.pop(client, None)
        self._router.leave(client)

    def _received(self, client: Client, data: bytes) -> None:
        self._send(self._router.receive(self._now(), client, data))

    def _send(self, packets: Packets) -> None:
        by_client: dict[Client, list[bytes]] = {}
        for client, packet in packets:
            by_client.setdefault(client, []).append(packet)
        for client, theirs in by_client.items():
            client.send(theirs)
