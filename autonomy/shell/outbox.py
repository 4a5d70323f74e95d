"""What is to go ashore, and in which order: the newest of some things, all of others. Knows nothing of the network."""

import logging
import threading
from collections.abc import Collection
from dataclasses import dataclass, replace

from autonomy import digest, wire
from autonomy.digesting import digest_of
from autonomy.effects import Topic
from autonomy.learning.snapshot import PRECISIONS, Precision
from autonomy.shell.backlog import Lines, Observations
from autonomy.shell.rate_limit import RateLimit

log = logging.getLogger(__name__)

LATEST_WINS = (Topic.HEALTH, Topic.STATUS, Topic.PLAN, Topic.SURVEY, Topic.MODEL)
"""Of these only the newest counts; in the order in which they go."""
NUMBERED = (Topic.LOG, Topic.OBSERVATIONS)
"""Of these all that is kept can be had."""

SHARES = {Topic.HEALTH: 0.15, Topic.MODEL: 0.45}
"""Of a limited rate, what these may take at most. Plan, survey and status are rare; the others have the rest."""
MODEL_S = 16.0
"""On a limited link a model may take so long, if there is a precision at which it does; the newest is never older than
twice that, and the wait for its turn."""
PIECE_S = 4.0
"""So long a piece of the observations or the log takes on a limited link: nothing more urgent waits for longer."""
GATHER_S = 10.0
"""On a limited link observations and lines go together, as many as have come in so long: singly they cost thrice."""
INDUCING = 300
"""Places at which a map goes over a limited link, at most: the largest basis, for bits are cheaper than places. Half of
them, and half of those, only if it would take too long still: a map that needs 200 is off by a tenth of σf at 100."""
_FEWEST_INDUCING = 25
_ROOMY = 0.4


@dataclass(frozen=True)
class Parcel:
    """A payload on its way."""

    topic: Topic
    payload: bytes


class Outbox:
    """Takes values from any thread and hands payloads to one.

    Args:
        run: number of this run of the software.
        observations: how many observations are kept.
        lines: how many lines of the log are kept.
        precision: that models go out with; on a limited link the best that is quick enough, and no better than this.
        limit: what the link can take.
    """

    def __init__(
        self, run: int, observations: int, lines: int, precision: Precision, limit: RateLimit
    ) -> None:
        self._lock = threading.Lock()
        self._run = run
        self._precision = precision
        self._limit = limit
        self._waiting: set[Topic] = set()
        self._latest: dict[Topic, wire.Message] = {}
        self._encoded: dict[Topic, tuple[wire.Message, bytes]] = {}
        self._not_before: dict[Topic, float] = {}
        self._coarseness = 0
        self.observations = Observations(run, observations)
        self.lines = Lines(run, lines)
        self.refused = 0
        """Values that could not be encoded."""

    @property
    def dropped(self) -> dict[str, int]:
        """What was thrown away before anybody heard it, by topic's name."""
        return {
            Topic.OBSERVATIONS.value: self.observations.dropped,
            Topic.LOG.value: self.lines.dropped,
        }

    def offer(self, topic: Topic, value: wire.Payload) -> None:
        """Take a value; returns at once."""
        match value:
            case tuple():
                self.observations.add(self._writable(value))
            case wire.ObservationNotice():
                self.observations.add(self._writable((value,)))
            case wire.LogNotice():
                if self._written(wire.LogBatch(0, 0, 0, 1, (value,))) is not None:
                    self.lines.add(value)
            case _:
                with self._lock:
                    self._waiting.add(topic)
                    self._latest[topic] = value

    def due_in_s(self, now: float, listened: Collection[Topic]) -> float | None:
        """When `next` will have something for those who listen to these topics; None if nothing waits for them."""
        with self._lock:
            waiting = [topic for topic in self._waiting if topic in listened]
        waiting += [topic for topic in NUMBERED if topic in listened and self._store(topic).is_behind]
        if not waiting:
            return None
        turn = min(self._not_before.get(topic, now) for topic in waiting) - now
        return max(0.0, turn, self._limit.wait_s(now))

    def next(self, now: float, listened: Collection[Topic]) -> Parcel | None:
        """What goes now to those who listen to these topics, which counts as sent; None if nothing does.

        What nobody listens to is not sent: whoever comes later asks for it.
        """
        for topic in NUMBERED:
            if topic not in listened:
                self._store(topic).skip()
        if self._limit.wait_s(now) > 0.0:
            return None
        for topic in (*LATEST_WINS, *NUMBERED):
            payload = None if now < self._not_before.get(topic, now) else self._take(topic, listened)
            if payload is not None:
                self._limit.spend(len(payload))
                self._rest(topic, now, payload)
                return Parcel(topic, payload)
        return None

    @property
    def has_health(self) -> bool:
        """Whether there is anything to make a digest of."""
        return Topic.HEALTH in self._latest

    def digest(self, vehicle: str) -> None:
        """Offer a digest of what was offered before; there must be health."""
        with self._lock:
            newest = dict(self._latest)
        health, plan, survey = newest.get(Topic.HEALTH), newest.get(Topic.PLAN), newest.get(Topic.SURVEY)
        assert isinstance(health, wire.HealthNotice)
        try:
            told = digest_of(
                vehicle,
                health,
                self.newest_model,
                plan if isinstance(plan, wire.PlanNotice) else None,
                survey if isinstance(survey, wire.SurveyNotice) else None,
            )
            self.offer(Topic.STATUS, wire.StatusDigest(digest.encode(told)))
        except ValueError as error:
            log.warning("no digest: %s", error)

    @property
    def newest_model(self) -> wire.ModelSnapshot | None:
        """As it is on board, None while there is none."""
        with self._lock:
            newest = self._latest.get(Topic.MODEL)
        return newest if isinstance(newest, wire.ModelSnapshot) else None

    def latest(self, topic: Topic) -> bytes | None:
        """The payload of the newest of a topic; None if there is none that can be encoded."""
        with self._lock:
            value = self._latest.get(topic)
        if value is None:
            return None
        known = self._encoded.get(topic)
        if known is not None and known[0] is value:
            return known[1]
        match value:
            case wire.HealthNotice():
                ends = (self.observations.sent, self.lines.sent)
                told = replace(value, run=self._run, observations_end=ends[0], log_end=ends[1])
                payload = self._written(told)
            case wire.ModelSnapshot():
                payload = self._model(replace(value, run=self._run))
            case wire.PlanNotice():
                payload = self._written(replace(value, run=self._run))
            case _:
                payload = self._written(value)
        if payload is not None:
            self._encoded[topic] = (value, payload)
        return payload

    def piece(self, topic: Topic, first: int, count: int) -> bytes:
        """Observations or lines from a number on, at most so many and one payload full."""
        most = count
        if self._limit.bytes_per_s is not None:
            each = 25 if topic is Topic.OBSERVATIONS else 60
            most = min(count, max(1, int(PIECE_S * self._limit.bytes_per_s / each)))
        return self._bytes(self._store(topic).batch(first, most))

    def _store(self, topic: Topic) -> Observations | Lines:
        return self.lines if topic is Topic.LOG else self.observations

    def _take(self, topic: Topic, listened: Collection[Topic]) -> bytes | None:
        if topic in NUMBERED:
            store = self._store(topic)
            behind = topic in listened and store.is_behind
            return self.piece(topic, store.sent, store.end - store.sent) if behind else None
        with self._lock:
            waiting = topic in self._waiting
            self._waiting.discard(topic)
        return self.latest(topic) if waiting and topic in listened else None

    def _rest(self, topic: Topic, now: float, payload: bytes) -> None:
        """On a limited link, when a topic has its turn again."""
        if self._limit.bytes_per_s is None:
            return
        if topic in SHARES:
            self._not_before[topic] = now + self._limit.worth_s(len(payload)) / SHARES[topic]
        elif topic in NUMBERED and not self._store(topic).is_behind:
            self._not_before[topic] = now + GATHER_S

    def _model(self, snapshot: wire.ModelSnapshot) -> bytes | None:
        """At the best precision at which it is quick enough; if there was much room, the next tries a better one."""
        if self._limit.bytes_per_s is None:
            return self._written(replace(snapshot, precision=self._precision))
        ladder = _ladder(self._precision)
        while True:
            precision, inducing = ladder[self._coarseness]
            payload = self._written(replace(snapshot, precision=precision), inducing)
            if payload is None:
                return None
            takes_s = self._limit.worth_s(len(payload))
            if takes_s <= MODEL_S or self._coarseness == len(ladder) - 1:
                if takes_s < _ROOMY * MODEL_S:
                    self._coarseness = max(0, self._coarseness - 1)
                return payload
            self._coarseness += 1

    def _writable(self, notices: tuple[wire.ObservationNotice, ...]) -> list[wire.ObservationNotice]:
        """Those that can be written: one that cannot must not take those with it whose batch it shares."""
        return [
            one for one in notices if self._written(wire.ObservationBatch(0, 0, 0, 1, (one,))) is not None
        ]

    def _written(self, message: wire.Message, inducing: int | None = None) -> bytes | None:
        try:
            return self._bytes(message, inducing)
        except wire.WireError as error:
            log.warning("not published: %s", error)
            self.refused += 1
            return None

    def _bytes(self, message: wire.Message, inducing: int | None = None) -> bytes:
        return wire.encode(message, packed=self._limit.bytes_per_s is not None, inducing=inducing)


def _ladder(precision: Precision) -> list[tuple[Precision, int | None]]:
    """Ways to send a model over a limited link, each smaller than the one before."""
    steps: list[tuple[Precision, int | None]] = []
    for each in PRECISIONS[PRECISIONS.index(precision) :]:
        steps.append((each, None if each == "lossless" else INDUCING))
    fewer = INDUCING // 2
    while fewer >= _FEWEST_INDUCING:
        steps.append((PRECISIONS[-1], fewer))
        fewer //= 2
    return steps
