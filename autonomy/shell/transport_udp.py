"""UDP: `udpin:HOST:PORT` listens and answers whoever speaks, `udpout:HOST:PORT` speaks first."""

import asyncio
from collections.abc import Hashable
from typing import Any

from autonomy.shell.transport import Transport, describe

_LIVE_PEER_S = 30.0
_MAXIMUM_PEERS = 16


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
        self._owner._fail(self._down, describe(exc) if exc else "closed")
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


class UdpListener(_Udp):
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


class UdpSpeaker(_Udp):
    """`udpout`: speaks to one address, and hears only that one."""

    async def _connect(self, down: "asyncio.Future[str]") -> None:
        await self._open_socket(down, remote_addr=self._address)

    def _write(self, data: bytes) -> bool:
        return self._send_to(data, None)
