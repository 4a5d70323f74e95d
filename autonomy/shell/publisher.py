"""What goes ashore: a thread of its own owns the zenoh session, for a put on a dying link can block."""

import logging
import math
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import zenoh

from autonomy import wire
from autonomy.effects import Topic
from autonomy.endpoints import THIN_LINK_SETTINGS, Certificates, session_settings
from autonomy.learning.snapshot import Precision
from autonomy.shell.outbox import Outbox
from autonomy.shell.questions import Questions, encoding
from autonomy.shell.rate_limit import RateLimit
from autonomy.wire_commands import command_key
from autonomy.zenoh_session import zenoh_config

log = logging.getLogger(__name__)

_LOOK_AROUND_S = 0.25
_REOPEN_S = 5.0
_UNASKED_S = 10.0
_LINES = 5000
"""Of the log, kept for whoever lacks them."""
_ANSWERING_S = 0.25
"""Then it is looked whether there is something to publish: whoever asks without end does not keep us from it."""
_PRIORITY = {
    Topic.MODEL: zenoh.Priority.DATA_LOW,
    Topic.OBSERVATIONS: zenoh.Priority.DATA_LOW,
    Topic.PLAN: zenoh.Priority.DATA,
    Topic.HEALTH: zenoh.Priority.DATA_HIGH,
    Topic.LOG: zenoh.Priority.DATA,
    Topic.SURVEY: zenoh.Priority.DATA,
    Topic.STATUS: zenoh.Priority.DATA_HIGH,
}


@dataclass(frozen=True)
class PublisherStatus:
    """How the way ashore is.

    Attributes:
        routers: how many were named to dial.
        connected: routers and peers we have a transport to.
        listened: whether anybody subscribes. Connected but never listened to may mean that the router's
            access control refuses us: it does so silently.
        asked: how often somebody has asked for the latest since we are connected; who follows a vehicle does when it
            appears.
        unasked_s: for how long we have been listened to without being asked.
        published: messages handed to zenoh.
        dropped: observations and log lines thrown away before anybody heard them, by topic's name.
        refused: values that couldn't be encoded.
        error: why there is no session, None if there is one.
    """

    routers: int
    connected: int = 0
    listened: bool = False
    asked: int = 0
    unasked_s: float = 0.0
    published: int = 0
    dropped: dict[str, int] = field(default_factory=dict)
    refused: int = 0
    error: str | None = None

    @property
    def trouble(self) -> str:
        """What is wrong with the way ashore, or may be; empty if it is in use, or none was named."""
        if self.error is not None:
            return f"no way ashore: {self.error}"
        if self.connected == 0:
            return "not connected: no router answers, or it refuses us" if self.routers else ""
        if not self.listened:
            return (
                "connected, and nobody listens: nobody is there, or the router lets nothing of ours through"
            )
        if self.unasked_s > _UNASKED_S:
            return (
                "connected, and nobody has asked for the latest: the router may let nothing of ours through"
            )
        if self.connected < self.routers:
            return f"connected to {self.connected} of {self.routers} routers"
        return ""


class Publisher:
    """Publishes one vehicle's values; `publish` never waits for the network.

    Of models, plans, health, status and survey the newest wins, and is kept for whoever joins late (answered to
    queries). Observations and log lines are numbered and kept; whoever lacks some, because he was away or the way
    was, asks for them by their numbers. Of too many the oldest are dropped; the journal has them.

    Args:
        vehicle: name in the keys.
        connect: zenoh endpoints of the routers ashore. None named: nothing is opened, values are discarded.
        backlog: observations kept.
        precision: that models go out with.
        rate_limit_bytes_per_s: what the link can take: models are coarser and everything is rarer then; None: all
            goes as it comes.
        digest_period_s: time between two digests.
        certificates: for routers dialled by tls/… or quic/….
        on_command: is given what somebody asks of `usv/<vehicle>/command`, in zenoh's thread; None: nobody is.

    Raises:
        ValueError: an endpoint isn't one.
    """

    def __init__(
        self,
        vehicle: str,
        connect: Sequence[str],
        backlog: int = 604_800,
        certificates: Certificates | None = None,
        precision: Precision = "16 bit",
        rate_limit_bytes_per_s: float | None = None,
        digest_period_s: float = 60.0,
        on_command: Callable[[zenoh.Query], None] | None = None,
    ) -> None:
        if not wire.VEHICLE_NAME.fullmatch(vehicle):
            raise ValueError(f"vehicle name must match {wire.VEHICLE_NAME.pattern} (got {vehicle!r})")
        self._vehicle = vehicle
        self._settings = session_settings("peer", connect=connect, certificates=certificates)
        if rate_limit_bytes_per_s is not None:
            self._settings |= THIN_LINK_SETTINGS
        self._connect = list(connect)
        self._changed = threading.Condition()
        # Any number will do that no earlier run of this vehicle had; the clock of a boat may begin at the same moment.
        run = secrets.randbits(52)
        limit = RateLimit(rate_limit_bytes_per_s)
        self._outbox = Outbox(run, backlog, _LINES, precision, limit)
        self._questions = Questions(vehicle, self._outbox, limit)
        self._on_command = on_command
        self._digest_period_s = digest_period_s
        self._digested_s = -math.inf
        self._stopping = False
        self._asked = 0
        self._unasked_since: float | None = None
        self._status = PublisherStatus(routers=len(self._connect))
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)

    @property
    def status(self) -> PublisherStatus:
        """As of a moment ago."""
        with self._changed:
            return replace(self._status, dropped=self._outbox.dropped, refused=self._outbox.refused)

    def start(self) -> None:
        """Start the thread, which opens the session."""
        if not self._connect:
            log.info("nobody ashore is told anything: no router is named under shore.connect")
            return
        self._thread.start()

    def publish(self, topic: Topic, value: wire.Payload) -> None:
        """Leave a value to be published under `usv/<vehicle>/<topic>`; returns at once, from any thread."""
        if not self._connect:
            return
        self._outbox.offer(topic, value)
        with self._changed:
            self._changed.notify()

    def stop(self, timeout_s: float = 2.0) -> bool:
        """Publish what waits and close the session; False if that wasn't done within the timeout."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        if not self._thread.is_alive():
            return True
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            log.warning("the zenoh session didn't close within %g s and is left behind", timeout_s)
            return False
        return True

    def _run(self) -> None:
        while not self._stopping:
            try:
                with zenoh.open(zenoh_config(self._settings)) as session:
                    self._set_status(error=None)
                    self._serve(session)
            except Exception as error:  # noqa: BLE001 -- nobody else would notice that this thread has ended
                log.warning("zenoh: %s; trying again in %g s", error, _REOPEN_S)
                self._set_status(error=str(error), connected=0, listened=False)
                with self._changed:
                    self._changed.wait_for(lambda: self._stopping, _REOPEN_S)
        self._set_status(connected=0, listened=False)

    def _serve(self, session: zenoh.Session) -> None:
        """Declare what we publish and answer, then publish until asked to stop."""
        publishers = {
            topic: session.declare_publisher(
                wire.key(self._vehicle, topic),
                encoding=encoding(wire.schema(topic)),
                # What finds no room is gone: observations and lines are asked for again, of others the next is newer.
                congestion_control=zenoh.CongestionControl.DROP,
                priority=_PRIORITY[topic],
            )
            for topic in Topic
        }
        # The token stands as long as its object does; so might, one day, the queryable.
        try:
            with (
                session.declare_queryable(f"usv/{self._vehicle}/*", self._asked_for),
                session.liveliness().declare_token(wire.alive_key(self._vehicle)),
            ):
                self._serve_until_stopped(session, publishers)
        finally:
            self._questions.clear()

    def _serve_until_stopped(self, session: zenoh.Session, publishers: dict[Topic, zenoh.Publisher]) -> None:
        listened: set[Topic] = set()
        while True:
            with self._changed:
                if not self._stopping:
                    self._changed.wait(self._idle_s(listened))
                stopping = self._stopping
            listened = {topic for topic in Topic if _matched(publishers[topic])}
            self._digest(time.monotonic())
            while (parcel := self._outbox.next(time.monotonic(), listened)) is not None:
                publishers[parcel.topic].put(parcel.payload)
                self._set_status(published=self._status.published + 1)
            enough_s = time.monotonic() + _ANSWERING_S
            while self._questions.answer_one(time.monotonic()) and time.monotonic() < enough_s:
                continue
            self._look_around(session, publishers[Topic.MODEL])
            if stopping:
                return

    def _digest(self, now: float) -> None:
        if now >= self._digested_s + self._digest_period_s and self._outbox.has_health:
            self._digested_s = now
            self._outbox.digest(self._vehicle)

    def _idle_s(self, listened: set[Topic]) -> float:
        """How long nothing can be done, unless something comes."""
        now = time.monotonic()
        free_s = [_LOOK_AROUND_S]
        due_s = self._outbox.due_in_s(now, listened)
        if due_s is not None:
            free_s.append(due_s)
        if self._questions:
            free_s.append(self._questions.wait_s(now))
        return min(free_s)

    def _asked_for(self, query: zenoh.Query) -> None:
        """Somebody asks; runs in zenoh's thread."""
        if self._on_command is not None and str(query.key_expr) == command_key(self._vehicle):
            self._on_command(query)
            return
        self._asked += 1
        self._questions.add(query)
        with self._changed:
            self._changed.notify()

    def _look_around(self, session: zenoh.Session, publisher: zenoh.Publisher) -> None:
        connected = len(session.info.routers_zid()) + len(session.info.peers_zid())
        listened = connected > 0 and _matched(publisher)
        if (bool(connected), listened) != (bool(self._status.connected), self._status.listened):
            # A router whose access control refuses us does so silently: it looks like nobody listening.
            audience = "somebody listens" if listened else "nobody listens yet"
            log.info("shore: %s", f"connected, {audience}" if connected else "not connected; dialling on")
        if not connected:
            self._asked = 0
        if not listened or self._asked:
            self._unasked_since = None
        elif self._unasked_since is None:
            self._unasked_since = time.monotonic()
        since = self._unasked_since
        unasked_s = 0.0 if since is None else time.monotonic() - since
        self._set_status(connected=connected, listened=listened, asked=self._asked, unasked_s=unasked_s)

    def _set_status(self, **changes: Any) -> None:
        with self._changed:
            self._status = replace(self._status, **changes)


def _matched(publisher: zenoh.Publisher) -> bool:
    # The stubs of 1.10 call this a bool; it is an object, and always true.
    status: Any = publisher.matching_status
    return bool(status.matching)
