"""News for the pages as they come: a bounded queue for each, so that a slow page costs only itself."""

import asyncio
import threading
from collections import deque

from aiohttp import WSCloseCode, web

from autonomy.effects import Topic
from autonomy.shore.server.fleet import Fleet, Message
from autonomy.shore.server.plain import dumps

MAXIMUM_CLIENTS = 64
_QUEUE = 500
_QUEUE_CHARACTERS = 4_000_000
_PATIENCE_S = 20.0
_HEARTBEAT_S = 20.0
_FAREWELL_S = 1.0
_FLEET_PERIOD_S = 1.0
_QUIET = 10
_IN_ORDER = (Topic.OBSERVATIONS.value, Topic.LOG.value)


class Client:
    """What one page has yet to be told: of most kinds the newest only, observations and log lines in order.

    Args:
        vehicles: whose news it wants; None for all.
    """

    def __init__(self, vehicles: frozenset[str] | None) -> None:
        self._vehicles = vehicles
        self._newest: dict[tuple[str, str], str] = {}
        self._in_order: deque[str] = deque()
        self._characters = 0
        self.lost = 0
        self.woken = asyncio.Event()

    def wants(self, vehicle: str) -> bool:
        """Whether it wants this vehicle's news."""
        return self._vehicles is None or vehicle in self._vehicles

    def put(self, kind: str, vehicle: str, text: str) -> None:
        """Queue a message; what finds no room is counted as lost, and all that waited for its turn with it."""
        if kind not in _IN_ORDER:
            self._newest[kind, vehicle] = text
        elif self.lost:
            self.lost += 1
        elif len(self._in_order) < _QUEUE and self._characters + len(text) <= _QUEUE_CHARACTERS:
            self._in_order.append(text)
            self._characters += len(text)
        else:
            self.lost = len(self._in_order) + 1
            self._in_order.clear()

    def take(self) -> list[str]:
        """Everything that waits."""
        texts = [*self._newest.values(), *self._in_order]
        self._newest.clear()
        self._in_order.clear()
        self._characters = 0
        return texts


class Live:
    """Passes news of a fleet on from the thread that brings them to the pages of the event loop it is made in."""

    def __init__(self, fleet: Fleet) -> None:
        self._loop = asyncio.get_running_loop()
        self._fleet = fleet
        self._lock = threading.Lock()
        self._clients: set[Client] = set()
        self._sockets: set[web.WebSocketResponse] = set()
        self._waking = False
        self._fleet_changed = False
        fleet.tell(self.offer)

    def __len__(self) -> int:
        return len(self._clients)

    def offer(self, message: Message) -> None:
        """Queue a message for whom it concerns; from any thread, never waits for a page."""
        with self._lock:
            if message.kind in ("presence", Topic.HEALTH.value):
                self._fleet_changed = True
            clients = [client for client in self._clients if client.wants(message.vehicle)]
        if not clients or message.kind == "presence":
            return
        text = dumps({"type": message.kind, "vehicle": message.vehicle, "data": message.data})
        with self._lock:
            for client in clients:
                client.put(message.kind, message.vehicle, text)
            if self._waking:
                return
            self._waking = True
        self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        with self._lock:
            self._waking = False
            for client in self._clients:
                client.woken.set()

    async def tell_of_the_fleet(self) -> None:
        """For ever: the fleet's list to all pages, once a second if it has changed, and now and then in any case."""
        quiet = 0
        while True:
            await asyncio.sleep(_FLEET_PERIOD_S)
            with self._lock:
                changed, self._fleet_changed = self._fleet_changed, False
            quiet = 0 if changed else quiet + 1
            # A page can't tell a line that is dead from one on which nothing happens.
            if (changed or quiet % _QUIET == 0) and self._clients:
                text = dumps({"type": "vehicles", "data": self._fleet.summaries()})
                with self._lock:
                    for client in self._clients:
                        client.put("vehicles", "", text)
                self._wake()

    async def serve(self, request: web.Request, vehicles: frozenset[str] | None) -> web.WebSocketResponse:
        """A page's connection, until it ends."""
        if len(self._clients) >= MAXIMUM_CLIENTS:
            raise web.HTTPServiceUnavailable(text=f"there are {MAXIMUM_CLIENTS} pages open already")
        socket = web.WebSocketResponse(
            timeout=_FAREWELL_S, heartbeat=_HEARTBEAT_S, max_msg_size=1024, compress=False
        )
        client = Client(vehicles)
        # Counted before the first wait, or as many as like would pass the limit at once.
        with self._lock:
            self._clients.add(client)
        sender = None
        try:
            await socket.prepare(request)
            self._sockets.add(socket)
            sender = asyncio.create_task(self._send(client, socket, request))
            async for _ in socket:
                pass
        finally:
            self._sockets.discard(socket)
            with self._lock:
                self._clients.discard(client)
            if sender is not None:
                sender.cancel()
        return socket

    async def _send(self, client: Client, socket: web.WebSocketResponse, request: web.Request) -> None:
        try:
            while True:
                await client.woken.wait()
                client.woken.clear()
                with self._lock:
                    texts, lost = client.take(), client.lost
                async with asyncio.timeout(_PATIENCE_S):
                    for text in texts:
                        await socket.send_str(text)
                    if lost:
                        await socket.send_str(dumps({"type": "lost", "data": {"messages": lost}}))
                        await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow")
                        return
        except TimeoutError:
            # Whoever doesn't read would not read a farewell either.
            if request.transport is not None:
                request.transport.abort()
        except ConnectionError:
            return

    async def close(self) -> None:
        """Take leave of all pages: they dial again when there is a server."""
        farewells = [each.close(code=WSCloseCode.GOING_AWAY, message=b"stops") for each in self._sockets]
        await asyncio.gather(*farewells)
