"""What goes ashore: a thread of its own owns the zenoh session, for a put on a dying link can block."""

import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import zenoh

from autonomy import wire
from autonomy.effects import Topic
from autonomy.endpoints import Certificates, session_settings
from autonomy.shell.backlog import Backlog
from autonomy.zenoh_session import zenoh_config

log = logging.getLogger(__name__)

LATEST_WINS = (Topic.MODEL, Topic.PLAN, Topic.HEALTH)
QUEUED = (Topic.OBSERVATIONS, Topic.LOG)
_LOOK_AROUND_S = 0.25
_REOPEN_S = 5.0
_UNASKED_S = 10.0
_PRIORITY = {
    Topic.MODEL: zenoh.Priority.DATA_LOW,
    Topic.OBSERVATIONS: zenoh.Priority.DATA_LOW,
    Topic.PLAN: zenoh.Priority.DATA,
    Topic.HEALTH: zenoh.Priority.DATA_HIGH,
    Topic.LOG: zenoh.Priority.DATA,
}
_CONGESTION = {
    # Whatever finds no room is gone, but for observations: for them this thread waits, up to zenoh's five seconds.
    topic: zenoh.CongestionControl.BLOCK if topic is Topic.OBSERVATIONS else zenoh.CongestionControl.DROP
    for topic in Topic
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
        dropped: observations and log lines thrown away because a queue was full, by topic's name.
        waiting: observations that have not arrived, or perhaps not.
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
    waiting: int = 0
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

    Models, plans and health have one slot each, where the newest wins, and are kept for whoever joins late
    (answered to queries). Observations and log lines wait in bounded queues until somebody listens; the
    oldest are dropped and counted. Observations are handed over again if the way is lost soon after (see `Backlog`):
    whoever is ashore gets each at least once, unless the service ends before, and then the journal has it.

    Args:
        vehicle: name in the keys.
        connect: zenoh endpoints of the routers ashore. None named: nothing is opened, values are discarded.
        backlog: observations kept while nobody listens.
        queue_limit: log lines kept while nobody listens.
        certificates: for routers dialled by tls/… or quic/….

    Raises:
        ValueError: an endpoint isn't one.
    """

    def __init__(
        self,
        vehicle: str,
        connect: Sequence[str],
        backlog: int = 604_800,
        queue_limit: int = 5000,
        certificates: Certificates | None = None,
    ) -> None:
        if not wire.VEHICLE_NAME.fullmatch(vehicle):
            raise ValueError(f"vehicle name must match {wire.VEHICLE_NAME.pattern} (got {vehicle!r})")
        self._vehicle = vehicle
        self._settings = session_settings("peer", connect=connect, certificates=certificates)
        self._connect = list(connect)
        self._changed = threading.Condition()
        self._slots: dict[Topic, Any] = {}
        self._backlog = Backlog(backlog)
        self._lines: deque[wire.LogNotice] = deque(maxlen=queue_limit)
        self._lines_dropped = 0
        self._stopping = False
        self._last: dict[Topic, bytes] = {}
        self._asked = 0
        self._unasked_since: float | None = None
        self._status = PublisherStatus(routers=len(self._connect))
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)

    @property
    def status(self) -> PublisherStatus:
        """As of a moment ago."""
        with self._changed:
            dropped = {
                Topic.OBSERVATIONS.value: self._backlog.dropped,
                Topic.LOG.value: self._lines_dropped,
            }
            return replace(self._status, dropped=dropped, waiting=len(self._backlog))

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
        with self._changed:
            match value:
                case tuple():
                    self._backlog.add(value)
                case wire.ObservationNotice():
                    self._backlog.add((value,))
                case wire.LogNotice():
                    self._lines_dropped += len(self._lines) == self._lines.maxlen
                    self._lines.append(value)
                case _:
                    self._slots[topic] = value
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
        with self._changed:
            self._backlog.lost()
        publishers = {
            topic: session.declare_publisher(
                wire.key(self._vehicle, topic),
                encoding=zenoh.Encoding.APPLICATION_CBOR.with_schema(wire.schema(topic)),
                congestion_control=_CONGESTION[topic],
                priority=_PRIORITY[topic],
            )
            for topic in Topic
        }
        # The token stands as long as its object does; so might, one day, the queryable.
        with (
            session.declare_queryable(f"usv/{self._vehicle}/*", self._answer),
            session.liveliness().declare_token(wire.alive_key(self._vehicle)),
        ):
            self._serve_until_stopped(session, publishers)

    def _serve_until_stopped(self, session: zenoh.Session, publishers: dict[Topic, zenoh.Publisher]) -> None:
        listened: list[Topic] = []
        while True:
            with self._changed:
                if not (self._stopping or self._has_work(listened)):
                    self._changed.wait(_LOOK_AROUND_S)
            listened = [topic for topic in QUEUED if _matched(publishers[topic])]
            with self._changed:
                stopping = self._stopping
                batch = self._take(listened)
            for topic, value in batch:
                self._put(publishers[topic], topic, value)
            self._look_around(session, publishers[Topic.MODEL])
            if stopping:
                return

    def _has_work(self, listened: list[Topic]) -> bool:
        return bool(
            self._slots
            or (self._lines and Topic.LOG in listened)
            or (Topic.OBSERVATIONS in listened and self._backlog.is_ready(time.monotonic()))
        )

    def _take(self, listened: list[Topic]) -> list[tuple[Topic, Any]]:
        batch: list[tuple[Topic, Any]] = list(self._slots.items())
        self._slots = {}
        if Topic.LOG in listened:
            batch += [(Topic.LOG, line) for line in self._lines]
            self._lines.clear()
        if Topic.OBSERVATIONS in listened:
            batch += [(Topic.OBSERVATIONS, each) for each in self._backlog.take(time.monotonic())]
        else:
            self._backlog.lost()
        return batch

    def _put(self, publisher: zenoh.Publisher, topic: Topic, value: wire.Payload) -> None:
        try:
            payload = wire.encode(value)
        except wire.WireError as error:
            if isinstance(value, tuple) and len(value) > 1:
                # The one that can't be written must not take the others with it.
                for half in (value[: len(value) // 2], value[len(value) // 2 :]):
                    self._put(publisher, topic, half)
                return
            log.warning("not published: %s", error)
            self._set_status(refused=self._status.refused + 1)
            return
        if topic in LATEST_WINS:
            self._last[topic] = payload
        publisher.put(payload)
        self._set_status(published=self._status.published + 1)

    def _answer(self, query: zenoh.Query) -> None:
        """The last model, plan and health, for somebody who has just come; runs in zenoh's thread."""
        self._asked += 1
        with query:
            for topic, payload in list(self._last.items()):
                name = wire.key(self._vehicle, topic)
                if query.key_expr.intersects(name):
                    encoding = zenoh.Encoding.APPLICATION_CBOR.with_schema(wire.schema(topic))
                    query.reply(name, payload, encoding=encoding)

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
