"""A plan or a survey that was lost on the way is asked for, and only then."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from autonomy.effects import Topic
from autonomy.shore.inbox import Arrival
from autonomy.shore.lack import GRACE_S, Lack, lacking
from autonomy.shore.subscriber import Subscriber
from autonomy.wire import Message, encode

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import health_notice, plan_notice, survey_notice


class Shore:
    """A subscriber without a network, by a clock that is set."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.asked = 1000.0, list[tuple[float, str]]()
        self.subscriber = Subscriber(connect=["tcp/127.0.0.1:1"], clock_s=lambda: self.now)
        session = self.subscriber._session
        monkeypatch.setattr(session, "ask", lambda key, _=None: self.asked.append((self.now, key)))
        monkeypatch.setattr(session, "call_roll", lambda: None)

    def hears(self, topic: Topic, value: Message) -> None:
        self.subscriber._take(Arrival(f"usv/boat1/{topic.value}", 0.0, payload=encode(value)))

    def waits(self, seconds: float) -> list[tuple[float, str]]:
        """What is asked meanwhile, and when from now; nobody answers."""
        began = self.now
        self.asked.clear()
        while self.now < began + seconds:
            self.now += 0.5
            before = len(self.asked)
            self.subscriber._sweep()
            for _, key in self.asked[before:]:
                self.subscriber._take(Arrival(key, 0.0, closed=True))
        return [
            (when - began, key) for when, key in self.asked if not key.endswith(("/log", "/observations"))
        ]


def test_a_plan_that_health_tells_of_is_asked_for_until_it_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    shore = Shore(monkeypatch)
    shore.hears(Topic.SURVEY, survey_notice())
    shore.hears(Topic.PLAN, replace(plan_notice(3), run=7))
    shore.hears(Topic.HEALTH, replace(health_notice(), run=7, replans=3))
    assert shore.waits(100.0) == []
    shore.hears(Topic.HEALTH, replace(health_notice(), run=7, replans=4))
    key = "usv/boat1/plan"
    assert shore.waits(13.0) == [(GRACE_S + pause, key) for pause in (0.0, 1.0, 3.0, 7.0)]
    shore.hears(Topic.PLAN, replace(plan_notice(4), run=7))
    assert shore.waits(100.0) == []


def test_a_survey_that_has_not_come_is_asked_for_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    shore = Shore(monkeypatch)
    shore.hears(Topic.HEALTH, replace(health_notice(), replans=0))
    assert {key for _, key in shore.waits(10.0)} == {"usv/boat1/survey"}
    shore.hears(Topic.SURVEY, survey_notice())
    assert shore.waits(100.0) == []


@pytest.mark.parametrize(
    ("replans", "run", "held", "lacks"),
    [
        (0, 1, None, False),
        (1, 1, None, True),
        (4, 1, (4, 1), False),
        (4, 1, (5, 1), False),  # health is older
        (5, 1, (4, 1), True),
        (0, 2, (4, 1), False),  # a new run has not planned yet
        (1, 2, (4, 1), True),
        (4, 2, (4, 1), False),  # it goes on from a checkpoint
    ],
)
def test_which_plan_is_lacking(replans: int, run: int, held: tuple[int, int] | None, lacks: bool) -> None:
    plan = None if held is None else replace(plan_notice(held[0]), run=held[1])
    health = replace(health_notice(), run=run, replans=replans)
    assert lacking(health, plan, survey_notice()) == {Topic.PLAN: lacks, Topic.SURVEY: False}
    assert not any(lacking(None, plan, None).values()), "nobody is there who could have told"


def test_what_comes_in_time_is_not_asked_for() -> None:
    lack = Lack()
    for now in (0.0, 4.9, 5.1, 10.0):
        assert not lack.question(now, lacking=now != 4.9)
    assert lack.question(10.1, lacking=True)
    assert not lack.question(12.0, lacking=True), "one question at a time"
