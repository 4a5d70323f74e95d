"""Outages of the router and of subscribers: nothing lost, nothing twice, in order, for each listener by himself.

HALOCLINE_OUTAGE_S sets how long an outage lasts (2 s, unless set); the long form takes 5, 60 and 600.
"""

import contextlib
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from autonomy import wire
from autonomy.effects import Topic
from autonomy.shell.publisher import Publisher
from autonomy.shore.subscriber import Subscriber

sys.path.insert(0, str(Path(__file__).parent))
from bad_line import BadLine
from shore_helpers import SOON_S, free_endpoint, observation, publisher, router, session

pytestmark = [pytest.mark.process, pytest.mark.timeout(1500)]

OUTAGE_S = float(os.environ.get("HALOCLINE_OUTAGE_S", "2"))
EVERY_S = 0.05
HEARD_S = SOON_S + OUTAGE_S


class Boat:
    """Publishes a reading every EVERY_S and a line of the log for every tenth, from a thread."""

    def __init__(self, publisher: Publisher) -> None:
        self._publisher = publisher
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.made = 0

    def __enter__(self) -> "Boat":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.anchor()

    def anchor(self) -> None:
        """No more readings."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.wait(EVERY_S):
            self._publisher.publish(Topic.OBSERVATIONS, observation(self.made % 5000))
            if self.made % 10 == 0:
                self._publisher.publish(Topic.LOG, wire.LogNotice("info", str(self.made)))
            self.made += 1


class Ear:
    """What a subscriber was given: by `on_update`, and as bytes by `on_arrival`."""

    def __init__(self) -> None:
        self.readings: list[wire.ObservationNotice] = []
        self.lines: list[str] = []
        self.recorded: list[wire.Message] = []

    def update(self, update) -> None:
        match update.value:
            case tuple():
                self.readings += update.value
            case wire.LogNotice():
                self.lines.append(update.value.text)

    def arrival(self, _received_utc_s: float, key: str, _encoding: str, payload: bytes) -> None:
        topic = Topic(key.rsplit("/", 1)[-1])
        if topic in (Topic.OBSERVATIONS, Topic.LOG):
            self.recorded.append(wire.decode(topic, payload))

    def heard_all(self, count: int):
        return lambda _shore: len(self.readings) >= count and len(self.lines) >= (count + 9) // 10


@contextlib.contextmanager
def listening(endpoint: str) -> Iterator[tuple[Ear, Subscriber]]:
    ear = Ear()
    with Subscriber(
        "boat1",
        connect=[endpoint],
        on_update=ear.update,
        on_arrival=ear.arrival,
        history=None,
        log_history=None,
    ) as shore:
        yield ear, shore


def check(ear: Ear, shore: Subscriber, count: int) -> None:
    """All of them, each once, in order; and so what a recorder was given."""
    assert shore.wait_for(ear.heard_all(count), HEARD_S), (len(ear.readings), len(ear.lines), count)
    assert ear.readings == [observation(number % 5000) for number in range(count)]
    assert ear.lines == [str(number) for number in range(0, count, 10)]
    for kind in (wire.ObservationBatch, wire.LogBatch):
        batches = [each for each in ear.recorded if isinstance(each, kind)]
        numbers = [each.first + k for each in batches for k in range(len(each.items))]
        assert numbers == list(range(len(numbers)))
    assert shore.counters.missed == 0


def pass_by(seconds: float) -> None:
    threading.Event().wait(seconds)


def test_an_outage_of_the_router():
    endpoint = free_endpoint()
    with (
        publisher(endpoint, backlog=50_000) as boat,
        Boat(boat) as at_sea,
        listening(endpoint) as (ear, shore),
    ):
        for _ in range(2):
            with router(endpoint):
                assert shore.wait_for(ear.heard_all(at_sea.made + 20), SOON_S)
            pass_by(OUTAGE_S)
        with router(endpoint):
            assert shore.wait_for(ear.heard_all(at_sea.made + 20), HEARD_S)
            at_sea.anchor()
            check(ear, shore, at_sea.made)


@pytest.mark.parametrize("way", ["cut", "silence"])
def test_of_two_listeners_one_is_away(way):
    """Cut off so that both ends notice at once, or so that nothing comes any more; and a third who comes late."""
    endpoint = free_endpoint()
    with (
        router(endpoint),
        BadLine(endpoint) as line,
        publisher(endpoint, backlog=50_000) as boat,
        Boat(boat) as at_sea,
        listening(endpoint) as (stays, there),
        listening(line.endpoint) as (leaves, other),
    ):
        assert other.wait_for(leaves.heard_all(20), SOON_S)
        getattr(line, way)()
        pass_by(OUTAGE_S)
        line.mend()
        with listening(endpoint) as (late, latecomer):
            assert other.wait_for(leaves.heard_all(at_sea.made + 20), HEARD_S)
            at_sea.anchor()
            for ear, shore in ((stays, there), (leaves, other), (late, latecomer)):
                check(ear, shore, at_sea.made)


def test_the_boat_is_cut_off():
    endpoint = free_endpoint()
    with (
        router(endpoint),
        BadLine(endpoint) as line,
        publisher(line.endpoint, backlog=50_000) as boat,
        Boat(boat) as at_sea,
        listening(endpoint) as (ear, shore),
    ):
        assert shore.wait_for(ear.heard_all(20), SOON_S)
        line.cut()
        pass_by(OUTAGE_S)
        line.mend()
        assert shore.wait_for(ear.heard_all(at_sea.made + 20), HEARD_S)
        at_sea.anchor()
        check(ear, shore, at_sea.made)


def test_a_chain_of_routers_is_as_one():
    """The boat's router dials the shore's; who comes late and behind both still gets everything."""
    harbour, shore_at = free_endpoint(), free_endpoint()
    with (
        router(shore_at),
        session("router", connect=[shore_at], listen=[harbour]),
        publisher(harbour) as boat,
        Boat(boat) as at_sea,
        listening(shore_at) as (early, first),
    ):
        assert first.wait_for(early.heard_all(20), SOON_S)
        with listening(shore_at) as (late, second):
            assert second.wait_for(late.heard_all(at_sea.made + 20), SOON_S)
            at_sea.anchor()
            check(early, first, at_sea.made)
            check(late, second, at_sea.made)


def test_of_more_than_can_be_kept_the_newest_come_and_it_is_known_how_many_do_not():
    endpoint = free_endpoint()
    with publisher(endpoint, backlog=100) as boat, listening(endpoint) as (ear, shore):
        with router(endpoint):
            boat.publish(Topic.OBSERVATIONS, observation(0))
            assert shore.wait_for(lambda _: len(ear.readings) == 1, SOON_S)
        assert shore.wait_for(lambda one: not one.latest("boat1").alive, SOON_S)
        boat.publish(Topic.OBSERVATIONS, tuple(observation(number) for number in range(1, 301)))
        with router(endpoint):
            assert shore.wait_for(lambda _: len(ear.readings) == 101, SOON_S)
            assert [one.model_time_s for one in ear.readings] == [0.0, *range(201, 301)]
            assert shore.counters.missed == 200
            assert boat.status.dropped["observations"] == 200


def test_a_restarted_boat_is_another_run_and_nothing_is_mixed_up():
    endpoint = free_endpoint()
    with router(endpoint), listening(endpoint) as (ear, shore):
        for run in range(3):
            with publisher(endpoint) as boat:
                boat.publish(Topic.OBSERVATIONS, tuple(observation(1000 * run + k) for k in range(5)))
                assert shore.wait_for(lambda _, wanted=5 * run + 5: len(ear.readings) == wanted, SOON_S)
        assert ear.readings == [observation(1000 * run + k) for run in range(3) for k in range(5)]
