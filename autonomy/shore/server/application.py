"""The server's addresses and their answers; docs/page.md has them all."""

import asyncio
from collections.abc import AsyncIterator, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import web

from autonomy.effects import Topic
from autonomy.shore.server import guards, parameters
from autonomy.shore.server.atelier import Atelier, BusyError
from autonomy.shore.server.colours import colormaps
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.server.live import Live
from autonomy.shore.server.maps import FieldMap, evaluate
from autonomy.shore.server.plain import bounds, dumps
from autonomy.wire import ModelSnapshot, decode

PAGE = Path(__file__).parent.parent / "page"


@dataclass(frozen=True)
class Parts:
    """What the answers are made of."""

    fleet: Fleet
    live: Live
    atelier: Atelier
    page: Path


PARTS = web.AppKey("parts", Parts)


def application(
    parts: Parts, names: tuple[str, ...] | None = guards.LOOPBACK, middlewares: Iterable[Any] = ()
) -> web.Application:
    """The application; `names` by which it may be called, None for any."""
    app = web.Application(middlewares=[guards.check_names(names), *middlewares], client_max_size=4096)
    app[PARTS] = parts
    app.on_response_prepare.append(guards.add_headers)
    app.cleanup_ctx.append(_background)
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
            web.get("/api/live", _live),
        ]
    )
    return app


async def _background(app: web.Application) -> AsyncIterator[None]:
    task = asyncio.create_task(app[PARTS].live.tell_of_the_fleet())
    yield
    task.cancel()
    app[PARTS].atelier.close()


def _json(value: Any) -> web.Response:
    response = web.Response(text=dumps(value), content_type="application/json")
    response.enable_compression()
    return response


def _file(page: Path, name: str) -> web.FileResponse:
    file = (page / name).resolve()
    if not file.is_relative_to(page.resolve()) or not file.is_file():
        raise web.HTTPNotFound(text="no such file\n")
    return web.FileResponse(file, headers={"Cache-Control": "no-cache"})


async def _index(request: web.Request) -> web.StreamResponse:
    return _file(request.app[PARTS].page, "index.html")


async def _static(request: web.Request) -> web.StreamResponse:
    return _file(request.app[PARTS].page, request.match_info["name"])


async def _vehicles(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    return _json(request.app[PARTS].fleet.summaries())


async def _vehicle(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    return _json(_of_vehicle(request, request.app[PARTS].fleet.everything))


async def _history(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    return _json(_of_vehicle(request, request.app[PARTS].fleet.history))


def _of_vehicle(request: web.Request, answer: Any, *more: Any) -> Any:
    name = parameters.vehicle(request.match_info["vehicle"])
    try:
        return answer(name, *more)
    except KeyError:
        raise web.HTTPNotFound(text=f"{name} has not been heard of\n") from None


async def _snapshot(request: web.Request) -> tuple[float, ModelSnapshot]:
    """The stop and the model that a request is about."""
    fleet, at_s = request.app[PARTS].fleet, parameters.moment(request)
    newest = _of_vehicle(request, fleet.newest)
    if newest is None:
        raise web.HTTPServiceUnavailable(text="no model has come yet\n", headers={"Retry-After": "5"})
    if at_s is None or at_s >= newest[0]:
        return newest[0], newest[1]
    stop_s, payload = _of_vehicle(request, fleet.stop, at_s)
    key = ("model", request.match_info["vehicle"], stop_s)
    recipe = partial(decode, Topic.MODEL, payload)
    return stop_s, await _make(request, key, recipe, lambda _: 20 * len(payload))


async def _make(request: web.Request, key: Any, recipe: Any, size: Any) -> Any:
    try:
        return await request.app[PARTS].atelier.make(key, recipe, size)
    except BusyError:
        raise web.HTTPServiceUnavailable(
            text="too many maps are asked for at once\n", headers={"Retry-After": "1"}
        ) from None


async def _map(request: web.Request) -> web.StreamResponse:
    parameters.known(request, "at", "south", "west", "north", "east", "rows", "columns")
    stop_s, snapshot = await _snapshot(request)
    extent = parameters.extent(request, bounds(snapshot))
    key = ("map", snapshot.vehicle, stop_s, snapshot.sequence, extent)
    made: FieldMap = await _make(
        request, key, partial(evaluate, snapshot, extent), lambda each: each.mean.nbytes + each.sd.nbytes
    )
    headers = {
        "X-Sequence": str(snapshot.sequence),
        "X-Utc": f"{stop_s:.3f}",
        "X-Rows": str(extent.rows),
        "X-Columns": str(extent.columns),
        "X-Units": snapshot.units.encode("ascii", "replace").decode(),
    }
    for name, values in (("Mean", made.mean), ("Sd", made.sd)):
        if not np.isnan(values).all():
            headers[f"X-{name}-Range"] = f"{np.nanmin(values):.9g} {np.nanmax(values):.9g}"
    body = made.mean.astype("<f4").tobytes() + made.sd.astype("<f4").tobytes()
    return web.Response(body=body, content_type="application/octet-stream", headers=headers)


async def _predict(request: web.Request) -> web.StreamResponse:
    parameters.known(request, "at", "lat", "lon")
    lat = parameters.number(request, "lat", -90.0, 90.0)
    lon = parameters.number(request, "lon", -180.0, 360.0)
    _, snapshot = await _snapshot(request)
    key = ("predict", snapshot.vehicle, snapshot.sequence, snapshot.model_time_s, lat, lon)
    recipe = partial(_at_place, snapshot, lat, lon)
    mean, sd = await _make(request, key, recipe, lambda _: 500)
    return _json({"mean": mean, "sd": sd, "units": snapshot.units, "land": False})


def _at_place(snapshot: ModelSnapshot, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    from autonomy.geometry import LocalFrame

    point = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg).to_local([lat_deg], [lon_deg])
    prediction = snapshot.model.predict(point)
    return float(prediction.mean[0]), float(np.sqrt(max(0.0, float(prediction.variance[0]))))


async def _colormaps(request: web.Request) -> web.StreamResponse:
    parameters.known(request)
    response = _json(colormaps())
    response.headers["Cache-Control"] = "max-age=86400"
    return response


async def _live(request: web.Request) -> web.StreamResponse:
    parameters.known(request, "vehicles")
    return await request.app[PARTS].live.serve(request, parameters.vehicles(request))
