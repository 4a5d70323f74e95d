"""The bad link: what it does to datagrams, and the proxy that has one at each side."""

import asyncio
import contextlib
from typing import Any

import numpy as np
import pytest

from sim.link import BadLink, UdpProxy

LOOPBACK = ("127.0.0.1", 0)


def link(seed: int = 0, **habits: float) -> BadLink:
    return BadLink(np.random.default_rng(seed), **habits)


def test_a_good_link_delivers_at_once_and_unchanged():
    assert link().transmit(3.0, b"abc") == [(3.0, b"abc")]


def test_rates_are_what_was_asked_for():
    bad = link(loss=0.2, duplication=0.1)
    arrivals = [len(bad.transmit(0.0, b"x")) for _ in range(20_000)]
    assert np.mean(arrivals) == pytest.approx(1.1 * 0.8, abs=0.02)
    assert bad.counts["sent"] == 20_000


def test_reordered_datagrams_are_overtaken_and_none_is_lost():
    bad = link(reordering=0.3, delay_s=0.01, held_s=0.05)
    arrivals = [
        (when, number)
        for number in range(200)
        for when, _ in bad.transmit(0.01 * number, number.to_bytes(2, "big"))
    ]
    order = [number for _, number in sorted(arrivals)]
    assert sorted(order) == list(range(200))
    assert order != sorted(order)


def test_corruption_flips_one_bit():
    ((_, damaged),) = link(corruption=1.0).transmit(0.0, bytes(20))
    assert sum(byte.bit_count() for byte in damaged) == 1


def test_the_same_seed_does_the_same():
    def history(seed: int) -> list[Any]:
        bad = link(seed, loss=0.3, duplication=0.3, reordering=0.3, corruption=0.1, jitter_s=0.1)
        return [bad.transmit(float(k), bytes([k])) for k in range(100)]

    assert history(4) == history(4)
    assert history(4) != history(5)


@pytest.mark.parametrize("habits", [{"loss": 1.1}, {"duplication": -0.1}, {"delay_s": -1.0}])
def test_impossible_habits_are_refused(habits):
    with pytest.raises(ValueError, match=next(iter(habits))):
        link(**habits)


class Socket(asyncio.DatagramProtocol):
    """Keeps what arrives; an echo sends it back."""

    def __init__(self, echo: bool = False) -> None:
        self.echo = echo
        self.heard: asyncio.Queue[tuple[bytes, Any]] = asyncio.Queue()

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self.heard.put_nowait((data, addr))
        if self.echo:
            self.transport.sendto(b"re: " + data, addr)


@contextlib.asynccontextmanager
async def udp(remote: Any = None, echo: bool = False):
    loop = asyncio.get_running_loop()
    _, protocol = await loop.create_datagram_endpoint(
        lambda: Socket(echo), local_addr=None if remote else LOOPBACK, remote_addr=remote
    )
    try:
        yield protocol
    finally:
        protocol.transport.close()


def test_the_proxy_carries_both_ways_and_keeps_clients_apart():
    async def scenario() -> None:
        async with asyncio.timeout(10.0), udp(echo=True) as server:
            address = server.transport.get_extra_info("sockname")
            async with (
                UdpProxy(LOOPBACK, address, up=link(), down=link()) as proxy,
                udp(proxy.address) as first,
                udp(proxy.address) as second,
            ):
                first.transport.sendto(b"one")
                second.transport.sendto(b"two")
                assert (await first.heard.get())[0] == b"re: one"
                assert (await second.heard.get())[0] == b"re: two"
                senders = {(await server.heard.get())[1] for _ in range(2)}
                assert len(senders) == 2

    asyncio.run(scenario())


def test_the_proxy_loses_in_the_direction_that_is_bad():
    async def scenario() -> None:
        async with asyncio.timeout(10.0), udp(echo=True) as server:
            address = server.transport.get_extra_info("sockname")
            up, down = link(), link(loss=1.0)
            async with UdpProxy(LOOPBACK, address, up, down) as proxy, udp(proxy.address) as client:
                for _ in range(5):
                    client.transport.sendto(b"hello")
                for _ in range(5):
                    await server.heard.get()
                while down.counts["loss"] < 5:
                    await asyncio.sleep(0.01)
                assert client.heard.empty()
                assert up.counts["loss"] == 0

    asyncio.run(scenario())
