"""What people ashore may ask for: each verb, what goes before it, and that it counts once.

HALOCLINE_COMMANDS: also what takes long.
"""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.core import Core
from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived
from autonomy.mavlink.codec import Codec
from autonomy.replay import replay
from autonomy.shell.journal import Journal, make_header
from sim.autopilot import Mode

from .conftest import FRAME, HARBOUR_M, boat
from .test_checkpoint import restart

CLOCK_S = 1_700_000_000.0


def command(voyage: Any, verb: str, number: int | None = None, **times: float) -> CommandReceived:
    """A command given now, or the one of that number."""
    voyage.given = getattr(voyage, "given", 0) + (number is None)
    now = CLOCK_S + voyage.now
    fields = {"issued_utc_s": now, "valid_s": 60.0, "received_utc_s": now} | times
    return CommandReceived((voyage.given if number is None else number).to_bytes(16, "big"), verb, **fields)


def told(voyage: Any, verb: str, *, settle_s: float = 0.0) -> Answer:
    """Give a command, and hear what becomes of it."""
    voyage.happened(command(voyage, verb))
    voyage.advance(settle_s)
    return voyage.answers[-1]


def test_paused_it_ends_its_leg_and_stays_until_resumed(voyage: Any) -> None:
    voyage.advance(40.0)
    corner = voyage.on_board_m()[voyage.core._helm.headway.next_row]
    answer = told(voyage, "pause")
    assert (answer.outcome, answer.state, answer.mode, answer.armed) == (Outcome.DONE, "paused", "AUTO", True)
    voyage.advance(200.0)
    assert voyage.on_board_m() == pytest.approx(corner.reshape(1, 2), abs=0.1)
    here_m = FRAME.to_local(*voyage.autopilot.vessel.position)
    assert np.hypot(*(here_m - corner)) < 30.0
    plans = len(voyage.plans)
    voyage.advance(200.0)
    assert len(voyage.plans) == plans, "whatever rho says"
    assert voyage.health.state == "paused"
    assert told(voyage, "resume").outcome is Outcome.DONE
    voyage.until("verified on board")
    assert voyage.health.state == "exploring"
    assert len(voyage.on_board_m()) > 1


def test_return_brings_it_home_over_water(voyage: Any, legs_over_land: Any) -> None:
    voyage.advance(200.0)
    answer = told(voyage, "return")
    assert (answer.outcome, answer.state) == (Outcome.DONE, "returning")
    voyage.until("finished: sent home from ashore")
    here_m = FRAME.to_local(*voyage.autopilot.vessel.position)
    assert np.hypot(*(here_m - HARBOUR_M)) < 400.0
    assert legs_over_land(voyage.plan_m()) == 0
    # Disarmed and started again, it begins another survey.
    voyage.arm(armed=False)
    voyage.advance(10.0)
    voyage.arm()
    voyage.select(Mode.AUTO)
    voyage.until("verified on board")
    assert voyage.health.state == "exploring"
    assert len(voyage.on_board_m()) > 1


def test_finish_sails_the_path_to_its_end_and_then_home(voyage: Any) -> None:
    voyage.advance(40.0)
    mission = voyage.on_board_m()
    answer = told(voyage, "finish")
    assert (answer.outcome, answer.state) == (Outcome.DONE, "exploring")
    assert "the last path" in answer.reason
    voyage.until("returning: ")
    assert np.hypot(*(FRAME.to_local(*voyage.autopilot.vessel.position) - mission[-1])) < 60.0
    voyage.until("finished: ")


def test_replan(voyage: Any) -> None:
    voyage.advance(40.0)
    mission = voyage.on_board_m()
    assert told(voyage, "replan").text == "a new plan is made"
    voyage.until("verified on board", patience_s=30.0)
    assert voyage.plans[-1].reason == "asked for from ashore"
    assert not np.array_equal(voyage.on_board_m(), mission)


# Mode full: the boat holds, and starts when it is told to ------------------------------------------------------------


@pytest.fixture
def fully(make_voyage: Any) -> Any:
    """Under way in `full`, by itself."""
    voyage = make_voyage(authority={"mode": "full"})
    voyage.until("exploring: in AUTO under our mission", patience_s=60.0)
    voyage.advance(60.0)
    return voyage


def test_in_full_a_paused_boat_holds_and_goes_on(fully: Any) -> None:
    answer = told(fully, "pause")
    assert (answer.outcome, answer.state) == (Outcome.DONE, "paused")
    fully.advance(10.0)
    assert fully.autopilot.navigator.mode is Mode.HOLD
    assert fully.health.reason == "paused from ashore: the boat holds"
    held = fully.now
    fully.advance(200.0)
    assert fully.traffic(since=held) == []
    assert told(fully, "resume").outcome is Outcome.DONE
    fully.until("exploring: in AUTO under our mission", patience_s=20.0)
    assert fully.autopilot.navigator.mode is Mode.AUTO
    fully.until("verified on board")
    assert fully.plans[-1].reason == "asked for from ashore"


def test_in_full_a_held_boat_can_be_brought_home(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    assert told(fully, "return").outcome is Outcome.DONE
    fully.until("finished: ")
    assert fully.autopilot.navigator.mode is Mode.AUTO


def test_in_full_the_operator_may_take_a_boat_that_holds(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    fully.select(Mode.MANUAL)
    fully.advance(5.0)
    taken = fully.now
    for verb in ("resume", "return", "finish", "start", "replan", "pause"):
        answer = told(fully, verb, settle_s=2.0)
        assert (answer.outcome, answer.state) == (Outcome.REFUSED, "yielded")
        assert "the operator has the boat (MANUAL)" in answer.text
    assert fully.traffic(since=taken) == []
    fully.select(Mode.HOLD)
    fully.advance(5.0)
    assert told(fully, "resume", settle_s=30.0).outcome is Outcome.REFUSED
    assert fully.autopilot.navigator.mode is Mode.HOLD


def refuse_auto(voyage: Any) -> Any:
    """From now on the autopilot does not enter AUTO; what it returns ends that."""
    navigator = voyage.autopilot.navigator
    sound = navigator.set_mode
    navigator.set_mode = lambda mode: mode is not Mode.AUTO and sound(mode)

    def relent() -> None:
        navigator.set_mode = sound

    return relent


@pytest.mark.parametrize("verb", ["resume", "return", "finish"])
def test_in_full_a_boat_that_can_not_be_set_in_motion_holds_again(fully: Any, verb: str) -> None:
    told(fully, "pause", settle_s=10.0)
    relent = refuse_auto(fully)
    answer = told(fully, verb)
    assert (answer.outcome, answer.state) == (Outcome.DONE, "paused")
    assert "AUTO is being selected" in answer.reason
    fully.until("the boat has not gone on in 60 s: it holds again", patience_s=70.0)
    assert any("not gone on: it holds" in str(each.text) for each in fully.said("STATUSTEXT"))
    given_up = fully.now
    relent()
    fully.advance(600.0)
    assert fully.traffic(since=given_up) == [], "nobody expects it to start by now"
    assert fully.autopilot.navigator.mode is Mode.HOLD
    assert fully.health.state == "paused"
    assert fully.health.reason == "paused from ashore: the boat holds, for it could not be set in motion"
    assert told(fully, "resume").outcome is Outcome.DONE
    fully.until("exploring: in AUTO under our mission", patience_s=20.0)
    told(fully, "pause", settle_s=10.0)
    assert fully.health.reason == "paused from ashore: the boat holds"


def test_in_full_what_was_to_go_on_before_a_restart_does_not_go_on_long_after_it(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    relent = refuse_auto(fully)
    told(fully, "resume", settle_s=5.0)
    memory = fully.core.checkpoint()
    relent()
    restart(fully, memory, away_s=600.0)
    fully.advance(60.0)
    assert fully.autopilot.navigator.mode is Mode.HOLD
    assert fully.health.state == "paused"


def test_in_full_auto_selected_by_the_operator_ends_the_pause(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    fully.select(Mode.AUTO)
    fully.until("that is over: the operator has taken the boat and given it back", patience_s=20.0)
    fully.advance(60.0)
    assert fully.autopilot.navigator.mode is Mode.AUTO
    assert fully.health.state == "exploring"


def test_in_full_the_boat_starts_when_it_is_told_to(make_voyage: Any) -> None:
    voyage = make_voyage(
        boat(ready_after_s=30.0),
        authority={"mode": "full", "start": "on_command"},
        shore={"commands": {"token_file": "boat1.token"}},
    )
    voyage.advance(10.0)
    assert told(voyage, "start").text.startswith("it is not ready")
    voyage.advance(120.0)
    assert not voyage.autopilot.navigator.armed
    assert "or for `start` from ashore" in voyage.health.reason
    assert told(voyage, "start").outcome is Outcome.DONE
    voyage.until("exploring: in AUTO under our mission", patience_s=30.0)
    assert voyage.core._helm.authority.waits_for_start, "it was told to start once"


def test_a_start_that_came_to_nothing_is_not_good_for_ever(make_voyage: Any) -> None:
    voyage = make_voyage(authority={"mode": "full", "start": "on_command"})
    voyage.advance(60.0)
    voyage.passes = lambda message: message.get_type() != "COMMAND_LONG" or message.command not in (176, 400)
    assert told(voyage, "start").outcome is Outcome.DONE
    voyage.until("it waits for another start", patience_s=100.0)
    voyage.unstall()
    voyage.advance(100.0)
    assert not voyage.autopilot.navigator.armed


def test_in_full_pause_keeps_a_boat_from_starting(make_voyage: Any) -> None:
    voyage = make_voyage(boat(ready_after_s=30.0), authority={"mode": "full"})
    voyage.advance(10.0)
    assert told(voyage, "pause").outcome is Outcome.DONE
    voyage.advance(120.0)
    assert not voyage.autopilot.navigator.armed
    assert told(voyage, "start").outcome is Outcome.DONE
    voyage.until("exploring: in AUTO under our mission", patience_s=30.0)


def test_in_full_a_paused_boat_whose_mission_was_cleared_waits_for_another_start(fully: Any) -> None:
    """Who cleared it gets another on board, but has not asked for the boat to go on."""
    told(fully, "pause", settle_s=10.0)
    fully.upload_as_operator()
    fully.advance(60.0)
    assert len(fully.on_board_m())
    assert fully.autopilot.navigator.mode is Mode.HOLD
    assert told(fully, "start").outcome is Outcome.DONE
    fully.until("exploring: in AUTO under our mission", patience_s=30.0)


def test_a_paused_boat_whose_mission_was_cleared_can_be_given_back(voyage: Any) -> None:
    """AUTO is refused without a mission."""
    told(voyage, "pause")
    voyage.select(Mode.MANUAL)
    voyage.advance(5.0)
    voyage.upload_as_operator()
    voyage.advance(60.0)
    assert len(voyage.on_board_m())
    voyage.select(Mode.AUTO)
    voyage.until("exploring: in AUTO under our mission", patience_s=30.0)


# What goes before a directive ----------------------------------------------------------------------------------------

VERBS = ("start", "pause", "resume", "replan", "finish", "return")


@pytest.mark.parametrize("mode", [Mode.HOLD, Mode.MANUAL, Mode.RTL])
def test_the_mode_switch_wins(voyage: Any, mode: Mode) -> None:
    voyage.advance(40.0)
    mission = voyage.on_board_m()
    voyage.select(mode)
    voyage.advance(5.0)
    taken = voyage.now
    for verb in VERBS:
        answer = told(voyage, verb, settle_s=5.0)
        assert (answer.outcome, answer.state, answer.mode) == (Outcome.REFUSED, "yielded", mode.name)
        assert answer.text.startswith("the boat is not ours: the operator has the boat")
    assert voyage.traffic(since=taken) == []
    assert voyage.autopilot.navigator.mode is mode
    assert np.array_equal(voyage.on_board_m(), mission)
    voyage.select(Mode.AUTO)
    voyage.until("exploring: in AUTO under our mission")


@pytest.mark.parametrize("verb", ["pause", "finish", "return"])
def test_who_takes_the_boat_and_gives_it_back_has_decided_otherwise(voyage: Any, verb: str) -> None:
    voyage.advance(40.0)
    told(voyage, verb, settle_s=5.0)
    voyage.select(Mode.MANUAL)
    voyage.advance(10.0)
    assert voyage.health.state == "yielded"
    voyage.select(Mode.AUTO)
    voyage.until("that is over: the operator has taken the boat and given it back", patience_s=20.0)
    voyage.advance(60.0)
    assert voyage.health.state == "exploring"


def test_a_failsafe_wins_and_its_end_alone_does_not_end_a_pause(voyage: Any) -> None:
    voyage.advance(40.0)
    told(voyage, "pause", settle_s=5.0)
    critical = mavlink.MAVLink_heartbeat_message(11, 3, 209, 10, mavlink.MAV_STATE_CRITICAL, 3)
    voyage.intrude(Codec(voyage.autopilot.system_id, 1).encode(critical))
    assert "a failsafe has the boat" in told(voyage, "resume").text
    voyage.advance(10.0)
    assert voyage.health.state == "paused"


def test_before_the_start_only_another_mission_can_be_had(make_voyage: Any) -> None:
    voyage = make_voyage()
    assert told(voyage, "start").text == "nothing heard from the autopilot yet"
    voyage.advance(60.0)
    assert "the operator arms the boat and selects AUTO" in told(voyage, "start").text
    for verb in ("pause", "resume", "finish", "return"):
        assert told(voyage, verb).text.startswith("the survey has not begun: waiting for the operator")
    assert voyage.answers[-1].state == "waiting_for_vehicle"
    verified = voyage.verified
    assert told(voyage, "replan").outcome is Outcome.DONE
    voyage.advance(60.0)
    assert voyage.verified == verified + 1
    assert not voyage.autopilot.navigator.armed


def test_where_we_only_look_on_nothing_can_be_asked(make_voyage: Any) -> None:
    voyage = make_voyage(authority={"mode": "observe"})
    voyage.advance(30.0)
    for verb in VERBS:
        assert told(voyage, verb).text == "we only look on: authority.mode is observe"
    assert voyage.traffic() == []


def test_a_silent_autopilot_can_be_asked_for_nothing(voyage: Any) -> None:
    voyage.advance(40.0)
    voyage.linked = False
    voyage.advance(20.0)
    assert told(voyage, "pause").text == "the autopilot has fallen silent"


def test_the_budget_wins(make_voyage: Any) -> None:
    voyage = make_voyage(budget={"distance_m": 5000.0})
    voyage.start()
    voyage.advance(40.0)
    told(voyage, "pause")
    assert told(voyage, "resume").outcome is Outcome.DONE
    voyage.until("returning")
    for verb in ("pause", "resume", "replan"):
        assert told(voyage, verb).text.startswith("the boat goes home")
    for verb in ("return", "finish"):
        assert told(voyage, verb).outcome is Outcome.DONE
    voyage.until("finished")
    assert told(voyage, "resume").text == "the survey has ended at home"
    assert "disarm the boat" in told(voyage, "start").text


def test_what_is_so_already_is_no_mistake(voyage: Any) -> None:
    voyage.advance(40.0)
    assert told(voyage, "start").text == "it has been started already"
    assert told(voyage, "resume").text == "the survey goes on already"
    told(voyage, "pause")
    assert told(voyage, "pause").text == "it is paused already"
    assert "resume the survey first" in told(voyage, "replan").text
    told(voyage, "return")
    assert told(voyage, "return").text.startswith("the boat is on its way home")
    assert "resume the survey first" in told(voyage, "pause").text
    told(voyage, "resume", settle_s=60.0)
    assert voyage.health.state == "exploring"
    assert all(answer.outcome is not Outcome.EXPIRED for answer in voyage.answers)


def test_while_paused_the_way_home_that_the_budget_asks_for_is_sailed(make_voyage: Any) -> None:
    voyage = make_voyage(budget={"duration_s": 900.0})
    voyage.start()
    voyage.advance(40.0)
    told(voyage, "pause")
    voyage.until("paused from ashore: that is over: low: ")
    voyage.until("finished")


@pytest.mark.skipif("HALOCLINE_COMMANDS" not in os.environ, reason="a long one: HALOCLINE_COMMANDS=1")
def test_home_is_brought_on_board_in_place_of_a_mission_that_broke_off(voyage: Any) -> None:
    """An upload that failed for good leaves part of a mission: the way home is put in its place when it can be."""
    voyage.advance(40.0)
    voyage.stall_upload_after(1)
    told(voyage, "return")
    voyage.until("the plan is given up", patience_s=900.0)
    voyage.unstall()
    voyage.until("finished: sent home from ashore")


# Once, and the same in a replay --------------------------------------------------------------------------------------


def test_a_repetition_is_answered_as_before_and_not_carried_out(voyage: Any) -> None:
    voyage.advance(40.0)
    pause = command(voyage, "pause")
    voyage.happened(pause)
    told(voyage, "resume", settle_s=30.0)
    first, said = voyage.answers[0], len(voyage.lines("command from ashore"))
    voyage.happened(replace(pause, received_utc_s=pause.received_utc_s + 40.0))
    assert voyage.answers[-1] == first
    assert voyage.health.state == "exploring"
    assert len(voyage.lines("command from ashore")) == said


def test_a_restarted_service_knows_what_it_has_done(voyage: Any) -> None:
    voyage.advance(40.0)
    pause = command(voyage, "pause")
    voyage.happened(pause)
    voyage.advance(5.0)
    restart(voyage, voyage.core.checkpoint())
    voyage.advance(20.0)
    assert voyage.health.state == "paused"
    told(voyage, "resume", settle_s=20.0)
    voyage.happened(pause)
    assert voyage.answers[-1] == voyage.answers[0]
    assert voyage.health.state == "exploring"


def test_what_comes_too_late_does_nothing(voyage: Any) -> None:
    voyage.advance(40.0)
    late = command(voyage, "return", received_utc_s=CLOCK_S + voyage.now + 61.0)
    voyage.happened(late)
    assert voyage.answers[-1].outcome is Outcome.EXPIRED
    # Neither does it when the clock has been set back.
    voyage.happened(replace(late, received_utc_s=late.issued_utc_s))
    assert voyage.answers[-1].outcome is Outcome.EXPIRED
    assert voyage.health.state == "exploring"


def test_a_replay_comes_to_the_same_answers(make_voyage: Any, tmp_path: Path) -> None:
    made = make_voyage()
    configuration = made.configuration
    header = make_header(configuration, made.survey, now=made.now, utc_s=0.0)
    journal = Journal.open(tmp_path, configuration.journal, header)
    voyage: Any = type(made)(Core(configuration, made.survey), boat(), made.survey, journal=journal)
    voyage.start()
    for verb in ("pause", "resume", "replan", "return", "pause"):
        told(voyage, verb, settle_s=20.0)
    voyage.happened(command(voyage, "pause", number=1))
    journal.close()
    outcome = replay(tmp_path, 1)
    assert outcome.differences == []
    assert not outcome.lost
    heard = [answer for _, effects in answers_of(tmp_path) for answer in effects]
    assert heard == voyage.answers
    assert len(heard) == 6


def answers_of(folder: Path) -> list[tuple[float, list[Answer]]]:
    told: list[tuple[float, list[Answer]]] = []
    replay(
        folder,
        1,
        heard=lambda now, effects: told.append((now, [e for e in effects if isinstance(e, Answer)])),
    )
    return told
