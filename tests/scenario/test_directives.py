"""What people ashore may ask for: each verb, what goes before it, and that it counts once."""

from typing import Any

import numpy as np
import pytest

from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived

from .conftest import FRAME, HARBOUR_M

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
