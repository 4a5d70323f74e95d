"""Following vehicles: the latest of everything they publish, and the last model at once when joining."""

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import zenoh

from autonomy import wire
from autonomy.effects import Topic
from autonomy.endpoints import Certificates, session_settings
from autonomy.zenoh_session import zenoh_config

log = logging.getLogger(__name__)

_MAXIMUM_VEHICLES = 64
_QUEUE_LIMIT = 10_000
_QUERY_TIMEOUT_S = 2.0
_RETRY_S = 1.0
_TOPICS = {topic.value: topic for topic in Topic}


@dataclass(frozen=True)
class Presence:
    """A vehicle's software appeared (or came back) on the network, or left it."""

    alive: bool


@dataclass(frozen=True)
class Update:
    """One thing that has come in from one vehicle."""

    vehicle: str
    value: wire.Received | Presence


@dataclass(frozen=True)
class VehicleView:
    """The latest of everything one vehicle has published; None where nothing has come yet.

    `model_received_s` is this process's monotonic clock when the model came in.
    """

    vehicle: str
    alive: bool = False
    model: wire.ModelSnapshot | None = None
    model_received_s: float | None = None
    plan: wire.PlanNotice | None = None
    health: wire.HealthNotice | None = None


_REMEMBERED = 4 * wire.MAXIMUM_OBSERVATIONS
"""Observations of a vehicle by which doubles are told: twice what it has on its way at a time."""


@dataclass(frozen=True)
class Counters:
    """Messages decoded, refused as not what their key promises, and dropped because we were too slow."""

    received: int = 0
    refused: int = 0
    dropped: int = 0


@dataclass(frozen=True)
class _Arrival:
    """A sample as zenoh handed it over. `query` numbers the query it answers, None if it came by itself."""

    key: str
    payload: bytes
    query: int | None = None
    alive: bool | None = None


class Subscriber:
    """Follows one vehicle, or all of them, from a thread of its own; use it as a context manager.

    Whenever a vehicle appears (also again, after its or the router's restart) its last values are asked for,
    so that a late joiner needn't wait for the next. What others send is decoded with bounds: anything that
    isn't what its key promises is counted and logged, never raised.

    Args:
        vehicle: name, or "*" for all.
        connect: endpoints of routers to be a client of; dialled until one is there.
        listen: endpoints at which to be the router itself. One of the two must be given, not both.
        on_update: called with every update in the subscriber's thread, after the latest values have changed.
        track_limit: observations kept per vehicle.
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
        track_limit: int = 20_000,
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
        self._track_limit = track_limit
        self._arrivals: queue.Queue[_Arrival] = queue.Queue(_QUEUE_LIMIT)
        self._stopping = threading.Event()
        self._changed = threading.Condition()
        self._views: dict[str, VehicleView] = {}
        self._tracks: dict[str, deque[wire.ObservationNotice]] = {}
        self._recent: dict[str, dict[tuple[float, float, float], None]] = {}
        self._counters = Counters()
        self._outdated: set[str] = set()
        self._updates = 0
        self._queries = 0
        self._live_since: dict[tuple[str, Topic], int] = {}
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
            return sorted(self._views)

    def latest(self, vehicle: str) -> VehicleView:
        """The latest values of a vehicle (all None if it hasn't been heard)."""
        with self._changed:
            return self._views.get(vehicle, VehicleView(vehicle))

    def track(self, vehicle: str) -> list[wire.ObservationNotice]:
        """The observations heard, oldest first."""
        with self._changed:
            return list(self._tracks.get(vehicle, ()))

    @property
    def counters(self) -> Counters:
        """What has come in since the start."""
        with self._changed:
            return self._counters

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
                try:
                    arrival = self._arrivals.get(timeout=0.1)
                except queue.Empty:
                    continue
                self._take(session, arrival)

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

    def _arrive(self, arrival: _Arrival) -> None:
        try:
            self._arrivals.put_nowait(arrival)
        except queue.Full:
            self._count(dropped=1)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        # The size is looked at before anything is copied.
        if sample.kind == zenoh.SampleKind.PUT and len(sample.payload) <= wire.MAXIMUM_BYTES:
            self._arrive(_Arrival(str(sample.key_expr), bytes(sample.payload)))
        else:
            self._count(refused=1)

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._arrive(_Arrival(str(sample.key_expr), b"", alive=sample.kind == zenoh.SampleKind.PUT))

    def _on_reply(self, reply: zenoh.Reply, query: int) -> None:
        if reply.ok is not None and len(reply.ok.payload) <= wire.MAXIMUM_BYTES:
            self._arrive(_Arrival(str(reply.ok.key_expr), bytes(reply.ok.payload), query=query))

    def _take(self, session: zenoh.Session, arrival: _Arrival) -> None:
        try:
            vehicle, last = wire.split_key(arrival.key)
            if len(self._views) >= _MAXIMUM_VEHICLES and vehicle not in self._views:
                raise wire.WireError(f"{arrival.key}: more than {_MAXIMUM_VEHICLES} vehicles")
            if arrival.alive is not None:
                self._presence(session, vehicle, arrival.alive)
                return
            if last not in _TOPICS:
                raise wire.WireError(f"{arrival.key}: must end in {', '.join(_TOPICS)}")
            topic = _TOPICS[last]
            value = wire.decode(topic, arrival.payload)
            if isinstance(value, wire.ModelSnapshot) and value.vehicle != vehicle:
                raise wire.WireError(f"{arrival.key}: is a model of {value.vehicle}")
        except wire.VersionError as error:
            if arrival.key not in self._outdated and len(self._outdated) < _MAXIMUM_VEHICLES * len(_TOPICS):
                self._outdated.add(arrival.key)
                log.warning("refused from now on (said once): %s: %s", arrival.key, error)
            self._count(refused=1)
            return
        except wire.WireError as error:
            log.warning("refused: %s", error)
            self._count(refused=1)
            return
        self._keep(vehicle, topic, value, arrival.query)

    def _presence(self, session: zenoh.Session, vehicle: str, alive: bool) -> None:
        if alive:
            self._queries += 1
            session.get(
                f"usv/{vehicle}/*",
                partial(self._on_reply, query=self._queries),
                timeout=_QUERY_TIMEOUT_S,
                # Keeps every answer: values of different topics, never of different times.
                consolidation=zenoh.ConsolidationMode.NONE,
            )
        with self._changed:
            view = self._views.get(vehicle, VehicleView(vehicle))
            self._views[vehicle] = replace(view, alive=alive)
        self._tell(Update(vehicle, Presence(alive)))

    def _keep(self, vehicle: str, topic: Topic, value: wire.Received, query: int | None) -> None:
        if query is None:
            self._live_since[vehicle, topic] = self._queries
        elif self._live_since.get((vehicle, topic), -1) >= query:
            # What came by itself since we asked is at least as new as the answer.
            return
        with self._changed:
            view = self._views.get(vehicle, VehicleView(vehicle))
            self._counters = replace(self._counters, received=self._counters.received + 1)
            match value:
                case wire.ModelSnapshot():
                    if _same(view.model, value):
                        return
                    view = replace(view, model=value, model_received_s=time.monotonic())
                case wire.PlanNotice():
                    view = replace(view, plan=value)
                case wire.HealthNotice():
                    view = replace(view, health=value)
                case tuple():
                    value = self._fresh(vehicle, value)
                    if not value:
                        return
                    self._tracks.setdefault(vehicle, deque(maxlen=self._track_limit)).extend(value)
            self._views[vehicle] = view
        self._tell(Update(vehicle, value))

    def _fresh(
        self, vehicle: str, heard: tuple[wire.ObservationNotice, ...]
    ) -> tuple[wire.ObservationNotice, ...]:
        """Those not heard before: after a broken link the vehicle sends again what may not have arrived."""
        known = self._recent.setdefault(vehicle, {})
        fresh = []
        for one in heard:
            reading = (one.model_time_s, one.lat_deg, one.lon_deg)
            if reading not in known:
                known[reading] = None
                fresh.append(one)
        for oldest in list(known)[: max(0, len(known) - _REMEMBERED)]:
            del known[oldest]
        return tuple(fresh)

    def _tell(self, update: Update) -> None:
        if self._on_update is not None:
            self._on_update(update)
        with self._changed:
            self._updates += 1
            self._changed.notify_all()

    def _count(self, refused: int = 0, dropped: int = 0) -> None:
        with self._changed:
            self._counters = replace(
                self._counters,
                refused=self._counters.refused + refused,
                dropped=self._counters.dropped + dropped,
            )
            self._updates += 1
            self._changed.notify_all()


def _same(held: wire.ModelSnapshot | None, came: wire.ModelSnapshot) -> bool:
    return held is not None and (held.sequence, held.model_time_s) == (came.sequence, came.model_time_s)
