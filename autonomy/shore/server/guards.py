"""What every request has to pass, and what every answer says to the browser."""

from collections.abc import Awaitable, Callable
from urllib.parse import urlsplit

from aiohttp import web
from aiohttp.typedefs import Middleware

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; form-action 'self'; "
        "frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Permissions-Policy": "geolocation=(), camera=(), microphone=()",
}


async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
    """Signal of the application: the headers of every answer, refusals among them."""
    response.headers.update(HEADERS)
    response.headers.setdefault("Cache-Control", "no-store")
    response.headers.popall("Server", None)


def check_names(names: tuple[str, ...] | None) -> Middleware:
    """Only requests that call us by one of these names, and, from a page, only from our own.

    A page of somebody else's whose name is made to lead to this machine ("DNS rebinding") calls us by that name.
    None: we don't know what we are called.
    """

    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        if names is not None and _host(request.host) not in names:
            raise web.HTTPForbidden(text="this server doesn't go by that name; see --host\n")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text="asked for by a page of another server\n")
        return await handler(request)

    return middleware


def _host(text: str) -> str | None:
    """The name in a Host header, None if it isn't one."""
    try:
        return urlsplit(f"//{text}").hostname
    except ValueError:
        return None
