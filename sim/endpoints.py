"""The sockets on which a simulated vessel can be reached: UDP listening, UDP unprompted, TCP listening.

No client can hold up another: sends never wait, and a TCP client that stops reading is dropped once
`MOST_UNSENT_BYTES` lie waiting for it.
"""

import asyncio
import logging
import socket
import struct
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Protocol, cast

LOG = logging.getLogger("sim.vessel")
MOST_UNSENT_BYTES = 1 << 20
MOST_PEERS = 32
_DATAGRAM_BYTES = 1200
_KINDS = {"udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcp", "tcpin": "tcp"}


@dataclass(frozen=True)
class Endpoint:
    """Where to listen or to send: `udpin` and `tcp` listen, `udpout` sends unprompted."""

    kind: str
    host: str
    port: int

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.kind}:{host}:{self.port}"

    @classmethod
    def parse(cls, text: str) -> "Endpoint":
        """Read `udpin:HOST:PORT`, `udpout:HOST:PORT` or `tcp:HOST:PORT` (`udp:` means `udpin:`).

        Raises:
            ValueError: the text is none of these.
        """
        kind, _, address = text.partition(":")
        host, _, port = address.rpartition(":")
        if kind not in _KINDS or not host or not port.isdecimal() or int(port) > 65535:
            raise ValueError(
                f"{text!r} is no endpoint; write udpin:HOST:PORT, udpout:HOST:PORT or tcp:HOST:PORT"
            )
        if _KINDS[kind] == "udpout" and int(port) == 0:
            raise ValueError(f"{text!r}: udpout needs the port of a peer, not 0")
        return cls(_KINDS[kind], host.strip("[]"), int(port))


class Client(Protocol):
    """One client; it is its own key."""

    name: str

    def __hash__(self) -> int:
        """By identity."""
        ...

    def send(self, packets: list[bytes]) -> None:
        """Send packed messages in order, without waiting."""
        ...


@dataclass(frozen=True)
class Callbacks:
    """What the sockets report."""

    joined: Callable[[Client], None]
    received: Callable[[Client, bytes], None]
    left: Callable[[Client], None]


def datagrams(packets: Iterable[bytes]) -> Iterable[bytes]:
    """Join packets to datagrams that fit a common MTU: fewer, larger ones do not overrun a slow reader."""
    chunk = bytearray()
    for packet in packets:
        if chunk and len(chunk) + len(packet) > _DATAGRAM_BYTES:
            yield bytes(chunk)
            chunk.clear()
        chunk += packet
    if chunk:
        yield bytes(chunk)


class UdpPeer:
    """A client behind a UDP socket; `address` is None on a connected one."""

    def __init__(self, transport: Any, address: Any, name: str) -> None:
        self.name = name
        self._transport = transport
        self._address = address
        self._told = False

    def send(self, packets: list[bytes]) -> None:
        """Send packed messages in order, without waiting."""
        if self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > MOST_UNSENT_BYTES:
            if not self._told:
                self._told = True
                LOG.warning("%s: the socket takes no more; datagrams are being lost", self.name)
            return
        for datagram in datagrams(packets):
            self._transport.sendto(datagram, self._address)


class UdpListener(asyncio.DatagramProtocol):
    """`udpin`: answers every peer it has heard; the longest silent one makes room for a new one."""

    def __init__(self, callbacks: Callbacks) -> None:
        self._callbacks = callbacks
        self._peers: dict[Any, UdpPeer] = {}

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Remember the socket."""
        # Not an isinstance check: before Python 3.12 the selector loop's transport is no DatagramTransport.
        transport = cast(asyncio.DatagramTransport, transport)
        self._transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Pass the datagram on, as from the peer that sent it."""
        peer = self._peers.pop(addr, None)
        if peer is None:
            if len(self._peers) >= MOST_PEERS:
                self._callbacks.left(self._peers.pop(next(iter(self._peers))))
            peer = UdpPeer(self._transport, addr, f"udp {addr[0]}:{addr[1]}")
            self._callbacks.joined(peer)
        self._peers[addr] = peer  # last heard, last in line
        self._callbacks.received(peer, data)

    def error_received(self, exc: Exception) -> None:
        """A peer's port is closed; it may be open again later."""
        LOG.debug("udp: %s", exc)


class UdpDialer(asyncio.DatagramProtocol):
    """`udpout`: one peer, sent to unprompted and for ever, whether it listens or not."""

    def __init__(self, callbacks: Callbacks, endpoint: Endpoint) -> None:
        self._callbacks = callbacks
        self._endpoint = endpoint

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The peer is a client from now on."""
        # Not an isinstance check: before Python 3.12 the selector loop's transport is no DatagramTransport.
        transport = cast(asyncio.DatagramTransport, transport)
        self._peer = UdpPeer(transport, None, str(self._endpoint))
        self._callbacks.joined(self._peer)

    def datagram_received(self, data: bytes, addr: Any) -> None:
        """Pass the datagram on."""
        self._callbacks.received(self._peer, data)

    def error_received(self, exc: Exception) -> None:
        """Nobody listens there yet."""
        LOG.debug("%s: %s", self._endpoint, exc)


class TcpClient(asyncio.Protocol):
    """One accepted TCP connection."""

    def __init__(self, callbacks: Callbacks) -> None:
        self.name = "tcp"
        self._callbacks = callbacks

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        host, port = transport.get_extra_info("peername")[:2]
        self.name = f"tcp {host}:{port}"
        # Keep the kernel's share of what is unsent small beside ours.
        self._socket = transport.get_extra_info("socket")
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, MOST_UNSENT_BYTES // 4)
        self._callbacks.joined(self)

    def data_received(self, data: bytes) -> None:
        """Pass the bytes on."""
        self._callbacks.received(self, data)

    def connection_lost(self, exc: Exception | None) -> None:
        """The client is gone."""
        self._callbacks.left(self)

    def send(self, packets: list[bytes]) -> None:
        """Send packed messages in order, without waiting; a client that does not read is dropped."""
        if self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() > MOST_UNSENT_BYTES:
            LOG.warning("%s: has stopped reading, dropped", self.name)
            # Reset, or the kernel would go on offering what nobody reads.
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self._transport.abort()
            return
        self._transport.write(b"".join(packets))

    def close(self) -> None:
        """End the connection."""
        self._transport.close()


@dataclass
class OpenEndpoint:
    """An endpoint with its real port, and how to close it."""

    endpoint: Endpoint
    close: Callable[[], None]


async def open_endpoint(endpoint: Endpoint, callbacks: Callbacks) -> OpenEndpoint:
    """Open the socket of an endpoint.

    Raises:
        OSError: the address is taken, not ours, or cannot be resolved.
    """
    loop = asyncio.get_running_loop()
    address = (endpoint.host, endpoint.port)
    if endpoint.kind == "tcp":
        server = await loop.create_server(lambda: TcpClient(callbacks), *address)
        return OpenEndpoint(replace(endpoint, port=server.sockets[0].getsockname()[1]), server.close)
    if endpoint.kind == "udpin":
        transport, _ = await loop.create_datagram_endpoint(lambda: UdpListener(callbacks), local_addr=address)
        port = transport.get_extra_info("sockname")[1]
        return OpenEndpoint(replace(endpoint, port=port), transport.close)
    dialer, _ = await loop.create_datagram_endpoint(
        lambda: UdpDialer(callbacks, endpoint), remote_addr=address
    )
    return OpenEndpoint(endpoint, dialer.close)
