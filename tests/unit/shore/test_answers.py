"""What a vehicle answers after a break is passed on if it is news, and only then."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from autonomy.effects import Topic
from autonomy.shore.inbox import Arrival
from autonomy.shore.subscriber import Subscriber, Update
from autonomy.wire import Message, StatusDigest, encode

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import health_notice, learnt_model, model_snapshot, plan_notice, survey_notice


class Shore:
    """A subscriber without a network, and what it has passed on."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.arrived, self.updates = list[bytes](), list[Update]()
        self.subscriber = Subscriber(
            connect=["tcp/127.0.0.1:1"],
            on_update=self.updates.append,
            on_arrival=lambda *arrival: self.arrived.append(arrival[3]),
        )
        self._session = self.subscriber._session
        monkeypatch.setattr(self._session, "ask", lambda key, _=None: None)

    def hears(self, topic: Topic, value: Message, *, asked: bool = False) -> None:
        self._session.queries += asked
        query = self._session.queries if asked else None
        self.subscriber._take(Arrival(f"usv/boat1/{topic.value}", 0.0, payload=encode(value), query=query))


@pytest.mark.parametrize(
    ("topic", "value"),
    [
        (Topic.PLAN, replace(plan_notice(3), run=7)),
        (Topic.HEALTH, replace(health_notice(), run=7, rho=None)),
        (Topic.SURVEY, survey_notice()),
        (Topic.STATUS, StatusDigest(bytes(40))),
    ],
)
def test_an_answer_that_is_known_is_not_passed_on(
    topic: Topic, value: Message, monkeypatch: pytest.MonkeyPatch
) -> None:
    shore = Shore(monkeypatch)
    for asked in (False, True, True):
        shore.hears(topic, value, asked=asked)
    assert (shore.arrived, len(shore.updates)) == ([encode(value)], 1)
    shore.hears(topic, value)
    assert len(shore.arrived) == 2, "what comes by itself is a sign of life"


def test_an_answer_that_is_news_is_passed_on(monkeypatch: pytest.MonkeyPatch) -> None:
    shore = Shore(monkeypatch)
    told = [replace(health_notice(f"reason {number}"), run=7) for number in range(3)]
    for health in told:
        shore.hears(Topic.HEALTH, health, asked=True)
    assert shore.arrived == [encode(health) for health in told]
    assert shore.subscriber.latest("boat1").health == told[-1]


_HEALTH = replace(health_notice(), run=7, observations_end=50, log_end=5, model_time_s=900.0)


@pytest.mark.parametrize(
    ("topic", "newer", "older"),
    [
        (Topic.PLAN, replace(plan_notice(4), run=7), replace(plan_notice(3), run=7)),
        (Topic.HEALTH, _HEALTH, replace(_HEALTH, observations_end=49, model_time_s=901.0)),
        (Topic.HEALTH, _HEALTH, replace(_HEALTH, log_end=4)),
        (Topic.HEALTH, _HEALTH, replace(_HEALTH, model_time_s=899.0)),
    ],
)
def test_an_older_answer_of_the_same_run_undoes_nothing(
    topic: Topic, newer: Message, older: Message, monkeypatch: pytest.MonkeyPatch
) -> None:
    shore = Shore(monkeypatch)
    shore.hears(topic, newer, asked=True)
    shore.hears(topic, older, asked=True)
    assert shore.arrived == [encode(newer)]
    assert getattr(shore.subscriber.latest("boat1"), topic.value) == newer
    # A new run has numbers and a clock of its own, and what is told live is so.
    other = replace(older, run=8)
    shore.hears(topic, other, asked=True)
    shore.hears(topic, replace(older, run=8))
    assert getattr(shore.subscriber.latest("boat1"), topic.value) == other


def test_an_older_model_of_the_same_run_undoes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    model, _ = learnt_model()
    shore = Shore(monkeypatch)
    for sequence, run in ((2, 7), (1, 7), (2, 7), (0, 8)):
        shore.hears(Topic.MODEL, replace(model_snapshot(model, sequence), run=run), asked=True)
    assert len(shore.arrived) == 2
    held = shore.subscriber.latest("boat1").model
    assert held is not None
    assert (held.run, held.sequence) == (8, 0)
