"""The link to the vehicle: bytes in, bytes out, reopened for ever, never waiting.

Endpoints are `udpin:HOST:PORT` (listen, answer whoever speaks), `udpout:HOST:PORT` (speak first),
`tcp:HOST:PORT` (connect) and `serial:/dev/…:BAUD`.
"""

import asyncio
import os
import socket
import termios
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import serial

from autonomy.endpoints import parse_link

Address = tuple[str, int]
OnBytes = Callable[[bytes, Hashable], None]
OnUp = Callable[[], None]
OnDown = Callable[[str], None]

_WRITE_LIMIT_BYTES = 65_536
_READ_BYTES = 65_536
_CONNECT_TIMEOUT_S = 10.0
_DEAD_PEER_MS = 15_000
_LIVE_PEER_S = 30.0
_MAXIMUM_PEERS = 16


@dataclass(frozen=True)
class Backoff:
    """Pauses between attempts to open the link, in seconds: from `first_s`, doubling, to `longest_s`."""

    first_s: float = 0.5
    longest_s: float = 10.0

    def pause(self, failures: int) -> float:
        """The pause after so many failures in a row (1, 2, …)."""
        return float(min(self.longest_s, self.first_s * 2.0 ** min(failures - 1, 30)))


class Transport(ABC):
    """One link. Subclasses say how to open it once; this class keeps it open.

    `on_bytes(data, peer)` gets what arrives; `peer` is new for every connection, so that a parser can start
    afresh. `on_up()` and `on_down(reason)` alternate; a link that can't be opened at all reports `on_down`
    once, and again when the reason changes. `send` never waits: what can't be sent is dropped and counted.
    """

    is_stream = True
    """Whether what arrives is cut anywhere; else it is datagrams, which anybody may send."""

    def __init__(
        self,
        endpoint: str,
        address: Address,
        on_bytes: OnBytes,
        on_up: OnUp,
        on_down: OnDown,
        backoff: Backoff,
    ) -> None:
        self.endpoint = endpoint
        self._address = address
        self.dropped_bytes = 0
        self._on_bytes = on_bytes
        self._on_up = on_up
        self._on_down = on_down
        self._backoff = backoff
        self._down: asyncio.Future[str] | None = None
        self._connections = 0
        self._keeper: asyncio.Task[None] | None = None

    @staticmethod
    def open(
        endpoint: str, on_bytes: OnBytes, on_up: OnUp, on_down: OnDown, backoff: Backoff | None = None
    ) -> "Transport":
        """Keep the link of `endpoint` open from now on, in the running event loop; returns at once.

        Raises ValueError for an endpoint that can't be understood; an address that can't be had is reported
        to `on_down` and tried again.
        """
        parsed = parse_link(endpoint)
        where = (parsed.host, parsed.number)
        transport = _KINDS[parsed.kind](endpoint, where, on_bytes, on_up, on_down, backoff or Backoff())
        transport._keeper = asyncio.get_running_loop().create_task(transport._keep_open())
        return transport

    @property
    def keeper(self) -> "asyncio.Task[None]":
        """The task that keeps the link open; it ends only by `close`, or by a bug."""
        assert self._keeper is not None
        return self._keeper

    @property
    def is_up(self) -> bool:
        """Whether the link is open now."""
        return self._down is not None and not self._down.done()

    def send(self, data: bytes) -> None:
        """Send `data` if the link is open and takes it without waiting; drop it otherwise."""
        if not self.is_up or not self._write(data):
            self.dropped_bytes += len(data)

    def vouch(self, peer: Hashable) -> None:  # noqa: B027 -- only where anybody may speak are places few
        """This peer is known to be one of ours: strangers do not take its place where places are few."""

    async def close(self) -> None:
        """Close the link for good; no callback comes afterwards."""
        if self._keeper is not None:
            self._keeper.cancel()
            await asyncio.gather(self._keeper, return_exceptions=True)

    async def _keep_open(self) -> None:
        failures = 0
        told = ""
        while True:
            opened, reason = await self._one_connection()
            failures = 1 if opened else failures + 1
            if opened or reason != told:
                self._on_down(reason)
            told = reason
            await asyncio.sleep(self._backoff.pause(failures))

    async def _one_connection(self) -> tuple[bool, str]:
        """Open the link and wait until it fails: whether it was open, and why it isn't any more."""
        self._connections += 1
        self._down = None
        down = asyncio.get_running_loop().create_future()
        try:
            await self._connect(down)
            self._down = down
            if not down.done():
                self._on_up()
                return True, await down
            return False, down.result()
        except (OSError, TimeoutError, UnicodeError) as error:
            return False, f"{self.endpoint}: {_describe(error)}"
        finally:
            self._down = None
            if not down.done():
                down.cancel()
            await self._disconnect()

    def _fail(self, down: "asyncio.Future[str]", reason: str) -> None:
        if not down.done():
            down.set_result(f"{self.endpoint}: {reason}")

    @abstractmethod
    async def _connect(self, down: "asyncio.Future[str]") -> None:
        """Open the link once; complete `down` with the reason when it fails later. Raises OSError."""

    @abstractmethod
    async def _disconnect(self) -> None:
        """Release whatever `_connect` took, as far as it came."""

    @abstractmethod
    def _write(self, data: bytes) -> bool:
        """Hand `data` to the system; False if it has to be dropped."""


class _Datagrams(asyncio.DatagramProtocol):
    def __init__(self, owner: "_Udp", down: "asyncio.Future[str]") -> None:
        self._owner = owner
        self._down = down
        self.paused = False
        self.closed = asyncio.get_running_loop().create_future()

    def pause_writing(self) -> None:
        self.paused = True

    def resume_writing(self) -> None:
        self.paused = False

    def datagram_received(self, data: bytes, addr: Any) -> None:
        if not self._down.done():
            self._owner._received(data, addr)

    def error_received(self, exc: Exception) -> None:
        # "Connection refused" only says that nobody listens there yet: the next datagram will tell.
        self._owner.refused += 1

    def connection_lost(self, exc: Exception | None) -> None:
        self._owner._fail(self._down, _describe(exc) if exc else "closed")
        self.closed.set_result(None)


class _Udp(Transport):
    """What listening and speaking sockets share."""

    is_stream = False
    refused = 0
    _socket: asyncio.DatagramTransport | None = None
    _protocol: _Datagrams | None = None

    def _received(self, data: bytes, peer: Any) -> None:
        self._on_bytes(data, peer)

    async def _open_socket(self, down: "asyncio.Future[str]", **address: Any) -> None:
        loop = asyncio.get_running_loop()
        self._socket, self._protocol = await loop.create_datagram_endpoint(
            lambda: _Datagrams(self, down), **address
        )

    async def _disconnect(self) -> None:
        if self._socket is not None and self._protocol is not None:
            self._socket.abort()
            await self._protocol.closed
        self._socket = self._protocol = None

    def _send_to(self, data: bytes, peer: Any) -> bool:
        if self._socket is None or self._protocol is None or self._protocol.paused:
            return False
        self._socket.sendto(data, peer)
        return True


class _UdpListener(_Udp):
    """`udpin`: answers every peer heard within 30 s, and in silence the one that was heard last."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._peers: dict[Any, float] = {}
        self._vouched: set[Hashable] = set()

    def vouch(self, peer: Hashable) -> None:
        """See `Transport.vouch`: when there are too many peers, one that is not vouched for goes first."""
        if peer in self._peers:
            self._vouched.add(peer)

    async def _connect(self, down: "asyncio.Future[str]") -> None:
        await self._open_socket(down, local_addr=self._address)

    def _received(self, data: bytes, peer: Any) -> None:
        self._peers.pop(peer, None)  # to the end: the dictionary's order is the order of hearing
        self._peers[peer] = asyncio.get_running_loop().time()
        if len(self._peers) > _MAXIMUM_PEERS:
            # Not the newcomer, who may be the boat at another port, and be vouched for in a moment.
            strangers = (each for each in self._peers if each not in self._vouched and each != peer)
            oldest = next(strangers, next(iter(self._peers)))
            del self._peers[oldest]
            self._vouched.discard(oldest)
        super()._received(data, peer)

    def _write(self, data: bytes) -> bool:
        if not self._peers:
            return False
        now = asyncio.get_running_loop().time()
        live = [peer for peer, heard in self._peers.items() if now - heard <= _LIVE_PEER_S]
        sent = [self._send_to(data, peer) for peer in live or [next(reversed(self._peers))]]
        return all(sent)


class _UdpSpeaker(_Udp):
    """`udpout`: speaks to one address, and hears only that one."""

    async def _connect(self, down: "asyncio.Future[str]") -> None:
        await self._open_socket(down, remote_addr=self._address)

    def _write(self, data: bytes) -> bool:
        return self._send_to(data, None)


class _Stream(asyncio.Protocol):
    def __init__(self, owner: "_TcpClient", down: "asyncio.Future[str]", peer: Hashable) -> None:
        self._owner = owner
        self._down = down
        self._peer = peer
        self.closed = asyncio.get_running_loop().create_future()

    def data_received(self, data: bytes) -> None:
        if not self._down.done():
            self._owner._on_bytes(data, self._peer)

    def connection_lost(self, exc: Exception | None) -> None:
        self._owner._fail(self._down, _describe(exc) if exc else "closed by the peer")
        self.closed.set_result(None)


class _TcpClient(Transport):
    """`tcp`: connects; a peer that stops reading is dropped once 64 KiB wait for it."""

    _stream: asyncio.Transport | None = None
    _protocol: _Stream | None = None
    _current: "asyncio.Future[str] | None" = None

    async def _connect(self, down: "asyncio.Future[str]") -> None:
        loop = asyncio.get_running_loop()
        peer = (self.endpoint, self._connections)
        async with asyncio.timeout(_CONNECT_TIMEOUT_S):
            self._stream, self._protocol = await loop.create_connection(
                lambda: _Stream(self, down, peer), *self._address
            )
        self._current = down
        raw = self._stream.get_extra_info("socket")
        # Without this a peer that vanished is missed only after a quarter of an hour.
        raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAD_PEER_MS)

    async def _disconnect(self) -> None:
        if self._stream is not None and self._protocol is not None:
            self._stream.abort()
            await self._protocol.closed
        self._stream = self._protocol = self._current = None

    def _write(self, data: bytes) -> bool:
        if self._stream is None or self._current is None:
            return False
        if self._stream.get_write_buffer_size() + len(data) > _WRITE_LIMIT_BYTES:
            self._fail(self._current, "the peer has stopped reading")
            return False
        self._stream.write(data)
        return True


class _SerialPort(Transport):
    """`serial`: a port that doesn't take more bytes loses whole messages, never parts of one."""

    _port: serial.Serial | None = None
    _current: "asyncio.Future[str] | None" = None

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._waiting = bytearray()

    async def _connect(self, down: "asyncio.Future[str]") -> None:
        device, baud = self._address
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, termios.error, ValueError) as error:
            raise OSError(str(error)) from error
        self._current = down
        peer = (self.endpoint, self._connections)
        asyncio.get_running_loop().add_reader(self._port.fd, self._readable, down, peer)

    async def _disconnect(self) -> None:
        port = self._port
        if port is None:
            return
        loop = asyncio.get_running_loop()
        loop.remove_reader(port.fd)
        loop.remove_writer(port.fd)
        try:
            termios.tcflush(port.fd, termios.TCIOFLUSH)  # closing would wait for unsent bytes
        except termios.error as error:
            self._fail_if_open(f"flushing failed: {error}")  # an unplugged port has nothing to flush
        port.close()
        self._port = self._current = None
        self._waiting.clear()

    def _fail_if_open(self, reason: str) -> None:
        if self._current is not None:
            self._fail(self._current, reason)

    def _readable(self, down: "asyncio.Future[str]", peer: Hashable) -> None:
        assert self._port is not None
        try:
            data = os.read(self._port.fd, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            data = b""
            self._fail(down, _describe(error))
        if data:
            self._on_bytes(data, peer)
            return
        self._fail(down, "the port was hung up")
        asyncio.get_running_loop().remove_reader(self._port.fd)

    def _write(self, data: bytes) -> bool:
        if self._port is None or len(self._waiting) + len(data) > _WRITE_LIMIT_BYTES:
            return False
        self._waiting += data
        self._writable()
        return True

    def _writable(self) -> None:
        assert self._port is not None
        try:
            written = os.write(self._port.fd, self._waiting)
        except BlockingIOError:
            written = 0
        except OSError as error:
            self._fail_if_open(_describe(error))
            self._waiting.clear()
            written = 0
        del self._waiting[:written]
        loop = asyncio.get_running_loop()
        if self._waiting:
            loop.add_writer(self._port.fd, self._writable)
        else:
            loop.remove_writer(self._port.fd)


_KINDS: dict[str, type[Transport]] = {
    "udpin": _UdpListener,
    "udpout": _UdpSpeaker,
    "tcp": _TcpClient,
    "serial": _SerialPort,
}


def _describe(error: BaseException) -> str:
    if isinstance(error, TimeoutError) and not error.args:
        return "timed out"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__
