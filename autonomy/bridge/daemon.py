"""The bridge's shell: it waits for the instrument and for the vehicle, and carries from one to the other."""

import asyncio
import logging
import os
import signal
import time
from collections.abc import Callable, Coroutine, Hashable, Iterable, Sequence
from typing import Any

from autonomy.bridge.bridge import Bridge
from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.lines import LineSplitter
from autonomy.bridge.raw_log import RawLog, timestamp
from autonomy.mavlink.codec import Codec
from autonomy.shell.signed_link import SignedLink
from autonomy.shell.systemd import Notifier
from autonomy.shell.transport import Backoff, Transport
from autonomy.shell.transports import open_transport

log = logging.getLogger("autonomy.bridge")

_STEP_S = 0.05
_TEND_S = 1.0
_PROVISIONAL_SYSTEM_ID = 1
_PORT_BACKOFF = Backoff(0.2, 5.0)

OnLine = Callable[[str], None]
Source = Callable[[OnLine], Coroutine[Any, Any, None]]
"""Lines from elsewhere than the instrument's port, at their own pace."""


class BridgeDaemon:
    """One bridge, until SIGTERM or SIGINT, or until the end of what is replayed.

    Args:
        configuration: all of it.
        raw: where lines are recorded; it is closed at the end. None: nowhere.
        signed_link: what signs and checks the packets of the link to the vehicle; None: nothing does.
        source: where lines come from; None: from the instrument's port.
    """

    def __init__(
        self,
        configuration: BridgeConfiguration,
        raw: RawLog | None = None,
        signed_link: SignedLink | None = None,
        source: Source | None = None,
    ) -> None:
        self._configuration = configuration
        self._raw = raw
        self._signed_link = signed_link
        self._source = source
        signing = None if signed_link is None else signed_link.signing
        self._codec = Codec(_PROVISIONAL_SYSTEM_ID, configuration.mavlink.component_id, signing)
        self._splitter: LineSplitter | None = None
        self._notifier = Notifier(os.environ)
        self._status = ""
        self._tend_due = 0.0

    async def run(self) -> None:
        """Carry lines.

        Raises:
            Exception: whatever the source raised, or a bug of ours.
        """
        loop = asyncio.get_running_loop()
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, stop.set)
        self._bridge = Bridge(self._configuration, loop.time())
        self._vehicle = open_transport(
            self._configuration.mavlink.endpoint,
            on_bytes=self._on_vehicle,
            on_up=lambda: log.info("link to the vehicle: %s", self._configuration.mavlink.endpoint),
            on_down=self._vehicle_down,
        )
        port = self._open_port() if self._source is None else None
        played = asyncio.create_task(self._play(self._source)) if self._source is not None else None
        self._notifier.ready()
        try:
            await self._work(stop, [each for each in (port, self._vehicle) if each is not None], played)
        finally:
            self._notifier.stopping()
            for each in (port, self._vehicle):
                if each is not None:
                    await each.close()
            if played is not None:
                played.cancel()
            self._tell()
            log.info("%s%s", self._bridge.report(), self._of_the_port())
            await asyncio.to_thread(self._close)

    async def _work(
        self, stop: asyncio.Event, transports: Sequence[Transport], played: "asyncio.Task[None] | None"
    ) -> None:
        """Do what is due until the stop, or the end of what is played."""
        loop = asyncio.get_running_loop()
        while not stop.is_set():
            self._step(loop.time())
            for each in transports:
                if each.keeper.done():
                    each.keeper.result()  # it never ends but by a bug
            if played is not None and played.done():
                return played.result()
            try:
                async with asyncio.timeout(_STEP_S):
                    await stop.wait()
            except TimeoutError:
                continue
        return None

    def _close(self) -> None:
        if self._raw is not None:
            self._raw.close()
        if self._signed_link is not None:
            self._signed_link.close()
        self._notifier.close()

    def _open_port(self) -> Transport:
        instrument = self._configuration.instrument
        port = open_transport(
            instrument.endpoint,
            on_bytes=self._on_instrument,
            on_up=self._port_up,
            on_down=self._bridge.port_down,
            backoff=_PORT_BACKOFF,
        )
        self._splitter = LineSplitter(is_stream=port.is_stream, data_bits=instrument.data_bits)
        return port

    async def _play(self, source: Source) -> None:
        """Hand over what was recorded, once it can be sent on."""
        loop = asyncio.get_running_loop()
        while not self._bridge.knows_time(loop.time()):
            await asyncio.sleep(_STEP_S)
        self._bridge.port_up(loop.time())
        await source(self._on_line)

    def _vehicle_down(self, reason: str) -> None:
        log.warning("no link to the vehicle: %s", reason)
        self._bridge.link_down()

    def _port_up(self) -> None:
        assert self._splitter is not None
        self._splitter.restart()
        self._bridge.port_up(asyncio.get_running_loop().time())

    def _on_instrument(self, data: bytes, peer: Hashable) -> None:
        assert self._splitter is not None
        too_long = self._splitter.counters.too_long
        for line in self._splitter.add(data):
            self._on_line(line)
        if self._splitter.counters.too_long > too_long:
            self._bridge.on_noise(asyncio.get_running_loop().time())

    def _on_line(self, line: str) -> None:
        now = asyncio.get_running_loop().time()
        outcome = self._bridge.on_line(now, line)
        self._send(outcome.messages)
        if self._raw is not None:
            self._raw.add({"utc": timestamp(time.time()), "host_s": round(now, 4), **outcome.record()})

    def _on_vehicle(self, data: bytes, peer: Hashable) -> None:
        now = asyncio.get_running_loop().time()
        for message in self._codec.decode(data, peer, stream=self._vehicle.is_stream):
            self._send(self._bridge.on_message(now, message))

    def _step(self, now: float) -> None:
        self._send(self._bridge.step(now))
        self._tell()
        if now >= self._tend_due:
            self._tend_due = now + _TEND_S
            self._notifier.watchdog()
            if self._signed_link is not None:
                self._signed_link.tend()
            if self._bridge.status != self._status:
                self._status = self._bridge.status
                self._notifier.status(self._status)

    def _send(self, messages: Iterable[Any]) -> None:
        if self._bridge.system_id is not None:
            self._codec.system_id = self._bridge.system_id
        for message in messages:
            self._vehicle.send(self._codec.encode(message))

    def _tell(self) -> None:
        for level, text in self._bridge.news.take():
            log.log(level, "%s", text)

    def _of_the_port(self) -> str:
        """What came in and was no line."""
        if self._splitter is None:
            return ""
        counters = self._splitter.counters
        parts = ((counters.fragments, "broken off"), (counters.too_long, "too long"))
        return "".join(f", {what}: {count}" for count, what in parts if count)
