"""TCP: `tcp:HOST:PORT` connects."""

import asyncio
import socket
from collections.abc import Hashable

from autonomy.shell.transport import WRITE_LIMIT_BYTES, Transport, describe

_CONNECT_TIMEOUT_S = 10.0
_DEAD_PEER_MS = 15_000


class _Stream(asyncio.Protocol):
    def __init__(self, owner: "TcpClient", down: "asyncio.Future[str]", peer: Hashable) -> None:
        self._owner = owner
        self._down = down
        self._peer = peer
        self.closed = asyncio.get_running_loop().create_future()

    def data_received(self, data: bytes) -> None:
        if not self._down.done():
            self._owner._on_bytes(data, self._peer)

    def connection_lost(self, exc: Exception | None) -> None:
        self._owner._fail(self._down, describe(exc) if exc else "closed by the peer")
        self.closed.set_result(None)


class TcpClient(Transport):
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
        if self._stream.get_write_buffer_size() + len(data) > WRITE_LIMIT_BYTES:
            self._fail(self._current, "the peer has stopped reading")
            return False
        self._stream.write(data)
        return True
