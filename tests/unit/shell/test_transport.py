"""Transports on loopback sockets and a pseudo-terminal."""

import asyncio
import os
import pty
import socket
from collections.abc import Awaitable, Callable, Hashable
from contextlib import suppress

import pytest

from autonomy.shell.transport import Backoff, Transport
from autonomy.shell.transports import open_transport

QUICK = Backoff(first_s=0.01, longest_s=0.05)


class Recorder:
    """Callbacks that write down what happened, and let a test wait for it."""

    def __init__(self) -> None:
        self.received: list[tuple[bytes, Hashable]] = []
        self.ups = 0
        self.downs: list[str] = []
        self._changed = asyncio.Event()

    def on_bytes(self, data: bytes, peer: Hashable) -> None:
        self.received.append((data, peer))
        self._changed.set()

    def on_up(self) -> None:
        self.ups += 1
        self._changed.set()

    def on_down(self, reason: str) -> None:
        self.downs.append(reason)
        self._changed.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(10):
            while not condition():
                self._changed.clear()
                await self._changed.wait()

    def open(self, endpoint: str) -> Transport:
        return open_transport(endpoint, self.on_bytes, self.on_up, self.on_down, QUICK)


def run(test: Callable[[Recorder], Awaitable[None]]) -> None:
    async def body() -> None:
        await test(Recorder())

    asyncio.run(body(), debug=True)


def udp_socket() -> socket.socket:
    peer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    peer.bind(("127.0.0.1", 0))
    peer.settimeout(5)
    return peer


def free_port(kind: int = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.mark.parametrize("endpoint", ["udp:1.2.3.4:1", "tcp:host", "serial:/dev/ttyS0", "", "tcp:h:70000"])
def test_an_endpoint_that_is_none_is_refused(endpoint: str) -> None:
    async def test(recorder: Recorder) -> None:
        with pytest.raises(ValueError, match="endpoint"):
            recorder.open(endpoint)

    run(test)


def test_udpin_answers_every_live_peer() -> None:
    async def test(recorder: Recorder) -> None:
        port = free_port()
        link = recorder.open(f"udpin:127.0.0.1:{port}")
        await recorder.until(lambda: recorder.ups == 1)
        link.send(b"nobody is there")
        assert link.dropped_bytes == len(b"nobody is there")
        with udp_socket() as boat, udp_socket() as station:
            boat.sendto(b"boat", ("127.0.0.1", port))
            station.sendto(b"station", ("127.0.0.1", port))
            await recorder.until(lambda: len(recorder.received) == 2)
            assert dict(recorder.received) == {b"boat": boat.getsockname(), b"station": station.getsockname()}
            link.send(b"hello")
            assert boat.recv(100) == b"hello"
            assert station.recv(100) == b"hello"
        await link.close()
        assert not link.is_up

    run(test)


@pytest.mark.parametrize("vouched", [True, False])
def test_strangers_do_not_crowd_out_a_peer_that_is_vouched_for(vouched: bool) -> None:
    async def test(recorder: Recorder) -> None:
        port = free_port()
        link = recorder.open(f"udpin:127.0.0.1:{port}")
        await recorder.until(lambda: recorder.ups == 1)
        with udp_socket() as boat:
            boat.settimeout(0.5)
            boat.sendto(b"boat", ("127.0.0.1", port))
            await recorder.until(lambda: len(recorder.received) == 1)
            if vouched:
                link.vouch(boat.getsockname())
            for number in range(40):
                with udp_socket() as stranger:
                    stranger.sendto(b"?", ("127.0.0.1", port))
                    await recorder.until(lambda seen=number + 2: len(recorder.received) == seen)
            link.send(b"hello")
            await asyncio.sleep(0.05)
            if vouched:
                assert boat.recv(100) == b"hello"
            else:
                with pytest.raises(TimeoutError):
                    boat.recv(100)
        await link.close()

    run(test)


def test_a_boat_that_comes_from_ever_new_ports_is_answered() -> None:
    """Each start of a router between the two gives it another, and its last ones are vouched for too."""

    async def test(recorder: Recorder) -> None:
        port = free_port()
        link = recorder.open(f"udpin:127.0.0.1:{port}")
        await recorder.until(lambda: recorder.ups == 1)
        for number in range(40):
            with udp_socket() as boat:
                boat.sendto(b"boat", ("127.0.0.1", port))
                await recorder.until(lambda seen=number + 1: len(recorder.received) == seen)
                link.vouch(boat.getsockname())
                link.send(b"hello")
                assert boat.recv(100) == b"hello"
        await link.close()

    run(test)


def test_udpin_waits_for_an_address_in_use() -> None:
    async def test(recorder: Recorder) -> None:
        with udp_socket() as rival:
            link = recorder.open(f"udpin:127.0.0.1:{rival.getsockname()[1]}")
            await recorder.until(lambda: len(recorder.downs) == 1)
        assert "use" in recorder.downs[0]
        await recorder.until(lambda: recorder.ups == 1)
        assert len(recorder.downs) == 1, "a reason that stays the same is told once"
        await link.close()

    run(test)


def test_udpout_speaks_first_and_survives_refusals() -> None:
    async def test(recorder: Recorder) -> None:
        port = free_port()
        link = recorder.open(f"udpout:127.0.0.1:{port}")
        await recorder.until(lambda: recorder.ups == 1)
        for _ in range(3):
            link.send(b"anybody?")
            await asyncio.sleep(0.01)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as boat:
            boat.bind(("127.0.0.1", port))
            boat.settimeout(5)
            link.send(b"hello")
            data, peer = boat.recvfrom(100)
            while data != b"hello":
                data, peer = boat.recvfrom(100)
            boat.sendto(b"yes", peer)
            await recorder.until(lambda: bool(recorder.received))
        assert recorder.received[0][0] == b"yes"
        assert not recorder.downs
        await link.close()

    run(test)


def test_tcp_comes_back_for_ever() -> None:
    async def test(recorder: Recorder) -> None:
        port = free_port(socket.SOCK_STREAM)
        link = recorder.open(f"tcp:127.0.0.1:{port}")
        await recorder.until(lambda: len(recorder.downs) == 1)

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(await reader.read(100))
            await writer.drain()
            writer.close()

        server = await asyncio.start_server(serve, "127.0.0.1", port)
        for round_number in (1, 2, 3):
            await recorder.until(lambda expected=round_number: recorder.ups == expected)
            link.send(b"%d" % round_number)
            await recorder.until(lambda expected=round_number: len(recorder.downs) == expected + 1)
        assert [data for data, _ in recorder.received] == [b"1", b"2", b"3"]
        assert len({peer for _, peer in recorder.received}) == 3, "every connection is a peer of its own"
        await link.close()
        server.close()
        await server.wait_closed()

    run(test)


def test_tcp_drops_a_peer_that_stops_reading() -> None:
    async def test(recorder: Recorder) -> None:
        with socket.socket() as server:
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            server.bind(("127.0.0.1", 0))
            server.listen()
            link = recorder.open(f"tcp:127.0.0.1:{server.getsockname()[1]}")
            await recorder.until(lambda: recorder.ups == 1)
            for _ in range(100_000):
                link.send(bytes(1000))
                if not link.is_up:
                    break
            await recorder.until(lambda: bool(recorder.downs))
            assert "stopped reading" in recorder.downs[0]
            assert link.dropped_bytes > 0
            await link.close()

    run(test)


def test_closing_while_connecting_leaves_nothing_behind() -> None:
    async def test(recorder: Recorder) -> None:
        link = recorder.open("tcp:127.0.0.1:1")
        await link.close()
        later = recorder.open("tcp:127.0.0.1:1")
        await asyncio.sleep(0)
        await later.close()
        assert not recorder.ups

    run(test)


def test_serial_over_a_pseudo_terminal() -> None:
    async def test(recorder: Recorder) -> None:
        ours, theirs = pty.openpty()
        link = recorder.open(f"serial:{os.ttyname(theirs)}:57600")
        await recorder.until(lambda: recorder.ups == 1)
        os.write(ours, b"\xfdboat\x00\x11\x13")
        await recorder.until(lambda: sum(len(data) for data, _ in recorder.received) == 8)
        assert b"".join(data for data, _ in recorder.received) == b"\xfdboat\x00\x11\x13"
        link.send(b"\xfdhello\x0a")
        assert os.read(ours, 100) == b"\xfdhello\x0a"
        os.close(ours)
        await recorder.until(lambda: bool(recorder.downs))
        os.close(theirs)
        await link.close()

    run(test)


def test_serial_that_takes_no_bytes_loses_whole_messages_and_goes_on() -> None:
    async def test(recorder: Recorder) -> None:
        ours, theirs = pty.openpty()
        os.set_blocking(ours, False)
        link = recorder.open(f"serial:{os.ttyname(theirs)}:57600")
        await recorder.until(lambda: recorder.ups == 1)
        sent = 1000
        for number in range(sent):
            link.send(number.to_bytes(2, "big") + bytes(498))
        assert link.is_up
        assert link.dropped_bytes > 0
        assert link.dropped_bytes % 500 == 0
        received = bytearray()
        async with asyncio.timeout(10):
            while len(received) < sent * 500 - link.dropped_bytes:
                with suppress(BlockingIOError):
                    received += os.read(ours, 65536)
                await asyncio.sleep(0)
        numbers = [int.from_bytes(received[i : i + 2], "big") for i in range(0, len(received), 500)]
        assert numbers == list(range(len(numbers)))
        await link.close()
        os.close(ours)
        os.close(theirs)

    run(test)


def test_a_missing_serial_port_is_waited_for() -> None:
    async def test(recorder: Recorder) -> None:
        link = recorder.open("serial:/dev/there-is-no-such-port:57600")
        await recorder.until(lambda: bool(recorder.downs))
        assert "no-such-port" in recorder.downs[0]
        await link.close()

    run(test)
