"""Who is connected: only so many, and nobody who keeps us waiting."""

import asyncio
import math
import time

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

MAXIMUM_CONNECTIONS = 256
_LOOK_S = 1.0


class Connections:
    """Ends connections on which no request, or no end of its answer, comes; and the newest, if they are too many.

    Not every release of aiohttp minds how long the head of a request takes, and none how slowly an answer is read.

    Args:
        first_s: for the first request to have come.
        next_s: from one request to the next, the answer included; pages' live connections are exempt.
    """

    def __init__(self, first_s: float = 20.0, next_s: float = 120.0) -> None:
        self._first_s, self._next_s = first_s, next_s
        self._deadlines_s: dict[asyncio.Protocol, float] = {}

    def middleware(self) -> Middleware:
        """Notes when requests come."""

        @web.middleware
        async def note(request: web.Request, handler: Handler) -> web.StreamResponse:
            live = request.headers.get("Upgrade", "").lower() == "websocket"
            self._deadlines_s[request.protocol] = math.inf if live else time.monotonic() + self._next_s
            try:
                return await handler(request)
            finally:
                if live:
                    self._deadlines_s[request.protocol] = time.monotonic() + self._first_s

        return note

    async def watch(self, server: web.Server) -> None:
        """For ever: end what takes too long."""
        while True:
            await asyncio.sleep(_LOOK_S)
            now_s = time.monotonic()
            fresh_s = now_s + self._first_s
            self._deadlines_s = {each: self._deadlines_s.get(each, fresh_s) for each in server.connections}
            for number, protocol in enumerate(server.connections):
                late = self._deadlines_s[protocol] < now_s or number >= MAXIMUM_CONNECTIONS
                if late and protocol.transport is not None:
                    protocol.transport.abort()
