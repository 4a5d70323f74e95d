"""What is to go ashore, and in which order: the newest of some things, all of others. Knows nothing of the network."""

import logging
import threading
from collections.abc import Collection
from dataclasses import dataclass, replace

from autonomy import wire
from autonomy.effects import Topic
from autonomy.shell.backlog import Lines, Observations

log = logging.getLogger(__name__)

LATEST_WINS = (Topic.HEALTH, Topic.STATUS, Topic.SURVEY, Topic.PLAN, Topic.MODEL)
"""Of these only the newest counts; in the order in which they go."""
NUMBERED = (Topic.LOG, Topic.OBSERVATIONS)
"""Of these all that is kept can be had."""


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
    """

    def __init__(self, run: int, observations: int, lines: int) -> None:
        self._lock = threading.Lock()
        self._run = run
        self._waiting: dict[Topic, wire.Message] = {}
        self._latest: dict[Topic, wire.Message] = {}
        self._encoded: dict[Topic, tuple[wire.Message, bytes]] = {}
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
                    self._waiting[topic] = value
                    self._latest[topic] = value

    def has_work(self, listened: Collection[Topic]) -> bool:
        """Whether `next` has anything for those who listen to these topics."""
        return any(topic in listened for topic in list(self._waiting)) or any(
            store.sent < store.end
            for topic, store in ((Topic.LOG, self.lines), (Topic.OBSERVATIONS, self.observations))
            if topic in listened
        )

    def next(self, listened: Collection[Topic]) -> Parcel | None:
        """What goes next to those who listen to these topics; None if nothing does.

        What nobody listens to is not sent: whoever comes later asks for it.
        """
        for topic in LATEST_WINS:
            with self._lock:
                waiting = self._waiting.pop(topic, None) is not None
            payload = self.latest(topic) if waiting and topic in listened else None
            if payload is not None:
                return Parcel(topic, payload)
        for topic in NUMBERED:
            store = self.lines if topic is Topic.LOG else self.observations
            if topic not in listened:
                store.skip()
            elif store.sent < store.end:
                return Parcel(topic, self.piece(topic, store.sent, store.end - store.sent))
        return None

    def latest(self, topic: Topic) -> bytes | None:
        """The payload of the newest of a topic; None if there is none that can be encoded."""
        with self._lock:
            value = self._latest.get(topic)
        if value is None:
            return None
        known = self._encoded.get(topic)
        if known is not None and known[0] is value:
            return known[1]
        if isinstance(value, wire.HealthNotice):
            ends = (self.observations.sent, self.lines.sent)
            told: wire.Message = replace(value, run=self._run, observations_end=ends[0], log_end=ends[1])
        else:
            told = value
        payload = self._written(told)
        if payload is not None:
            self._encoded[topic] = (value, payload)
        return payload

    def piece(self, topic: Topic, first: int, count: int) -> bytes:
        """Observations or lines from a number on, at most so many and one payload full."""
        store = self.lines if topic is Topic.LOG else self.observations
        return wire.encode(store.batch(first, count))

    def _writable(self, notices: tuple[wire.ObservationNotice, ...]) -> list[wire.ObservationNotice]:
        """Those that can be written: one that cannot must not take those with it whose batch it shares."""
        return [
            one for one in notices if self._written(wire.ObservationBatch(0, 0, 0, 1, (one,))) is not None
        ]

    def _written(self, message: wire.Message) -> bytes | None:
        try:
            return wire.encode(message)
        except wire.WireError as error:
            log.warning("not published: %s", error)
            self.refused += 1
            return None
