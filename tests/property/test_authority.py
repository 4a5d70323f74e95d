"""Operator, autopilot and people ashore do what they want in any order: we follow at once; in `observe` we never speak.

HALOCLINE_HUNDREDS: how many hundreds of surveys; without it one.
"""

import os
from typing import Any

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Outcome
from autonomy.events import CommandReceived, Event, JobFinished, MessageReceived
from autonomy.geometry import LocalFrame
from autonomy.mavlink import authority_table
from autonomy.mavlink.authority_table import TABLE, Action, Command, Rule, table_of
from autonomy.mavlink.authority_table import Event as What
from autonomy.mavlink.rover import AUTO
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.wire_commands import VERBS
from sim.autopilot import Autopilot, Mode, Options
from sim.discrete import DiscreteRun
from sim.vessel import Handling, Position, Vessel

FRAME = LocalFrame(33.5, -118.5)
SURVEY = SurveyArea.from_geometry(FRAME, shapely.box(-2e3, -2e3, 2e3, 2e3), passage_cells=20)
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
MANNERS = frozenset({"HEARTBEAT", "STATUSTEXT"})
MODES = (Mode.AUTO, Mode.AUTO, Mode.AUTO, Mode.HOLD, Mode.MANUAL, Mode.LOITER, Mode.RTL)
GRACE_S = 0.2
NEVER_S = 1e6
HUNDREDS = range(int(os.environ.get("HALOCLINE_HUNDREDS", "1")))


def near_by(name: str, request: jobs.ExploreRequest, survey: SurveyArea) -> jobs.ExploreResult:
    """A plan that costs nothing: two corners close to the boat, so that missions end and are replaced."""
    plan = request.plan
    assert plan is not None
    route = plan.start_m + np.array([[40.0, 10.0 * (plan.seed % 5)], [10.0, 60.0]])
    route = np.clip(route, -1900.0, 1900.0)
    return jobs.ExploreResult(
        None, Plan(plan.start_m, route, np.ones(2, bool), 1.0, "paper", plan.reason), None
    )


class Watched(DiscreteRun):
    """Notes when the core was told that the boat is not ours, and all that it said from 200 ms after that on."""

    taken: float | None = None
    late: list[tuple[float, str]]
    interrupted = 0
    """Conversations about the mission that the boat was taken in the midst of."""
    struck = 0
    """How often a failsafe took a boat that was ours."""
    finished = 0
    """Jobs whose result came while the boat was not ours, some of them begun while it was."""

    def happened(self, event: Event) -> None:
        self.finished += isinstance(event, JobFinished) and self.taken is not None
        if isinstance(event, MessageReceived) and event.message.get_type() == "HEARTBEAT":
            beat = event.message
            armed = bool(beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            ours = beat.custom_mode == AUTO and armed and beat.system_status < mavlink.MAV_STATE_CRITICAL
            started = self.core._helm.authority.survey_started
            if ours or not started:
                self.taken = None
            elif self.taken is None:
                self.taken = self.now
                self.struck += beat.system_status >= mavlink.MAV_STATE_CRITICAL
                self.interrupted += self.core._helm.dispatch.talking
        super().happened(event)

    def _carry_out(self, effect: Any) -> None:
        before = len(self.sent)
        super()._carry_out(effect)
        for time, message in self.sent[before : before + 1]:
            kind = message.get_type()
            # A reboot or a cleared mission leads back to the start, where a mission may be prepared.
            is_before = self.core._helm.authority.command is Command.BEFORE_START
            if (
                kind not in MANNERS
                and self.taken is not None
                and not is_before
                and time > self.taken + GRACE_S
            ):
                self.late.append((time, kind))


def boat(rng: np.random.Generator) -> Autopilot:
    start = Position(*FRAME.to_geodetic((0.0, 0.0)).tolist())
    vessel = Vessel(start, handling=Handling(acceleration_mps2=4.0, turn_rate_deg_s=90.0))
    return Autopilot(
        vessel, None, Options(speed_mps=8.0, waypoint_radius_m=10.0, ready_after_s=rng.uniform(0, 3))
    )


def voyage(rng: np.random.Generator, **authority: Any) -> Watched:
    configuration = Configuration.model_validate(
        {
            "survey": {"area": AREA},
            "authority": authority,
            "shore": {"model_period_s": 1e6, "health_period_s": 1e6},
            # Another plan every second or so: what would be late must be wanted first.
            "exploration": {"stall_s": None, "replan_share": 0.05},
        }
    )
    run = Watched(
        Core(configuration, SURVEY), boat(rng), SURVEY, job_s=float(rng.uniform(0.01, 3.0)), run_job=near_by
    )
    run.late = []
    # The ground station's failsafe: it has been heard once, and is silent from then on. The mode stays.
    for name, value in {"FS_GCS_ENABLE": 1.0, "FS_ACTION": 0.0, "FS_GCS_TIMEOUT": NEVER_S}.items():
        run.autopilot.parameters.set(name, value)
    run.operate(
        mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    )
    return run


def meddle(run: Watched, rng: np.random.Generator) -> None:
    """One thing that the operator, the autopilot or the link does."""
    match rng.integers(12):
        case 0 | 1 | 2:
            run.select(MODES[rng.integers(len(MODES))])
        case 3:
            run.arm(armed=bool(rng.random() < 0.8))
        case 4:
            # An armed boat whose ground station has been silent for longer than this is CRITICAL.
            run.autopilot.parameters.set("FS_GCS_TIMEOUT", 0.0 if rng.random() < 0.6 else NEVER_S)
        case 5:
            run.operate(mavlink.MAVLink_mission_count_message(1, 1, int(rng.integers(0, 4)), 0))
        case 6:
            run.operate(mavlink.MAVLink_mission_clear_all_message(1, 1))
        case 7:
            dropped = rng.random()
            run.passes = lambda message: rng.random() > 0.5 * dropped
        case 8:
            run.linked = not run.linked
        case _:
            run.arm()
            run.select(Mode.AUTO)


def command(run: Watched, rng: np.random.Generator) -> None:
    """Somebody ashore wants something, without regard to whose the boat is."""
    verb = VERBS[rng.integers(len(VERBS))]
    run.happened(CommandReceived(rng.bytes(16), verb, run.now, 60.0, run.now))


def sail(seed: int, **authority: Any) -> Watched:
    rng = np.random.default_rng(seed)
    run = voyage(rng, **authority)
    run.advance(float(rng.uniform(3.0, 8.0)))
    run.arm()
    run.select(Mode.AUTO)
    run.advance(float(rng.uniform(0.0, 4.0)))
    for _ in range(12):
        run.advance(float(rng.exponential(0.7)))
        meddle(run, rng)
        # In `full` a boat that holds is not in AUTO, and ours all the same.
        if authority.get("mode") != "full" and rng.random() < 0.3:
            command(run, rng)
    return run


@pytest.mark.parametrize("hundred", HUNDREDS)
def test_no_command_later_than_200_ms_after_the_boat_was_taken(hundred: int) -> None:
    started = spoken = interrupted = finished = done = struck = 0
    for seed in range(100 * hundred, 100 * hundred + 100):
        run = sail(seed, resume="never" if seed % 5 == 0 else "when_auto_again")
        assert run.late == [], seed
        interrupted += run.interrupted
        finished += run.finished
        struck += run.struck
        done += sum(answer.outcome is Outcome.DONE for answer in run.answers)
        started += any("exploring" in text for _, text in run.log)
        spoken += sum(message.get_type() == "MISSION_COUNT" for _, message in run.sent)
    assert started > 80, "most of them are surveys, or this would prove nothing"
    assert spoken > 100
    assert interrupted > 5, "nor if it were only taken in quiet moments"
    assert finished > 5
    assert struck > 5
    assert done > 20, "nor if nobody ashore ever had his way"
    print(
        f"\n{started} surveys, {interrupted} conversations interrupted, {finished} jobs finished meanwhile, "
        f"{struck} failsafes"
    )


def test_who_does_not_yield_is_seen_to_be_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """The measure itself: an authority that leaves the boat's mode out of account fails it."""
    sails_on = {
        cell: Rule(Command.OURS, Action.SAIL, "{mode}")
        for cell in TABLE
        if cell[0] is Command.OURS and cell[1] in (What.ELSEWHERE, What.READY, What.HOMEWARD)
    }
    monkeypatch.setattr(authority_table, "TABLE", {**TABLE, **sails_on})
    assert any(sail(seed).late for seed in range(20))


@pytest.mark.parametrize("hundred", HUNDREDS)
def test_in_observe_nothing_is_asked_and_nothing_commanded(hundred: int) -> None:
    for seed in range(100 * hundred, 100 * hundred + 100):
        run = sail(seed, mode="observe")
        assert {message.get_type() for _, message in run.sent} <= MANNERS, seed


def test_full_is_as_quiet_once_the_boat_was_taken() -> None:
    commands = 0
    for seed in range(100):
        run = sail(seed, mode="full")
        assert run.late == [], seed
        commands += sum(message.get_type() == "COMMAND_LONG" for _, message in run.sent)
    assert commands > 100


@pytest.mark.parametrize("mode", ["missions", "full", "observe"])
@pytest.mark.parametrize("resume", ["when_auto_again", "never"])
def test_the_table_is_complete_and_yields(mode: Any, resume: Any) -> None:
    table = table_of(mode, resume)
    for command in {before for before, _ in table} | {rule.after for rule in table.values()}:
        for event in What:
            rule = table[command, event]
            if event in (What.UNSUPPORTED, What.FAILSAFE) and command is not Command.BEFORE_START:
                assert rule.action is Action.LISTEN
            if event in (What.ELSEWHERE, What.DISARMED) and command is not Command.BEFORE_START:
                assert rule.action is Action.LISTEN
            if rule.after is Command.YIELDED:
                assert rule.action is Action.LISTEN
            if mode == "missions":
                assert rule.action not in (Action.ARM, Action.SELECT_AUTO, Action.GO_HOME, Action.HOLD)
            if resume == "never" and command in (Command.YIELDED, Command.DISPLACED):
                assert rule.after is Command.YIELDED
    assert len(TABLE) == 4 * len(What)
