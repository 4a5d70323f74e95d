"""News for pages: order, bounds, and what becomes of a page that does not read."""

import asyncio
import json
import sys
import threading
from pathlib import Path

import pytest
from aiohttp import WSMsgType, WSServerHandshakeError, web
from aiohttp.test_utils import TestClient, TestServer

from autonomy.shore.server import live
from autonomy.shore.server.fleet import Fleet, Message
from autonomy.shore.server.live import Client, Live
from autonomy.shore.subscriber import Presence, Update
from autonomy.wire import LogBatch, LogNotice, ObservationBatch

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import health_notice, observation, plan_notice


@pytest.fixture(autouse=True)
def _quick(monkeypatch):
    monkeypatch.setattr(live, "_FLEET_PERIOD_S", 0.05)


def test_of_most_kinds_the_newest_wins():
    client = Client(None)
    for number in range(1000):
        client.put("model", "boat1", f"model {number}")
        client.put("health", "boat1", f"health {number}")
    client.put("model", "boat2", "another's")
    assert client.take() == ["model 999", "health 999", "another's"]
    assert client.take() == []


def test_what_has_an_order_keeps_it_until_there_is_too_much():
    client = Client(None)
    for number in range(500):
        client.put("observations", "boat1", str(number))
    assert client.lost == 0
    client.put("log", "boat1", "one too many")
    client.put("observations", "boat1", "and another")
    assert client.lost == 502
    assert client.take() == []


def test_long_messages_are_too_much_sooner():
    client = Client(None)
    for _ in range(5):
        client.put("observations", "boat1", "x" * 1_000_000)
    assert client.lost == 5
    client = Client(None)
    for _ in range(100):
        client.put("observations", "boat1", "x" * 1_000_000)
        assert len(client.take()) == 1


def test_a_client_hears_of_whom_it_asked_for():
    assert Client(None).wants("boat1")
    assert Client(frozenset({"boat1"})).wants("boat1")
    assert not Client(frozenset({"boat1"})).wants("boat2")


def connected(scenario):
    """Run `scenario(client, fleet, news)` with a server of nothing but live news."""

    async def run():
        fleet = Fleet()
        news = Live(fleet)

        async def serve(request):
            names = request.query.get("vehicles")
            return await news.serve(request, frozenset(names.split(",")) if names else None)

        app = web.Application()
        app.router.add_get("/live", serve)
        async with TestClient(TestServer(app)) as client:
            telling = asyncio.create_task(news.tell_of_the_fleet())
            await scenario(client, fleet, news)
            telling.cancel()

    asyncio.run(asyncio.wait_for(run(), 60))


async def joined(client, fleet, path="/live"):
    """A page's socket that the server knows of: the fleet's list has come."""
    socket = await client.ws_connect(path)
    fleet.take(Update("sentinel", Presence(True)), None, 0.0)
    while json.loads((await socket.receive()).data)["type"] != "vehicles":
        pass
    return socket


async def handshake(client):
    """A connection that has asked for live news and been told that they follow, of which nothing more is read."""
    stream, writer = await asyncio.open_connection(client.host, client.port, limit=1024)
    lines = ("GET /live HTTP/1.1", "Host: x", "Upgrade: websocket", "Connection: Upgrade")
    lines += ("Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "", "")
    writer.write("\r\n".join(lines).encode())
    await stream.readuntil(b"\r\n\r\n")
    return stream, writer


def readings(number):
    """The number-th reading of a run, by itself."""
    return ObservationBatch(1, number, 0, number + 1, (observation(number),))


def test_news_come_from_another_thread_in_their_order():
    def sail(fleet):
        for number in range(200):
            fleet.take(Update("boat1", readings(number)), None, 5.0)
            fleet.take(Update("boat2", readings(number)), None, 5.0)
        fleet.take(Update("boat1", plan_notice(7)), None, 6.0)
        fleet.take(Update("boat1", LogBatch(1, 0, 0, 1, (LogNotice("info", "done"),))), None, 7.0)

    async def scenario(client, fleet, news):
        socket = await joined(client, fleet, "/live?vehicles=boat1,sentinel")
        thread = threading.Thread(target=sail, args=(fleet,))
        thread.start()
        heard = []
        while not heard or heard[-1]["type"] != "log":
            heard.append(json.loads((await socket.receive()).data))
        await asyncio.to_thread(thread.join)
        assert {each["vehicle"] for each in heard if each["type"] != "vehicles"} == {"boat1"}
        rows = [row for each in heard if each["type"] == "observations" for row in each["data"]]
        assert [row[0] for row in rows] == list(range(200))
        assert [each["data"]["sequence"] for each in heard if each["type"] == "plan"] == [7]
        assert heard[-1]["data"] == {"utc_s": 7.0, "level": "info", "text": "done"}

    connected(scenario)


def test_the_list_of_the_fleet_comes_when_it_changes():
    async def scenario(client, fleet, news):
        socket = await joined(client, fleet)
        fleet.take(Update("boat1", health_notice("sailing")), None, 5.0)
        while True:
            message = json.loads((await socket.receive()).data)
            if message["type"] == "vehicles" and len(message["data"]) == 2:
                break
        assert [each["vehicle"] for each in message["data"]] == ["boat1", "sentinel"]
        assert message["data"][0]["reason"] == "sailing"

    connected(scenario)


def test_a_page_that_is_too_slow_is_told_what_it_lost_and_hung_up_on():
    async def scenario(client, fleet, news):
        socket = await joined(client, fleet)
        # All at once: the event loop, on which this runs, has no turn in between to send any of it.
        for number in range(1000):
            fleet.take(Update("boat1", readings(number)), None, 5.0)
        heard = []
        async for message in socket:
            heard.append(json.loads(message.data))
        assert heard[-1] == {"type": "lost", "data": {"messages": 1000}}
        assert socket.close_code == 1013

    connected(scenario)


def test_a_page_that_never_reads_is_dropped_and_the_others_are_not(monkeypatch):
    monkeypatch.setattr(live, "_PATIENCE_S", 0.5)

    async def scenario(client, fleet, news):
        reader = await joined(client, fleet)
        _stream, deaf = await handshake(client)
        heard = asyncio.Event()

        async def read():
            async for message in reader:
                if json.loads(message.data).get("data", {}) == "end":
                    heard.set()

        reading = asyncio.create_task(read())
        assert len(news) == 2
        while len(news) == 2:
            news.offer(Message("health", "boat1", {"reason": "x" * 300_000}))
            await asyncio.sleep(0.01)
        news.offer(Message("health", "boat1", "end"))
        await heard.wait()
        assert len(news) == 1
        reading.cancel()
        deaf.close()

    connected(scenario)


def test_there_are_only_so_many_pages(monkeypatch):
    monkeypatch.setattr(live, "MAXIMUM_CLIENTS", 2)

    async def scenario(client, fleet, news):
        first, _second = await joined(client, fleet), await joined(client, fleet)
        with pytest.raises(WSServerHandshakeError, match="503"):
            await client.ws_connect("/live")
        await first.close()
        # The place of one that has gone is free again.
        third = await joined(client, fleet)
        assert not third.closed

    connected(scenario)


def test_what_a_page_says_is_not_listened_to():
    async def scenario(client, fleet, news):
        socket = await joined(client, fleet)
        await socket.send_str("anything")
        fleet.take(Update("boat1", plan_notice()), None, 5.0)
        while json.loads((await socket.receive()).data)["type"] != "plan":
            pass
        await socket.send_bytes(bytes(5000))
        while (message := await socket.receive()).type is WSMsgType.TEXT:
            pass
        assert message.type in (WSMsgType.CLOSE, WSMsgType.CLOSED)
        assert socket.close_code == 1009  # too large

    connected(scenario)
