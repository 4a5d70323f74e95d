"""Who may read: everybody who can reach the server, or who knows a token."""

import asyncio
import hashlib
import hmac
import os
from pathlib import Path

from aiohttp import web
from aiohttp.typedefs import Handler, Middleware

from autonomy.config.private import PrivateFileError, read_private

SHORTEST = 16
_COOKIE = "halocline"
_COOKIE_S = 30 * 86_400
_LOGIN_S = 10.0
_HERE = Path(__file__).parent
_OPEN = {"/login": "login.html", "/login.css": "login.css"}


def read_token(file: Path) -> str:
    """The token in a file that only its owner may read.

    Raises:
        PrivateFileError: the file can't be used, or what it holds is too easily guessed.
    """
    text = read_private(file, os.environ).decode("ascii", "replace").strip()
    if len(text) < SHORTEST or not all("!" <= letter <= "~" for letter in text):
        raise PrivateFileError(
            f"{str(file)!a}: a token is at least {SHORTEST} letters, digits and signs without spaces, "
            "such as `openssl rand -hex 20` makes"
        )
    return text


def check_token(token: str) -> Middleware:
    """Only those who know the token: from a header `Authorization: Bearer …`, or the cookie that /login gives."""
    # What the browser keeps must not be what lets other programs in.
    cookie = hmac.new(token.encode(), b"halocline page", hashlib.sha256).hexdigest()

    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        if request.path in _OPEN:
            return await _login(request, token, cookie)
        scheme, _, given = request.headers.get("Authorization", "").partition(" ")
        known = scheme.lower() == "bearer" and _same(given.strip(), token)
        if known or _same(request.cookies.get(_COOKIE, ""), cookie):
            return await handler(request)
        if request.path == "/":
            raise web.HTTPSeeOther("/login")
        raise web.HTTPUnauthorized(text="needs a token\n", headers={"WWW-Authenticate": "Bearer"})

    return middleware


async def _login(request: web.Request, token: str, cookie: str) -> web.StreamResponse:
    if request.method in ("GET", "HEAD"):
        return web.FileResponse(_HERE / _OPEN[request.path])
    if request.method != "POST" or request.path != "/login":
        raise web.HTTPMethodNotAllowed(request.method, ["GET", "POST"])
    async with asyncio.timeout(_LOGIN_S):
        form = await request.post()
    if not _same(str(form.get("token", "")).strip(), token):
        raise web.HTTPForbidden(text="that is not the token\n")
    answer = web.HTTPSeeOther("/")
    answer.set_cookie(
        _COOKIE, cookie, max_age=_COOKIE_S, httponly=True, samesite="Strict", secure=request.secure
    )
    raise answer


def _same(given: str, right: str) -> bool:
    """Whether two texts are the same, in a time that doesn't tell how alike they are."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), right.encode())
