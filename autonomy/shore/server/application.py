"""The server's addresses and their answers; docs/page.md has them all."""

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import web
from aiohttp.typedefs import Handler, Middleware
from numpy.typing import NDArray

from autonomy.shore.recording import RecorderStatus
from autonomy.shore.server import parameters
from autonomy.shore.server.allowance import Allowance, BusyError
from autonomy.shore.server.colours import colormaps
from autonomy.shore.server.fleet import Fleet, UnknownVehicleError
from autonomy.shore.server.guards import add_headers
from autonomy.shore.server.live import Live
from autonomy.shore.server.nowcasts import Found, NoModelError, Nowcasts
from autonomy.shore.server.plain import bounds, dumps
from autonomy.shore.server.state import Lag, memory_mb
from autonomy.shore.subscriber import Counters

PAGE = Path(__file__).parent.parent / "page"
_LARGEST_BODY = 4096
_UNREAD_BYTES = 64 * 2**20
_PIECE_BYTES = 256 * 2**10
# Said here, for what a system's own list says of them differs, and browsers run no module under a wrong type.
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".woff2": "font/woff2",
    ".txt": "text/plain; charset=utf-8",
}


@dataclass(frozen=True)
class Parts:
    """What the answers are made of; `page` is the folder of the page's files."""

    fleet: Fleet
    live: Live
    nowcasts: Nowcasts
    lag: Lag
    counters: Callable[[], Counters]
    recording: Callable[[], RecorderStatus | None] = lambda: None
    page: Path = PAGE
    sending: Allowance = field(default_factory=lambda: Allowance(_UNREAD_BYTES))


PARTS = web.AppKey("parts", Parts)


def application(parts: Parts, *middlewares: Middleware) -> web.Application:
    """The application behind its guards, the outermost first."""
    app = web.Application(middlewares=[*middlewares, _refusals], client_max_size=_LARGEST_BODY)
    app[PARTS] = parts
    app.on_response_prepare.append(add_headers)
    app.cleanup_ctx.append(_background)
    app.on_shutdown.append(_take_leave)
    app.add_routes(
        [
            web.get("/", _index),
            web.get("/static/{name:.+}", _static),
            web.get("/api/vehicles", _vehicles),
            web.get("/api/vehicle/{vehicle}", _vehicle),
            web.get("/api/vehicle/{vehicle}/history", _history),
            web.get("/api/vehicle/{vehicle}/map", _map),
            web.get("/api/vehicle/{vehicle}/predict", _predict),
            web.get("/api/colormaps", _colormaps),
            web.get("/api/server", _server),
            web.get("/api/live", _live),
        ]
    )
    return app


async def _background(app: web.Application) -> AsyncIterator[None]:
    parts = app[PARTS]
    tasks = [asyncio.create_task(each) for each in (parts.live.tell_of_the_fleet(), parts.lag.watch())]
    yield
    for task in tasks:
        task.cancel()


async def _take_leave(app: web.Application) -> None:
    await app[PARTS].live.close()


@web.middleware
async def _refusals(request: web.Request, handler: Handler) -> web.StreamResponse:
    """What can't be answered, in the words of HTTP."""
    try:
        return await handler(request)
    except parameters.ParameterError as error:
        raise web.HTTPBadRequest(text=f"{error}\n") from None
    except UnknownVehicleError as error:
        raise web.HTTPNotFound(text=f"{error}\n") from None
    except NoModelError as error:
        raise web.HTTPServiceUnavailable(text=f"{error}\n", headers={"Retry-After": "5"}) from None
    except BusyError:
        text = "more maps are asked for than can be made\n"
        raise web.HTTPServiceUnavailable(text=text, headers={"Retry-After": "1"}) from None


def _json(value: Any) -> web.Response:
    response = web.Response(text=dumps(value), content_type="application/json")
    response.enable_compression()
    return response


def _file(page: Path, name: str) -> web.FileResponse:
    kind = _TYPES.get(Path(name).suffix)
    if kind is None or "\0" in name:
        raise web.HTTPNotFound(text="no such file\n")
    file = (page / name).resolve()
    if not file.is_relative_to(page.resolve()) or not file.is_file():
        raise web.HTTPNotFound(text="no such file\n")
    return web.FileResponse(file, headers={"Content-Type": kind, "Cache-Control": "no-cache"})


async def _index(request: web.Request) -> web.StreamResponse:
    return _file(request.app[PARTS].page, "index.html")


async def _static(request: web.Request) -> web.StreamResponse:
    return _file(request.app[PARTS].page, request.match_info["name"])


async def _vehicles(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    return _json(request.app[PARTS].fleet.summaries())


async def _vehicle(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    return _json(request.app[PARTS].fleet.everything(parameters.vehicle(request)))


async def _history(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    return _json(request.app[PARTS].fleet.history(parameters.vehicle(request)))


async def _found(request: web.Request) -> Found:
    """The model that a request is about."""
    name, at_s = parameters.vehicle(request), parameters.moment(request)
    return await request.app[PARTS].nowcasts.find(name, at_s)


async def _map(request: web.Request) -> web.StreamResponse:
    parameters.known(request, "at", "south", "west", "north", "east", "rows", "columns")
    found = await _found(request)
    extent = parameters.extent(request, bounds(found.snapshot))
    made = await request.app[PARTS].nowcasts.map(found, extent)
    headers = {
        "X-Sequence": str(found.snapshot.sequence),
        "X-Utc": f"{found.stop_s:.3f}",
        "X-Rows": str(extent.rows),
        "X-Columns": str(extent.columns),
    }
    for name, values in (("Mean", made.mean), ("Sd", made.sd)):
        if not np.isnan(values).all():
            headers[f"X-{name}-Range"] = f"{np.nanmin(values):.9g} {np.nanmax(values):.9g}"
    return await _numbers(request, np.stack([made.mean, made.sd]).astype("<f4"), headers)


async def _numbers(
    request: web.Request, values: NDArray[np.float32], headers: dict[str, str]
) -> web.StreamResponse:
    """Send an array as it is, piece by piece: what nobody reads is counted while it waits."""
    answer = web.StreamResponse(headers={**headers, "Content-Type": "application/octet-stream"})
    answer.content_length = values.nbytes
    with request.app[PARTS].sending.taken(values.nbytes):
        await answer.prepare(request)
        body = memoryview(b"" if request.method == "HEAD" else values.tobytes())
        for start in range(0, len(body), _PIECE_BYTES):
            await answer.write(body[start : start + _PIECE_BYTES])
        await answer.write_eof()
    return answer


async def _predict(request: web.Request) -> web.StreamResponse:
    parameters.known(request, "at", "lat", "lon")
    lat_deg = parameters.number(request, "lat", -90.0, 90.0)
    lon_deg = parameters.number(request, "lon", -180.0, 360.0)
    found = await _found(request)
    value = await request.app[PARTS].nowcasts.value(found, lat_deg, lon_deg)
    return _json({**asdict(value), "units": found.snapshot.units, "utc_s": found.stop_s})


async def _colormaps(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    response = _json(colormaps())
    response.headers["Cache-Control"] = "max-age=86400"
    return response


async def _server(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    parts = request.app[PARTS]
    recording = parts.recording()
    return _json(
        {
            "vehicles": len(parts.fleet),
            **asdict(parts.counters()),
            "lag_s": round(parts.lag.longest_s, 3),
            "memory_mb": round(memory_mb(), 1),
            "clients": len(parts.live),
            "recording": recording and asdict(recording),
        }
    )


async def _live(request: web.Request) -> web.StreamResponse:
    parameters.known(request, "vehicles")
    return await request.app[PARTS].live.serve(request, parameters.vehicles(request))
