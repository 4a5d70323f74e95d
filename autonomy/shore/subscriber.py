"""Following vehicles: the latest of everything they publish, and what they told in order without a gap."""

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import zenoh

from autonomy import wire
from autonomy.effects import Topic
from autonomy.endpoints import Certificates, session_settings
from autonomy.observation_ring import notices
from autonomy.shore.inbox import Arrival, Inbox
from autonomy.shore.roster import MAXIMUM_VEHICLES, Entry, Roster, VehicleView
from autonomy.shore.streams import Stream
from autonomy.wire_questions import Piece
from autonomy.zenoh_session import zenoh_config

__all__ = ["Counters", "OnArrival", "Presence", "Subscriber", "Update", "VehicleView"]

log = logging.getLogger(__name__)

OnArrival = Callable[[float, str, str, bytes], None]
"""Called with the time of receipt (seconds since 1970), key, encoding and payload of a message."""

_QUEUE_LIMIT = 10_000
_QUEUE_BYTES = 256 * 2**20
_QUERY_TIMEOUT_S = 60.0
_RETRY_S = 1.0
_SWEEP_S = 0.2
_ROLL_CALL_S = 20.0
_TOPICS = {topic.value: topic for topic in Topic}


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

    Whenever a vehicle appears (also again, after its or the router's restart) its last values are asked for,
    so that a late joiner needn't wait for the next. Observations and lines of the log are given on in order, none
    twice, and those that did not come are asked for. What others send is decoded with bounds: anything that isn't what
    its key promises is counted and logged, never raised.

    Args:
        vehicle: name, or "*" for all.
        connect: endpoints of routers to be a client of; dialled until one is there.
        listen: endpoints at which to be the router itself. One of the two must be given, not both.
        on_update: called with every update in the subscriber's thread, after the latest values have changed.
        on_arrival: called with every message as it came, in the same thread and before `on_update`: models, plans,
            health and the like when they are new, observations and lines in order and none twice.
        track_limit: observations kept per vehicle.
        history: observations wanted of those that a vehicle told before we came; None: all that it keeps.
        log_history: the same of lines of its log.
        certificates: for addresses that begin with tls/ or quic/.

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
    ) -> None:
        if vehicle != "*" and not wire.VEHICLE_NAME.fullmatch(vehicle):
            raise ValueError(f"not a vehicle: {vehicle!r}: must be * or match {wire.VEHICLE_NAME.pattern}")
        if bool(connect) == bool(listen):
            raise ValueError("either connect to a router or listen as one")
        mode: Literal["router", "client"] = "router" if listen else "client"
        self._settings = session_settings(mode, connect=connect, listen=listen, certificates=certificates)
        self._listen = list(listen)
        self._selector = vehicle
        self._on_update = on_update
        self._on_arrival = on_arrival
        self._inbox = Inbox(_QUEUE_LIMIT, _QUEUE_BYTES)
        self._roster = Roster(track_limit, history, log_history)
        self._stopping = threading.Event()
        self._changed = threading.Condition()
        self._counters = Counters()
        self._outdated: set[str] = set()
        self._updates = 0
        self._queries = 0
        self._swept_s = self._called_s = 0.0
        self._session: zenoh.Session | None = None
        self._thread = threading.Thread(target=self._run, name="subscriber", daemon=True)

    def __enter__(self) -> "Subscriber":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def start(self) -> None:
        """Open the session: at once as a router, in the thread (which waits for a router) as a client."""
        if self._listen:
            try:
                self._session = zenoh.open(zenoh_config(self._settings))
            except zenoh.ZError as error:
                raise OSError(f"cannot listen at {', '.join(self._listen)}: {error}") from error
        self._thread.start()

    def close(self, timeout_s: float = 5.0) -> None:
        """End the thread and close the session, within the timeout; a dial under way ends by itself."""
        self._stopping.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s if self._session is not None else 0.1)

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
        session = self._session or self._dial()
        if session is None:
            return
        self._session = session
        with (
            session,
            session.declare_subscriber(f"usv/{self._selector}/*", self._on_sample),
            session.liveliness().declare_subscriber(
                wire.alive_key(self._selector), self._on_token, history=True
            ),
        ):
            while not self._stopping.is_set():
                arrival = self._inbox.take(timeout_s=0.1)
                if arrival is not None:
                    self._take(session, arrival)
                self._sweep(session)

    def _dial(self) -> zenoh.Session | None:
        """A client's session; zenoh raises while there is no router."""
        complained = False
        while not self._stopping.is_set():
            try:
                return zenoh.open(zenoh_config(self._settings))
            except zenoh.ZError as error:
                if not complained:
                    log.info("no router yet (%s); dialling on", error)
                complained = True
            self._stopping.wait(_RETRY_S)
        return None

    def _arrive(self, key: str, **details: Any) -> None:
        if not self._inbox.put(Arrival(key, time.time(), **details)):
            self._count(dropped=1)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        # The size is looked at before anything is copied.
        if sample.kind == zenoh.SampleKind.PUT and len(sample.payload) <= wire.MAXIMUM_BYTES:
            self._arrive(str(sample.key_expr), encoding=str(sample.encoding), payload=bytes(sample.payload))
        else:
            self._count(refused=1)

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._arrive(str(sample.key_expr), alive=sample.kind == zenoh.SampleKind.PUT)

    def _on_roll_call(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._arrive(str(reply.ok.key_expr), alive=True, roll_call=True)

    def _on_reply(self, reply: zenoh.Reply, query: int, piece: Piece | None) -> None:
        sample = reply.ok
        if sample is not None and len(sample.payload) <= wire.MAXIMUM_BYTES:
            self._arrive(
                str(sample.key_expr),
                encoding=str(sample.encoding),
                payload=bytes(sample.payload),
                query=query,
                piece=piece,
            )

    def _take(self, session: zenoh.Session, arrival: Arrival) -> None:
        try:
            vehicle, last = wire.split_key(arrival.key)
            if arrival.alive is not None:
                known = self._roster.get(vehicle)
                if not (arrival.roll_call and known is not None and known.view.alive):
                    self._presence(session, vehicle, arrival.alive)
                return
            if last not in _TOPICS:
                raise wire.WireError(f"{arrival.key}: must end in {', '.join(_TOPICS)}")
            topic = _TOPICS[last]
            if arrival.closed:
                self._closed(vehicle, topic, arrival)
                return
            value = wire.decode(topic, arrival.payload)
            if isinstance(value, wire.ModelSnapshot) and value.vehicle != vehicle:
                raise wire.WireError(f"{arrival.key}: is a model of {value.vehicle}")
            with self._changed:
                entry = self._roster.entry(vehicle)
            self._keep(entry, topic, value, arrival)
            self._ask(session, entry)
        except wire.VersionError as error:
            if arrival.key not in self._outdated and len(self._outdated) < MAXIMUM_VEHICLES * len(_TOPICS):
                self._outdated.add(arrival.key)
                log.warning("refused from now on (said once): %s: %s", arrival.key, error)
            self._count(refused=1)
        except wire.WireError as error:
            log.warning("refused: %s", error)
            self._count(refused=1)

    def _presence(self, session: zenoh.Session, vehicle: str, alive: bool) -> None:
        with self._changed:
            entry = self._roster.entry(vehicle, has_token=alive)
            entry.view = replace(entry.view, alive=alive)
            entry.was_alive = entry.was_alive or alive
        if alive:
            self._get(session, f"usv/{vehicle}/*", None, None)
            entry.observations.greet()
            entry.lines.greet()
            self._ask(session, entry)
        self._tell(Update(vehicle, Presence(alive)))

    def _sweep(self, session: zenoh.Session) -> None:
        """Look now and then whether a vehicle is to be asked for anything."""
        now = time.monotonic()
        if now >= self._swept_s + _SWEEP_S:
            self._swept_s = now
            for entry in self._roster:
                self._ask(session, entry)
        if now >= self._called_s + _ROLL_CALL_S:
            # After a break in the line a token is not always told again.
            self._called_s = now
            session.liveliness().get(
                wire.alive_key(self._selector), self._on_roll_call, timeout=_ROLL_CALL_S / 2.0
            )

    def _ask(self, session: zenoh.Session, entry: Entry) -> None:
        """Ask a vehicle for what is missing of what it told in order, unless it is known to be gone."""
        if entry.was_alive and not entry.view.alive:
            return
        now = time.monotonic()
        streams: tuple[tuple[Topic, Stream[Any]], ...]
        streams = ((Topic.OBSERVATIONS, entry.observations), (Topic.LOG, entry.lines))
        for topic, stream in streams:
            piece = stream.question(now)
            if piece is not None:
                name = wire.key(entry.view.vehicle, topic)
                self._get(session, f"{name}?{piece.parameters}", name, piece)

    def _get(self, session: zenoh.Session, selector: str, closes: str | None, piece: Piece | None) -> None:
        """Send a question; the answers arrive as if by themselves, and their end too if `closes` is their key."""
        self._queries += 1
        on_reply = partial(self._on_reply, query=self._queries, piece=piece)
        on_end = None if closes is None else partial(self._arrive, closes, closed=True, piece=piece)
        session.get(
            selector,
            zenoh.handlers.Callback(on_reply, on_end),
            timeout=_QUERY_TIMEOUT_S,
            # Also storages on the way may have something; what is no news is left out here.
            target=zenoh.QueryTarget.ALL,
            # Keeps every answer: values of different topics, never of different times.
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def _closed(self, vehicle: str, topic: Topic, arrival: Arrival) -> None:
        entry = self._roster.get(vehicle)
        if entry is None or arrival.piece is None:
            return
        if topic is Topic.OBSERVATIONS:
            self._give_observations(entry, entry.observations.closed(arrival.piece), arrival, None)
        elif topic is Topic.LOG:
            self._give_lines(entry, entry.lines.closed(arrival.piece), arrival, None)

    def _keep(self, entry: Entry, topic: Topic, value: wire.Message, arrival: Arrival) -> None:
        if arrival.query is None:
            entry.live_since[topic] = self._queries
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
        with self._changed:
            match value:
                case wire.ModelSnapshot():
                    if _same(entry.view.model, value):
                        return
                    self._roster.keep_model(entry, value, time.monotonic())
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


def _same(held: wire.ModelSnapshot | None, came: wire.ModelSnapshot) -> bool:
    return held is not None and (held.sequence, held.model_time_s) == (came.sequence, came.model_time_s)
