"""A seeded bad link: datagrams get lost, doubled, damaged, late and out of order, the same way every time."""

import asyncio
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

import numpy as np


@dataclass
class BadLink:
    """What one direction of a link does to datagrams.

    Probabilities are per datagram. A reordered datagram is held back `held_s` longer than the others, so that
    later ones overtake it; a corrupted one has a single bit flipped.
    """

    rng: np.random.Generator
    loss: float = 0.0
    duplication: float = 0.0
    reordering: float = 0.0
    corruption: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    held_s: float = 0.05
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        for name in ("loss", "duplication", "reordering", "corruption"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} must be a probability, got {getattr(self, name)}")
        for name in ("delay_s", "jitter_s", "held_s"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")

    def transmit(self, now: float, datagram: bytes) -> list[tuple[float, bytes]]:
        """The copies that will arrive, each with its time of arrival; none if the datagram is lost."""
        self.counts["sent"] += 1
        copies = 2 if self._happens("duplication") else 1
        return [arrival for _ in range(copies) for arrival in self._one(now, datagram)]

    def _one(self, now: float, datagram: bytes) -> Iterator[tuple[float, bytes]]:
        if self._happens("loss"):
            return
        late_s = self.delay_s + self.jitter_s * float(self.rng.random())
        if self._happens("reordering"):
            late_s += self.held_s
        if datagram and self._happens("corruption"):
            damaged = bytearray(datagram)
            damaged[int(self.rng.integers(len(damaged)))] ^= 1 << int(self.rng.integers(8))
            datagram = bytes(damaged)
        yield now + late_s, datagram

    def _happens(self, what: str) -> bool:
        happens = bool(self.rng.random() < getattr(self, what))
        self.counts[what] += happens
        return happens


class _Relay(asyncio.DatagramProtocol):
    """One socket of the proxy; `forward(data, address)` takes what it hears."""

    def __init__(self, forward: Any) -> None:
        self._forward = forward

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._forward(data, addr)

    def error_received(self, exc: Exception) -> None:
        """The far end is not there at the moment; a link does not mind."""


class UdpProxy:
    """A UDP link with a bad temper between clients and one server.

    Clients talk to `address`; `up` is what happens on the way to `forward_to`, `down` on the way back. Every
    client gets a socket of its own towards the server, so the server can tell them apart.

        async with UdpProxy(("127.0.0.1", 0), ("127.0.0.1", 5760), up=BadLink(rng, loss=0.2), ...) as proxy:
    """

    def __init__(
        self, listen: tuple[str, int], forward_to: tuple[str, int], up: BadLink, down: BadLink
    ) -> None:
        self._listen = listen
        self._forward_to = forward_to
        self._up = up
        self._down = down
        self._upstream: dict[Any, asyncio.Future[asyncio.DatagramTransport]] = {}

    @property
    def address(self) -> tuple[str, int]:
        """Host and port on which clients reach the proxy."""
        host, port = self._socket.get_extra_info("sockname")[:2]
        return host, port

    async def __aenter__(self) -> "UdpProxy":
        """Open the proxy.

        Raises:
            OSError: the address to listen on cannot be had.
        """
        self._loop = asyncio.get_running_loop()
        self._socket, _ = await self._loop.create_datagram_endpoint(
            lambda: _Relay(self._from_client), local_addr=self._listen
        )
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close every socket; what is still under way is lost."""
        self._socket.close()
        for opening in self._upstream.values():
            (await opening).close()

    def _from_client(self, data: bytes, client: Any) -> None:
        if client not in self._upstream:
            self._upstream[client] = asyncio.ensure_future(self._connect(client))
        opening = self._upstream[client]
        for when, copy in self._up.transmit(self._loop.time(), data):
            self._loop.call_at(when, self._send_up, opening, copy)

    async def _connect(self, client: Any) -> asyncio.DatagramTransport:
        transport, _ = await self._loop.create_datagram_endpoint(
            lambda: _Relay(lambda data, _: self._from_server(data, client)), remote_addr=self._forward_to
        )
        return transport

    def _send_up(self, opening: asyncio.Future[asyncio.DatagramTransport], data: bytes) -> None:
        if opening.done():
            transport = opening.result()
            if not transport.is_closing():
                transport.sendto(data)
        else:
            opening.add_done_callback(lambda opened: self._send_up(opened, data))

    def _from_server(self, data: bytes, client: Any) -> None:
        for when, copy in self._down.transmit(self._loop.time(), data):
            self._loop.call_at(when, self._send_down, copy, client)

    def _send_down(self, data: bytes, client: Any) -> None:
        if not self._socket.is_closing():
            self._socket.sendto(data, client)
