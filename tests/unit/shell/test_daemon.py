"""The shell around the core: an error of the core's ends the run, and health tells what the core can't know."""

import asyncio
import socket
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import shapely

from autonomy import wire
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Effect, Level, Log, Publish, Topic
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from autonomy.shell import telling as module
from autonomy.shell.daemon import Daemon
from autonomy.wire import HealthNotice, PlanNotice


@pytest.fixture
def daemon() -> Callable[..., Daemon]:
    """`daemon(**options)`: of a service whose vehicle never comes."""

    def make(**options: Any) -> Daemon:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            endpoint = f"udpin:127.0.0.1:{free.getsockname()[1]}"
        area = [(33.9, -118.9), (33.9, -118.8), (34.0, -118.8), (34.0, -118.9)]
        configuration = Configuration.model_validate(
            {"survey": {"area": area}, "mavlink": {"endpoint": endpoint}, "shore": {"health_period_s": 1.0}}
        )
        survey = SurveyArea.from_geometry(LocalFrame(33.95, -118.85), shapely.box(0, 0, 1000, 1000))
        return Daemon(configuration, survey, **options)

    return make


@pytest.mark.parametrize("method", ["handle", "next_deadline"])
def test_an_error_of_the_core_ends_the_run(
    daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    """Else nobody would bring it events any more, while the watchdog is fed."""
    subject = daemon()

    right, calls = getattr(subject._core, method), count()

    def wrong(*arguments: Any) -> Any:
        # By then a timer calls, whose errors asyncio only logs.
        if next(calls) >= 5:
            raise ZeroDivisionError("a bug")
        return right(*arguments)

    monkeypatch.setattr(subject._core, method, wrong)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        asyncio.run(asyncio.wait_for(subject.run(), 30.0))


def test_a_run_that_cannot_begin_leaves_nothing_behind(daemon: Callable[..., Daemon]) -> None:
    """What it was told last is on the disk then, and no thread of zenoh's outlives the interpreter."""

    class Past:
        core, resumed, milestones = daemon()._core, None, 0
        closed: list[bool] = []  # noqa: RUF012 -- of one test

        def begin(self, journal: object) -> None:
            raise ZeroDivisionError("a bug")

        def close(self, *, in_order: bool) -> None:
            self.closed.append(in_order)

    class Recording:
        closed = False

        def close(self) -> None:
            self.closed = True

    past, recording = Past(), Recording()
    subject = daemon(continuity=past, journal=recording)
    with pytest.raises(ZeroDivisionError, match="a bug"):
        asyncio.run(asyncio.wait_for(subject.run(), 30.0))
    assert (past.closed, recording.closed) == ([False], True)


def test_what_is_worth_remembering_is_kept_before_it_has_any_consequence(
    daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else a plan could be on its way on board, and in no checkpoint that anybody waits for."""
    done: list[str] = []

    class Past:
        core, resumed, period_s, is_settled, trouble = daemon()._core, None, 3600.0, True, ""

        def begin(self, journal: object) -> None:
            """Nothing is gone on from."""

        def handling(self, at: object) -> None:
            """Nothing is recorded."""

        def keep(self, journal: object) -> None:
            done.append("kept")

        def close(self, *, in_order: bool) -> None:
            """Nothing waits."""

    subject = daemon(continuity=Past())
    handled: list[int] = []

    def handle(now: float, event: object) -> list[Effect]:
        handled.append(len(handled) + 1)
        if len(handled) == 3:
            asyncio.get_running_loop().call_soon(subject._stop)
        return [Log(Level.DEBUG, "a consequence")]

    monkeypatch.setattr(subject._core, "handle", handle)
    monkeypatch.setattr(type(subject._core), "milestones", property(lambda _: len(handled)))
    monkeypatch.setattr(subject, "_carry_out", lambda effect: done.append("carried out"))
    asyncio.run(asyncio.wait_for(subject.run(), 30.0))
    assert len(handled) >= 3
    assert done[: 2 * 3] == ["kept", "carried out"] * 3


def health_of(subject: Daemon, monkeypatch: pytest.MonkeyPatch, word: Callable[[Any], str]) -> None:
    """Run until a health notice has something to say where `word` looks."""
    publish = subject._publisher.publish

    def looking(topic: Topic, payload: Any) -> None:
        publish(topic, payload)
        if topic is Topic.HEALTH and word(payload):
            asyncio.get_running_loop().call_soon(subject._stop)

    monkeypatch.setattr(subject._publisher, "publish", looking)
    asyncio.run(asyncio.wait_for(subject.run(), 30.0))


def test_health_says_why_nothing_is_kept(
    daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = daemon(unkept="/var/lib/halocline: Read-only file system: no checkpoints")
    told: list[str] = []

    def word(health: Any) -> str:
        told.append(health.journal)
        return str(health.journal)

    health_of(subject, monkeypatch, word)
    assert told[-1] == "checkpoint: /var/lib/halocline: Read-only file system: no checkpoints"


def test_health_is_told_however_much_is_wrong(
    daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = daemon(unkept=f"/{'long/' * 200}: Read-only file system")
    told: list[HealthNotice] = []

    def word(health: HealthNotice) -> str:
        told.append(health)
        return health.journal

    health_of(subject, monkeypatch, word)
    assert wire.decode(Topic.HEALTH, wire.encode(told[-1])) == told[-1]


def test_a_certificate_that_expires_at_sea_is_told(
    daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    subject = daemon()
    told: list[str] = []

    def word(health: Any) -> str:
        # From now on; it was good when the service started.
        monkeypatch.setattr(module, "doubt", lambda *_files: "the certificate expires on 2031-01-01")
        told.append(health.shore)
        return str(health.shore)

    monkeypatch.setattr(module, "CERTIFICATE_S", 0.1)
    health_of(subject, monkeypatch, word)
    assert told[0] == ""
    assert told[-1] == "the certificate expires on 2031-01-01"


def test_health_and_plans_say_when_it_was(
    daemon: Callable[..., Daemon], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Core, "utc_s", 1_750_000_000.0)
    subject = daemon()
    handle, published = subject._core.handle, []
    plan = PlanNotice(0, (33.95, -118.85), (), (), None, "paper", "first plan")
    publish = subject._publisher.publish

    def noting(topic: Topic, payload: Any) -> None:
        published.append(payload)
        publish(topic, payload)

    monkeypatch.setattr(subject._publisher, "publish", noting)
    monkeypatch.setattr(subject._core, "handle", lambda *event: [*handle(*event), Publish(Topic.PLAN, plan)])
    health_of(subject, monkeypatch, lambda health: str(health.utc_s or ""))
    assert {one.utc_s for one in published if isinstance(one, PlanNotice | HealthNotice)} == {1_750_000_000.0}
    assert {type(one) for one in published} >= {PlanNotice, HealthNotice}
