"""Following vehicles: the latest of everything they publish, and what they told in order without a gap."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import blake2b
from typing import Any

from autonomy import wire
from autonomy.effects import Topic
from autonomy.endpoints import Certificates
from autonomy.observation_ring import notices
from autonomy.shore.inbox import Arrival, Inbox
from autonomy.shore.lack import lacking
from autonomy.shore.newness import is_older, same_model
from autonomy.shore.roster import MAXIMUM_VEHICLES, Entry, Roster, VehicleView
from autonomy.shore.session import ROLL_CALL_S, ShoreSession
from autonomy.shore.streams import Stream

__all__ = ["Counters", "OnArrival", "Presence", "Subscriber", "Update", "VehicleView"]

log = logging.getLogger(__name__)

OnArrival = Callable[[float, str, str, bytes], None]
"""Called with the time of receipt (seconds since 1970), key, encoding and payload of a message."""

_QUEUE_LIMIT = 10_000
_QUEUE_BYTES = 256 * 2**20
_SWEEP_S = 0.2
_READY_S = 10.0
_TOPICS = {topic.value: topic for topic in Topic}
_EVERYTHING = "*"
"""The last part of the key under which a vehicle is asked for the newest of everything."""


@dataclass(frozen=True)
class Presence:
    """A vehicle's software appeared (or came back) on the network, or left it."""

    alive: bool


@dataclass(frozen=True)
class Update:
    """One thing that has come in from one vehicle; observations by the batch, lines of the log one by one."""

    vehicle: str
    value: wire.Message | tuple[wire.ObservationNotice, ...] | wire.LogNotice | Presence


@dataclass(frozen=True)
class Counters:
    """What has come in since the start.

    Attributes:
        received: messages decoded.
        refused: messages that were not what their key promises, or for which there was no room.
        dropped: messages dropped because we were too slow.
        missed: observations and lines that vehicles had dropped before we could ask for them.
    """

    received: int = 0
    refused: int = 0
    dropped: int = 0
    missed: int = 0


class Subscriber:
    """Follows one vehicle, or all of them, from a thread of its own; use it as a context manager.

    Whenever a vehicle appears (also again, after its or the router's restart) its last values are asked for until it
    answers, so that a late joiner needn't wait for the next. Observations and lines of the log are given on in order,
    none twice, and those that did not come are asked for. What others send is decoded with bounds: anything that isn't
    what its key promises is counted and logged, never raised.

    Args:
        vehicle: name, or "*" for all.
        connect: endpoints of routers to be a client of; dialled until one is there.
        listen: endpoints at which to be the router itself. One of the two must be given, not both.
        on_update: called with every update in the subscriber's thread, after the latest values have changed. What it
            raises ends the following, and is `failed`; so with `on_arrival`.
        on_arrival: called with every message as it came, in the same thread and before `on_update`: models, plans,
            health and the like when they are new or come by themselves, observations and lines in order and none twice.
        track_limit: observations kept per vehicle.
        history: observations wanted of those that a vehicle told before we came; None: all that it keeps.
        log_history: the same of lines of its log.
        certificates: for addresses that begin with tls/ or quic/.
        clock_s: monotonic clock by which vehicles are asked.

    Raises:
        ValueError: a name or an endpoint isn't one, or not exactly one of connect and listen is given.
        OSError: by `start`: the address to listen at cannot be had.
    """

    def __init__(
        self,
        vehicle: str = "*",
        connect: Sequence[str] = (),
        listen: Sequence[str] = (),
        on_update: Callable[[Update], None] | None = None,
        on_arrival: OnArrival | None = None,
        track_limit: int = 20_000,
        history: int | None = 20_000,
        log_history: int | None = 200,
        certificates: Certificates | None = None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        if vehicle != "*" and not wire.VEHICLE_NAME.fullmatch(vehicle):
            raise ValueError(f"not a vehicle: {vehicle!r}: must be * or match {wire.VEHICLE_NAME.pattern}")
        if bool(connect) == bool(listen):
            raise ValueError("either connect to a router or listen as one")
        self._on_update = on_update
        self._on_arrival = on_arrival
        self._clock_s = clock_s
        self._inbox = Inbox(_QUEUE_LIMIT, _QUEUE_BYTES)
        self._session = ShoreSession(vehicle, connect, listen, certificates, self._inbox, self._count)
        self._roster = Roster(track_limit, history, log_history)
        self._stopping, self._following = threading.Event(), threading.Event()
        self._changed = threading.Condition()
        self._counters = Counters()
        self._failed: Exception | None = None
        self._outdated: set[str] = set()
        self._updates = 0
        self._swept_s = self._called_s = 0.0
        self._thread = threading.Thread(target=self._run, name="subscriber", daemon=True)

    def __enter__(self) -> "Subscriber":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Open the session: at once as a router, in the thread (which waits for a router) as a client.

        A router hears from then on; a client when it has found its router.
        """
        self._session.listen()
        self._thread.start()
        if self._session.is_open:
            self._following.wait(_READY_S)

    def close(self, timeout_s: float = 5.0) -> None:
        """End the thread and close the session, within the timeout; a dial under way ends by itself."""
        self._stopping.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s if self._session.is_open else 0.1)

    def vehicles(self) -> list[str]:
        """Names of the vehicles heard of, sorted."""
        with self._changed:
            return self._roster.names

    def latest(self, vehicle: str) -> VehicleView:
        """The latest values of a vehicle (all None if it hasn't been heard)."""
        with self._changed:
            entry = self._roster.get(vehicle)
            return VehicleView(vehicle) if entry is None else entry.view

    def track(self, vehicle: str) -> list[wire.ObservationNotice]:
        """The observations heard, oldest first."""
        with self._changed:
            entry = self._roster.get(vehicle)
            if entry is None:
                return []
            rows = entry.track.rows(entry.track.oldest, entry.track.end)
        return list(notices(rows))

    @property
    def failed(self) -> Exception | None:
        """What has ended the following before `close`; None as long as it goes on. Nothing comes in after it."""
        with self._changed:
            return self._failed

    @property
    def counters(self) -> Counters:
        """What has come in since the start."""
        with self._changed:
            missed = sum(entry.observations.missed + entry.lines.missed for entry in self._roster)
            return replace(self._counters, missed=missed)

    def wait_for(self, condition: Callable[["Subscriber"], bool], timeout_s: float) -> bool:
        """Wait until a condition holds, examined again at every update; False after the timeout."""
        deadline = time.monotonic() + timeout_s
        while True:
            with self._changed:
                seen = self._updates
            if condition(self):
                return True
            with self._changed:
                remaining = deadline - time.monotonic()
                if remaining <= 0.0:
                    return False
                if self._updates == seen:
                    self._changed.wait(remaining)

    def _run(self) -> None:
        try:
            self._follow()
        except Exception as error:
            log.exception("vehicles are not followed any more")
            with self._changed:
                self._failed = error
                self._updates += 1
                self._changed.notify_all()
        finally:
            self._following.set()

    def _follow(self) -> None:
        with self._session.following(self._stopping):
            self._following.set()
            # Whose token stands already is told us anyhow.
            self._called_s = self._clock_s()
            while not self._stopping.is_set():
                arrival = self._inbox.take(timeout_s=0.1)
                if arrival is not None:
                    self._take(arrival)
                self._sweep()

    def _take(self, arrival: Arrival) -> None:
        try:
            vehicle, last = wire.split_key(arrival.key)
            if arrival.alive is not None:
                known = self._roster.get(vehicle)
                if not (arrival.roll_call and known is not None and known.view.alive):
                    self._presence(vehicle, arrival.alive)
                return
            if arrival.closed:
                self._closed(vehicle, last, arrival)
                return
            if last not in _TOPICS:
                raise wire.WireError(f"{arrival.key}: must end in {', '.join(_TOPICS)}")
            topic = _TOPICS[last]
            if arrival.query is not None and arrival.piece is None:
                self._answered(vehicle)
            value = wire.decode(topic, arrival.payload)
            if isinstance(value, wire.ModelSnapshot) and value.vehicle != vehicle:
                raise wire.WireError(f"{arrival.key}: is a model of {value.vehicle}")
            with self._changed:
                entry = self._roster.entry(vehicle)
            self._keep(entry, topic, value, arrival)
            self._ask(entry)
        except wire.VersionError as error:
            if arrival.key not in self._outdated and len(self._outdated) < MAXIMUM_VEHICLES * len(_TOPICS):
                self._outdated.add(arrival.key)
                log.warning("refused from now on (said once): %s: %s", arrival.key, error)
            self._count(refused=1)
        except wire.WireError as error:
            log.warning("refused: %s", error)
            self._count(refused=1)

    def _presence(self, vehicle: str, alive: bool) -> None:
        with self._changed:
            entry = self._roster.entry(vehicle, has_token=alive)
            entry.view = replace(entry.view, alive=alive)
            entry.was_alive = entry.was_alive or alive
        if alive:
            entry.greeting.begin()
            entry.observations.greet()
            entry.lines.greet()
            self._ask(entry)
        self._tell(Update(vehicle, Presence(alive)))

    def _sweep(self) -> None:
        """Look now and then whether a vehicle is to be asked for anything."""
        now = self._clock_s()
        if now >= self._swept_s + _SWEEP_S:
            self._swept_s = now
            for entry in self._roster:
                self._ask(entry)
        if now >= self._called_s + ROLL_CALL_S:
            self._called_s = now
            self._session.call_roll()

    def _ask(self, entry: Entry) -> None:
        """Ask a vehicle for its newest values and for what is missing of what it told in order.

        Not one that is known to be gone.
        """
        if entry.was_alive and not entry.view.alive:
            return
        now, view = self._clock_s(), entry.view
        vehicle = view.vehicle
        if entry.greeting.question(now):
            self._session.ask(f"usv/{vehicle}/{_EVERYTHING}")
        for topic, lacks in lacking(view.health, view.plan, view.survey).items():
            if entry.lacks[topic].question(now, lacks):
                self._session.ask(wire.key(vehicle, topic))
        streams: tuple[tuple[Topic, Stream[Any]], ...]
        streams = ((Topic.OBSERVATIONS, entry.observations), (Topic.LOG, entry.lines))
        for topic, stream in streams:
            piece = stream.question(now)
            if piece is not None:
                self._session.ask(wire.key(vehicle, topic), piece)

    def _answered(self, vehicle: str) -> None:
        entry = self._roster.get(vehicle)
        if entry is not None:
            entry.greeting.answered()

    def _closed(self, vehicle: str, last: str, arrival: Arrival) -> None:
        entry = self._roster.get(vehicle)
        if entry is None:
            return
        if last == _EVERYTHING:
            entry.greeting.closed()
        elif arrival.piece is None and _TOPICS.get(last) in entry.lacks:
            entry.lacks[_TOPICS[last]].closed()
        elif arrival.piece is not None and last == Topic.OBSERVATIONS.value:
            self._give_observations(entry, entry.observations.closed(arrival.piece), arrival, None)
        elif arrival.piece is not None and last == Topic.LOG.value:
            self._give_lines(entry, entry.lines.closed(arrival.piece), arrival, None)

    def _keep(self, entry: Entry, topic: Topic, value: wire.Message, arrival: Arrival) -> None:
        if arrival.query is None:
            entry.live_since[topic] = self._session.queries
        elif arrival.piece is None and entry.live_since.get(topic, -1) >= arrival.query:
            # What came by itself since we asked is at least as new as the answer.
            return
        self._count(received=1)
        asked = arrival.piece is not None
        match value:
            case wire.ObservationBatch():
                self._give_observations(entry, entry.observations.take(value, asked=asked), arrival, value)
                return
            case wire.LogBatch():
                self._give_lines(entry, entry.lines.take(value, asked=asked), arrival, value)
                return
        looks = blake2b(arrival.payload, digest_size=16).digest()
        if arrival.query is not None and entry.payloads.get(topic) == looks:
            # Asked for after every break, and perhaps no news.
            return
        if arrival.query is not None and is_older(entry.view, value):
            # A storage on the way may answer with what it had when it lost sight of the vehicle.
            return
        with self._changed:
            match value:
                case wire.ModelSnapshot():
                    if same_model(entry.view.model, value):
                        return
                    self._roster.keep_model(entry, value)
                case wire.PlanNotice():
                    entry.view = replace(entry.view, plan=value)
                case wire.HealthNotice():
                    entry.view = replace(entry.view, health=value)
                    if value.run:
                        entry.observations.told(value.run, value.observations_end)
                        entry.lines.told(value.run, value.log_end)
                case wire.SurveyNotice():
                    entry.view = replace(entry.view, survey=value)
                case wire.StatusDigest():
                    entry.view = replace(entry.view, status=value)
        entry.payloads[topic] = looks
        self._pass_on(arrival)
        self._tell(Update(entry.view.vehicle, value))

    def _give_observations(
        self,
        entry: Entry,
        batches: list[wire.ObservationBatch],
        arrival: Arrival,
        came: wire.ObservationBatch | None,
    ) -> None:
        for batch in batches:
            with self._changed:
                for one in batch.items:
                    entry.track.append(one)
            self._pass_on(arrival if batch is came else _as_arrived(arrival, batch))
            self._tell(Update(entry.view.vehicle, batch.items))

    def _give_lines(
        self, entry: Entry, batches: list[wire.LogBatch], arrival: Arrival, came: wire.LogBatch | None
    ) -> None:
        for batch in batches:
            self._pass_on(arrival if batch is came else _as_arrived(arrival, batch))
            for line in batch.items:
                self._tell(Update(entry.view.vehicle, line))

    def _pass_on(self, arrival: Arrival) -> None:
        if self._on_arrival is not None:
            self._on_arrival(arrival.received_utc_s, arrival.key, arrival.encoding, arrival.payload)

    def _tell(self, update: Update) -> None:
        if self._on_update is not None:
            self._on_update(update)
        with self._changed:
            self._updates += 1
            self._changed.notify_all()

    def _count(self, received: int = 0, refused: int = 0, dropped: int = 0) -> None:
        with self._changed:
            self._counters = replace(
                self._counters,
                received=self._counters.received + received,
                refused=self._counters.refused + refused,
                dropped=self._counters.dropped + dropped,
            )
            self._updates += 1
            self._changed.notify_all()


def _as_arrived(arrival: Arrival, batch: wire.ObservationBatch | wire.LogBatch) -> Arrival:
    """A batch that was kept back, or of which some was known, as if it had come now and so."""
    topic = Topic.OBSERVATIONS if isinstance(batch, wire.ObservationBatch) else Topic.LOG
    encoding = f"application/cbor;{wire.schema(topic)}"
    return replace(arrival, encoding=encoding, payload=wire.encode(batch))
