"""A core that was put aside and taken up again decides as the one that went on."""

import copy
import copyreg
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from autonomy.core import Core
from autonomy.effects import Effect, Publish, SendMessage, StartJob, Topic
from autonomy.events import Event, JobFinished
from autonomy.memory import Memory, UnfitMemoryError
from autonomy.planning.survey import SurveyArea
from autonomy.shell.checkpoint import Checkpoint, decode, encode
from sim.autopilot import Mode


def through_bytes(memory: Memory) -> Memory:
    return decode(encode(Checkpoint(1, {}, memory, 0.0, 0.0, "", None))).memory


def twin_of(voyage: Any) -> Core:
    """A new core that knows what the voyage's knows, by way of a checkpoint's bytes."""
    twin = Core(voyage.configuration, voyage.survey)
    twin.restore(through_bytes(voyage.core.checkpoint()))
    return twin


def told(effects: list[Effect]) -> list[Any]:
    """Effects as values that can be compared."""
    said: list[Any] = []
    for effect in effects:
        match effect:
            case SendMessage(message):
                said.append((message.get_type(), message.to_dict()))
            case Publish(Topic.MODEL, snapshot):
                x = np.linspace(0.0, 3000.0, 7)
                grid = snapshot.model.predict_grid(x, x)
                said.append((snapshot.sequence, snapshot.samples, snapshot.rho, snapshot.replans, str(grid)))
            case StartJob(job_id, name, request, _):
                said.append(
                    (job_id, name, request.plan.seed, request.plan.start_m.tolist(), request.plan.reason)
                )
            case Publish(topic, payload):
                said.append((topic, repr(payload)))
            case _:
                said.append(repr(effect))
    return said


class Shadow:
    """Hears all that a voyage's core hears, and says nothing."""

    def __init__(self, core: Core, twin: Core) -> None:
        self.twin = twin
        self.effects = self.jobs = 0
        handle = core.handle

        def both(now: float, event: Event) -> list[Effect]:
            same = copy.deepcopy(event) if isinstance(event, JobFinished) else event  # its model is adopted
            effects, theirs = handle(now, event), twin.handle(now, same)
            assert told(theirs) == told(effects), (now, event)
            assert twin.next_deadline() == core.next_deadline()
            self.effects += len(effects)
            self.jobs += isinstance(event, JobFinished)
            return effects

        core.handle = both  # type: ignore[method-assign]


@pytest.mark.parametrize("sail_s", [0.0, 7.3, 61.0, 400.0])
def test_the_same_events_bring_the_same_decisions(voyage: Any, sail_s: float) -> None:
    voyage.advance(sail_s)
    shadow = Shadow(voyage.core, twin_of(voyage))
    voyage.advance(600.0)
    assert shadow.effects > 500
    assert shadow.jobs


# Restarts: a new core, the same vessel ---------------------------------------------------------------------------


def restart(voyage: Any, memory: Memory, away_s: float = 3.0) -> None:
    """The service that had this checkpoint is killed, and `away_s` later another one goes on."""
    twin = Core(voyage.configuration, voyage.survey)
    twin.restore(through_bytes(memory))
    away(voyage, away_s)
    voyage.core = twin
    twin.resume(voyage.now, away_s)


def away(voyage: Any, away_s: float) -> None:
    """Nobody listens to the vessel."""
    voyage.core = Nobody()
    voyage._pending.clear()
    voyage.advance(away_s)


class Nobody:
    """A service that is not there."""

    def handle(self, now: float, event: Event) -> list[Effect]:
        return []

    def next_deadline(self) -> float:
        return float("inf")


def test_the_mission_on_board_is_recognised_and_sailed_on(voyage: Any) -> None:
    voyage.advance(150.0)
    mission, plans, samples = voyage.on_board_m(), len(voyage.plans), voyage.samples
    restart(voyage, voyage.core.checkpoint())
    back = voyage.now
    assert voyage.advance(5.0, until=lambda: bool(voyage.lines("exploring: in AUTO under our mission", back)))
    assert voyage.lines("our mission is on board", back)
    voyage.advance(20.0)
    assert voyage.samples > samples
    assert (voyage.on_board_m() == mission).all()
    assert not voyage.said("MISSION_COUNT", back)
    assert len(voyage.plans) == plans
    voyage.until("re-estimated")


def test_nothing_is_commanded_before_vehicle_and_mission_were_heard(voyage: Any) -> None:
    voyage.advance(100.0)
    restart(voyage, voyage.core.checkpoint())
    voyage.linked = False
    back = voyage.now
    voyage.advance(60.0)
    assert voyage.traffic(back) == []
    voyage.linked = True
    voyage.advance(10.0)
    assert voyage.traffic(back)[:1] in (["MISSION_REQUEST_LIST"], ["COMMAND_LONG"])
    assert not voyage.said("MISSION_COUNT", back)


def test_a_boat_that_was_taken_meanwhile_is_left_alone(voyage: Any) -> None:
    voyage.advance(100.0)
    memory = voyage.core.checkpoint()
    voyage.select(Mode.HOLD)
    restart(voyage, memory)
    back = voyage.now
    voyage.advance(300.0)
    assert {"MISSION_COUNT", "MISSION_ITEM_INT"}.isdisjoint(voyage.traffic(back))
    assert voyage.health.state == "yielded"
    voyage.select(Mode.AUTO)
    voyage.until("exploring")


def test_a_mission_put_on_board_meanwhile_holds(voyage: Any) -> None:
    voyage.advance(100.0)
    memory = voyage.core.checkpoint()
    voyage.core, core = Nobody(), voyage.core
    voyage.upload_as_operator((400.0, 400.0), (800.0, 500.0), (600.0, 2000.0))
    theirs = voyage.on_board_m()
    voyage.core = core
    restart(voyage, memory)
    voyage.advance(300.0)
    assert voyage.health.state == "yielded"
    assert (voyage.on_board_m() == theirs).all()


class Keeping(Nobody):
    """A core whose milestones are kept, as the daemon does."""

    def __init__(self, core: Any, kept: list[Memory]) -> None:
        self.core, self.kept = core, kept

    def handle(self, now: float, event: Event) -> list[Effect]:
        known = self.core.milestones
        effects: list[Effect] = self.core.handle(now, event)
        if self.core.milestones != known:
            self.kept.append(self.core.checkpoint())
        return effects

    def next_deadline(self) -> float:
        return float(self.core.next_deadline())


_SAILED: list[tuple[Any, list[Memory]]] = []
# Else what packs messages could not be copied.
copyreg.pickle(struct.Struct, lambda layout: (struct.Struct, (layout.format,)))


@pytest.fixture
def before_an_upload(make_voyage: Callable[..., Any], survey: SurveyArea) -> tuple[Any, list[Memory]]:
    """A voyage whose second plan is being made, and what is kept at its milestones: sailed once, and copied."""
    if not _SAILED:
        voyage, kept = make_voyage(), list[Memory]()
        voyage.start()
        replanning = voyage.core._replanning
        voyage.core = Keeping(voyage.core, kept)
        assert voyage.advance(3000.0, until=lambda: replanning.is_busy)
        _SAILED.append((voyage, kept))
    # The survey stays the same object: the ways over its water, once found, are known by it.
    return copy.deepcopy(_SAILED[0], {id(survey): survey})


@pytest.mark.parametrize("remembered", ["before the upload", "in the middle of it"])
@pytest.mark.parametrize("items", [1, 3, 100])
def test_a_kill_in_the_middle_of_an_upload(
    before_an_upload: tuple[Any, list[Memory]], remembered: str, items: int
) -> None:
    """Half of a mission of ours is on board, or all of it unverified: it is read, and made whole."""
    voyage, kept = before_an_upload
    plans = len(voyage.plans)
    voyage.stall_upload_after(items)
    voyage.until_sent("MISSION_ITEM_INT", min(items, 3))
    voyage.core = voyage.core.core
    memory = kept[-1] if remembered == "before the upload" else voyage.core.checkpoint()
    restart(voyage, memory)
    voyage.unstall()
    back = voyage.now
    voyage.advance(30.0)
    plan, mission = voyage.plan_m(), voyage.on_board_m()
    assert len(voyage.plans) > plans
    assert voyage.health.state == "exploring"
    assert mission.shape == plan.shape
    assert np.abs(mission - plan).max() < 0.1
    assert not voyage.lines("we don't know", back)


@pytest.mark.parametrize("keep_mission", [True, False])
def test_a_vehicle_that_started_again_meanwhile(voyage: Any, keep_mission: bool) -> None:
    voyage.advance(150.0)
    learnt = voyage.samples
    memory = voyage.core.checkpoint()
    away(voyage, 5.0)
    voyage.reboot(keep_mission=keep_mission)
    restart(voyage, memory, away_s=20.0)
    voyage.advance(60.0)
    assert voyage.health.state in ("waiting_for_vehicle", "yielded")
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.advance(60.0)
    assert voyage.health.state == "exploring"
    assert voyage.samples > learnt


@pytest.mark.parametrize("away_s", [600.0, 7200.0])
def test_after_a_long_absence_the_boat_gets_a_new_path(voyage: Any, away_s: float) -> None:
    voyage.advance(100.0)
    memory = voyage.core.checkpoint()
    model_s = voyage.health.model_time_s
    restart(voyage, memory, away_s=away_s)
    back = voyage.now
    voyage.advance(60.0)
    assert voyage.health.model_time_s == pytest.approx(model_s + away_s + 65.0, abs=10.0)
    assert voyage.lines("plan ", back)
    assert voyage.health.state == "exploring"


def test_a_job_that_was_under_way_is_asked_for_again(voyage: Any) -> None:
    voyage.job_s = 50.0
    replanning = voyage.core._replanning
    assert voyage.advance(3000.0, until=lambda: replanning.is_busy and replanning._job.decision.reestimate)
    restart(voyage, voyage.core.checkpoint())
    voyage.job_s = 2.0
    voyage.advance(30.0)
    assert voyage.health.state == "exploring"
    assert voyage.lines("re-estimated") or voyage.lines("hyperparameters kept")


def test_a_memory_of_another_version_is_refused(voyage: Any) -> None:
    memory = through_bytes(voyage.core.checkpoint())
    name, attributes = next(row for row in memory["classes"] if row[0].endswith("Exploration"))
    memory["classes"][memory["classes"].index([name, attributes])][1][0] = "_gone"
    with pytest.raises(UnfitMemoryError, match=r"Exploration has other attributes in this version: .*_gone"):
        Core(voyage.configuration, voyage.survey).restore(memory)


@pytest.mark.parametrize("mode", ["observe", "missions"])
def test_whether_we_may_command_is_for_the_present_configuration_to_say(make_voyage: Any, mode: str) -> None:
    before = make_voyage(authority={"mode": "missions" if mode == "observe" else "observe"})
    before.advance(60.0)
    if mode == "observe":
        before.start()
        before.advance(30.0)
    now = make_voyage(authority={"mode": mode})
    fresh = now.core._helm.authority.command
    now.core.restore(through_bytes(before.core.checkpoint()))
    assert now.core._helm.authority.command is fresh
    now.core.resume(now.now, 5.0)
    now.advance(60.0)
    sent = {"MISSION_COUNT", "MISSION_ITEM_INT"} & set(now.traffic())
    assert bool(sent) == (mode == "missions")
