"""What people ashore may ask for: each verb, what goes before it, and that it counts once."""

from typing import Any

import numpy as np
import pytest

from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived
from sim.autopilot import Mode

from .conftest import FRAME, HARBOUR_M, boat

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
    corner = voyage.on_board_m()[voyage.core._helm.next_row]
    answer = told(voyage, "pause")
    assert (answer.outcome, answer.state, answer.mode, answer.armed) == (Outcome.DONE, "paused", "AUTO", True)
    voyage.advance(400.0)
    assert voyage.on_board_m() == pytest.approx(corner.reshape(1, 2), abs=0.1)
    here_m = FRAME.to_local(*voyage.autopilot.vessel.position)
    assert np.hypot(*(here_m - corner)) < 30.0
    plans = len(voyage.plans)
    voyage.advance(600.0)
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
    fully.advance(600.0)
    assert fully.traffic(since=held) == []
    assert told(fully, "resume").outcome is Outcome.DONE
    fully.until("exploring: in AUTO under our mission", patience_s=20.0)
    assert fully.autopilot.navigator.mode is Mode.AUTO
    fully.until("verified on board")
    assert fully.plans[-1].reason == "asked for from ashore"


@pytest.mark.parametrize("verb", ["return", "finish"])
def test_in_full_a_held_boat_can_be_brought_home(fully: Any, verb: str) -> None:
    told(fully, "pause", settle_s=10.0)
    assert told(fully, verb).outcome is Outcome.DONE
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


def test_in_full_auto_selected_by_the_operator_ends_the_pause(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    fully.select(Mode.AUTO)
    fully.until("that is over: the operator has taken the boat and given it back", patience_s=20.0)
    fully.advance(60.0)
    assert fully.autopilot.navigator.mode is Mode.AUTO
    assert fully.health.state == "exploring"


def test_in_full_the_boat_starts_when_it_is_told_to(make_voyage: Any) -> None:
    voyage = make_voyage(boat(ready_after_s=30.0), authority={"mode": "full", "start": "on_command"})
    voyage.advance(10.0)
    assert told(voyage, "start").text.startswith("it is not ready")
    voyage.advance(120.0)
    assert not voyage.autopilot.navigator.armed
    assert "or for `start` from ashore" in voyage.health.reason
    assert told(voyage, "start").outcome is Outcome.DONE
    voyage.until("exploring: in AUTO under our mission", patience_s=30.0)


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
