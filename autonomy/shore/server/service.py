"""The server as a whole: the thread that follows the vehicles, and the event loop that answers browsers."""

import asyncio
import signal
import time
from collections.abc import Sequence

from aiohttp import web

from autonomy import wire
from autonomy.endpoints import Certificates
from autonomy.shore.server.application import PAGE, Parts, application
from autonomy.shore.server.atelier import Atelier
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.server.live import Live
from autonomy.shore.subscriber import Subscriber, Update

_FAREWELL_S = 2.0


async def serve(
    http: tuple[str, int], connect: Sequence[str], listen: Sequence[str], certificates: Certificates
) -> None:
    """Until SIGINT or SIGTERM. OSError if an address cannot be had."""
    stopping = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stopping.set)
    fleet = Fleet()
    live = Live(fleet)
    runner = web.AppRunner(
        application(Parts(fleet, live, Atelier(), PAGE)), access_log=None, shutdown_timeout=_FAREWELL_S
    )
    await runner.setup()
    try:
        await _site(runner, *http)
        subscriber = Subscriber(
            "*",
            connect,
            listen,
            on_update=lambda update: _pass_on(fleet, update),
            track_limit=1,
            certificates=certificates,
        )
        subscriber.start()
        try:
            print(f"http://{_shown(*http)}/", flush=True)
            await stopping.wait()
        finally:
            subscriber.close()
    finally:
        await runner.cleanup()


async def _site(runner: web.AppRunner, host: str, port: int) -> None:
    try:
        await web.TCPSite(runner, host, port).start()
    except OSError as error:
        raise OSError(f"cannot listen at {_shown(host, port)}: {error.strerror or error}") from error


def _shown(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _pass_on(fleet: Fleet, update: Update) -> None:
    payload = wire.encode(update.value) if isinstance(update.value, wire.ModelSnapshot) else None
    fleet.take(update, payload, time.time())
