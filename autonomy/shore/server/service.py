"""The server as a whole: the thread that follows the vehicles, and the event loop that answers browsers."""

import asyncio
import contextlib
import signal
import sys
import threading
import time
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from aiohttp import web

from autonomy.effects import Topic
from autonomy.endpoints import Certificates
from autonomy.shore.recording import Recorder, is_recording
from autonomy.shore.server import guards
from autonomy.shore.server.access import check_token
from autonomy.shore.server.application import Parts, application
from autonomy.shore.server.atelier import Atelier
from autonomy.shore.server.connections import Connections
from autonomy.shore.server.fleet import Fleet
from autonomy.shore.server.live import Live
from autonomy.shore.server.nowcasts import Nowcasts
from autonomy.shore.server.past import Past
from autonomy.shore.server.state import Lag
from autonomy.shore.subscriber import Subscriber, Update
from autonomy.wire import LogNotice, decode, split_key

_FAREWELL_S = 2.0
_LOOK_S = 0.5
# The page alone does with the last hours; what is recorded is to be whole.
_PAGE_READINGS, _PAGE_LINES = 20_000, 200
_NUMBERED = (Topic.OBSERVATIONS.value, Topic.LOG.value)


class FollowingError(RuntimeError):
    """Vehicles are not followed any more, and the page would grow old; says why."""


@dataclass(frozen=True)
class Settings:
    """Of one run of the server.

    Attributes:
        host, port: where browsers find the page.
        names: by which they may call it; None: any.
        connect, listen, certificates: the way to the vehicles, as `Subscriber` has it.
        token: that is asked for; None: none.
        record: folder to record to, whose past is shown.
        history: folder of a recording whose past is shown.
    """

    host: str
    port: int
    names: tuple[str, ...] | None
    connect: Sequence[str]
    listen: Sequence[str]
    certificates: Certificates
    token: str | None = None
    record: Path | None = None
    history: Path | None = None


class Inlet:
    """Brings what a subscriber hears, in its thread, to the fleet and to the recording."""

    def __init__(self, fleet: Fleet, lag: Lag, recorder: Recorder | None) -> None:
        self._fleet, self._lag, self._recorder = fleet, lag, recorder
        self._payload: bytes | None = None

    def arrived(self, received_utc_s: float, key: str, encoding: str, payload: bytes) -> None:
        """A sample has come in, and been understood; what it says follows."""
        self._payload = payload
        self._lag.note(max(0.0, time.time() - received_utc_s))
        if self._recorder is not None:
            self._recorder.write(received_utc_s, key, encoding, payload)
        vehicle, last = split_key(key)
        if last in _NUMBERED:
            self._fleet.take(Update(vehicle, decode(Topic(last), payload)), None, time.time())

    def updated(self, update: Update) -> None:
        """What it says; what comes in order has been taken with its numbers, which updates do not have."""
        if not isinstance(update.value, tuple | LogNotice):
            self._fleet.take(update, self._payload, time.time())


async def serve(settings: Settings) -> None:
    """Until SIGINT or SIGTERM.

    Raises:
        OSError: an address or a folder cannot be had.
        RecordingError: the recording can't be read.
        FollowingError: vehicles are not followed any more.
    """
    stopping = asyncio.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stopping.set)
    fleet, lag = Fleet(), Lag()
    atelier = Atelier()
    recorder = None if settings.record is None else _recorder(settings.record)
    try:
        inlet = Inlet(fleet, lag, recorder)
        subscriber = Subscriber(
            "*",
            settings.connect,
            settings.listen,
            on_update=inlet.updated,
            on_arrival=inlet.arrived,
            track_limit=1,
            history=_PAGE_READINGS if recorder is None else None,
            log_history=_PAGE_LINES if recorder is None else None,
            certificates=settings.certificates,
        )
        nowcasts = Nowcasts(fleet, atelier)
        parts = Parts(
            fleet,
            Live(fleet),
            nowcasts,
            lag,
            lambda: subscriber.counters,
            lambda: None if recorder is None else recorder.status,
        )
        async with _answering(settings, parts) as address:
            if await _past(settings, fleet, stopping):
                await asyncio.to_thread(subscriber.start)
                try:
                    _say(f"the page is at http://{address}/")
                    await _end(stopping, subscriber)
                finally:
                    await asyncio.to_thread(subscriber.close)
    finally:
        atelier.close()
        if recorder is not None:
            recorder.close()


async def _end(stopping: asyncio.Event, subscriber: Subscriber) -> None:
    """Wait until we are asked to stop. FollowingError if the subscriber ends before."""
    while subscriber.failed is None:
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stopping.wait(), _LOOK_S)
            return
    raise FollowingError(f"vehicles are not followed any more: {subscriber.failed!r}")


def _recorder(folder: Path) -> Recorder:
    try:
        return Recorder(folder)
    except BlockingIOError as error:
        raise OSError(f"another process records in {folder}") from error


async def _past(settings: Settings, fleet: Fleet, stopping: asyncio.Event) -> bool:
    """Bring earlier runs back; False if we are asked to stop meanwhile."""
    folder = settings.history or settings.record
    if folder is None or (settings.history is None and not is_recording(folder)):
        return not stopping.is_set()
    enough = threading.Event()
    reading = asyncio.create_task(asyncio.to_thread(Past(folder, fleet).read, enough))
    waiting = asyncio.create_task(stopping.wait())
    await asyncio.wait((reading, waiting), return_when=asyncio.FIRST_COMPLETED)
    enough.set()
    waiting.cancel()
    refused = await reading
    if refused:
        _say(f"{folder}: {refused} records cannot be understood; are they of another version?")
    return not stopping.is_set()


@contextlib.asynccontextmanager
async def _answering(settings: Settings, parts: Parts) -> AsyncIterator[str]:
    """Answers browsers at the address that it gives."""
    connections = Connections()
    middlewares = [connections.middleware()]
    if settings.token is not None:
        middlewares.append(check_token(settings.token))
    app = application(parts, guards.check_names(settings.names), *middlewares)
    runner = web.AppRunner(app, access_log=None, keepalive_timeout=60.0, shutdown_timeout=_FAREWELL_S)
    await runner.setup()
    assert runner.server is not None
    watching = asyncio.create_task(connections.watch(runner.server))
    try:
        await _listen(runner, settings.host, settings.port)
        # Port 0 is any that is free.
        yield _shown(settings.host, runner.addresses[0][1])
    finally:
        watching.cancel()
        await runner.cleanup()


async def _listen(runner: web.AppRunner, host: str, port: int) -> None:
    try:
        await web.TCPSite(runner, host, port).start()
    except OSError as error:
        reason = error.strerror or error
        raise OSError(f"cannot listen at {_shown(host, port)}: {reason}; see --http") from error


def _shown(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
