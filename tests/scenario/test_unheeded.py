"""Orders that come too late to be taken back, or that the autopilot does not follow: `authority.mode: full`."""

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.effects import Effect, Outcome, SendMessage
from sim.autopilot import Mode

from .conftest import FRAME, HARBOUR_M
from .test_directives import refuse_auto, told

ARM, SET_MODE = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_DO_SET_MODE


@pytest.fixture
def fully(make_voyage: Any) -> Any:
    """Under way in `full`, by itself."""
    voyage = make_voyage(authority={"mode": "full", "return_battery": 0.5, "return_mode": "smart_rtl"})
    voyage.until("exploring: in AUTO under our mission", patience_s=60.0)
    voyage.advance(30.0)
    return voyage


class Slow:
    """A link on which one kind of order takes its time."""

    def __init__(self, voyage: Any, command: int) -> None:
        self.waiting: list[Effect] = []
        self._command, self._carry_out = command, voyage._carry_out
        voyage._carry_out = self.carry_out

    def carry_out(self, effect: Effect) -> None:
        message = effect.message if isinstance(effect, SendMessage) else None
        if message is not None and getattr(message, "command", None) == self._command:
            self.waiting.append(effect)
        else:
            self._carry_out(effect)

    def deliver(self) -> None:
        waiting, self.waiting, self._command = self.waiting, [], -1
        for effect in waiting:
            self._carry_out(effect)


def test_a_boat_whose_start_was_under_way_when_it_was_paused_is_told_to_hold(make_voyage: Any) -> None:
    voyage = make_voyage(authority={"mode": "full"})
    slow = Slow(voyage, ARM)
    assert voyage.advance(90.0, until=lambda: bool(slow.waiting))
    assert told(voyage, "pause", settle_s=1.0).text == "the boat does not start before it is told to"
    slow.deliver()
    voyage.until("the boat has moved off all the same: it is told to hold", patience_s=5.0)
    voyage.advance(10.0)
    assert voyage.autopilot.navigator.mode is Mode.HOLD
    assert voyage.health.reason == "paused from ashore: the boat holds"
    assert told(voyage, "resume").outcome is Outcome.DONE
    voyage.until("exploring: in AUTO under our mission", patience_s=20.0)


def test_a_pause_goes_before_the_resume_that_it_takes_back(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    slow = Slow(fully, SET_MODE)
    told(fully, "resume", settle_s=0.5)
    assert slow.waiting
    answer = told(fully, "pause", settle_s=0.5)
    assert (answer.outcome, answer.text) == (Outcome.DONE, "the boat holds, and is not set in motion")
    slow.deliver()
    fully.until("the boat has moved off all the same: it is told to hold", patience_s=5.0)
    fully.advance(60.0)
    assert fully.autopilot.navigator.mode is Mode.HOLD
    assert fully.health.state == "paused"
    fully.select(Mode.AUTO)
    fully.until("that is over: the operator has taken the boat and given it back", patience_s=20.0)


def test_while_auto_is_refused_the_boat_can_be_paused(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    relent = refuse_auto(fully)
    told(fully, "return", settle_s=5.0)
    assert told(fully, "finish").outcome is Outcome.REFUSED
    assert told(fully, "pause").outcome is Outcome.DONE
    relent()
    fully.advance(100.0)
    assert fully.autopilot.navigator.mode is Mode.HOLD
    assert fully.health.reason == "paused from ashore: the boat holds"


def refuse(voyage: Any, refused: Mode, *, says_so: bool) -> None:
    """The autopilot does not enter a mode, whatever it answers."""
    navigator, sound = voyage.autopilot.navigator, voyage.autopilot.navigator.set_mode
    navigator.set_mode = lambda mode: (not says_so) if mode is refused else sound(mode)


@pytest.mark.parametrize("says_so", [True, False])
def test_a_boat_that_does_not_hold_ends_its_leg(fully: Any, says_so: bool) -> None:
    refuse(fully, Mode.HOLD, says_so=says_so)
    told(fully, "pause", settle_s=30.0)
    assert fully.health.reason == "paused from ashore: the boat is told to hold"
    fully.until("the boat does not hold: it sails its leg to the end, and stays there", patience_s=60.0)
    given_up = fully.now
    fully.until("verified on board", patience_s=30.0)
    assert len(fully.on_board_m()) == 1
    fully.advance(200.0)
    assert fully.health.state == "paused"
    commands = {each.command for each in fully.said("COMMAND_LONG", given_up)}
    assert SET_MODE not in commands, "it is not told again"
    assert told(fully, "resume").outcome is Outcome.DONE
    fully.until("verified on board")
    assert fully.health.state == "exploring"


@pytest.mark.parametrize("says_so", [True, False])
def test_a_boat_that_the_autopilot_does_not_bring_home_sails_a_mission_home(
    fully: Any, says_so: bool, legs_over_land: Any
) -> None:
    refuse(fully, Mode.SMART_RTL, says_so=says_so)
    battery = fully.autopilot.vessel.battery
    battery.used_wh = 0.6 * battery.capacity_wh
    fully.until("the boat is not brought home by the autopilot", patience_s=90.0)
    fully.until("verified on board", patience_s=30.0)
    assert fully.health.state == "returning"
    assert fully.health.reason == "the autopilot was told to bring the boat home, and has not"
    assert legs_over_land(fully.plan_m()) == 0
    fully.until("finished: ")
    assert np.hypot(*(FRAME.to_local(*fully.autopilot.vessel.position) - HARBOUR_M)) < 400.0


def test_an_operator_who_takes_it_meanwhile_has_decided_otherwise(fully: Any) -> None:
    refuse(fully, Mode.SMART_RTL, says_so=True)
    battery = fully.autopilot.vessel.battery
    battery.used_wh = 0.6 * battery.capacity_wh
    fully.until("the boat is not brought home by the autopilot", patience_s=90.0)
    fully.select(Mode.MANUAL)
    fully.advance(10.0)
    fully.select(Mode.AUTO)
    fully.until("that is over: the operator has taken the boat and given it back", patience_s=20.0)
    fully.advance(100.0)
    assert fully.health.state == "exploring"


def undone_at_once(voyage: Any, command: int, act: Any) -> None:
    """Each time that our order has been carried out the operator undoes it, before a heartbeat tells of it."""
    carry_out = voyage._carry_out

    def carried_out(effect: Effect) -> None:
        carry_out(effect)
        if isinstance(effect, SendMessage) and getattr(effect.message, "command", None) == command:
            act()

    voyage._carry_out = carried_out


@pytest.mark.parametrize("order", ["ARM", "SET_MODE"])
def test_a_boat_that_is_stopped_as_soon_as_it_starts_is_not_started_again(
    make_voyage: Any, order: str
) -> None:
    """A hand near the propeller: that the boat was armed, or in AUTO, for a moment no heartbeat has told."""
    voyage = make_voyage(authority={"mode": "full"})
    acts = {
        "ARM": (ARM, lambda: voyage.arm(armed=False)),
        "SET_MODE": (SET_MODE, lambda: voyage.select(Mode.MANUAL)),
    }
    undone_at_once(voyage, *acts[order])
    voyage.until("undone at once by somebody", patience_s=90.0)
    stopped = voyage.now
    voyage.advance(100.0)
    assert not voyage.autopilot.navigator.armed
    commands = [each.command for each in voyage.said("COMMAND_LONG", stopped)]
    assert {ARM, SET_MODE}.isdisjoint(commands)
    assert told(voyage, "start").text == "the operator has taken the boat: he starts it again himself"


def test_a_boat_that_is_stopped_as_soon_as_it_goes_on_is_the_operators(fully: Any) -> None:
    told(fully, "pause", settle_s=10.0)
    undone_at_once(fully, SET_MODE, lambda: fully.select(Mode.HOLD))
    told(fully, "resume", settle_s=1.0)
    fully.until("yielded: the operator has the boat (HOLD)", patience_s=10.0)
    taken = fully.now
    fully.advance(100.0)
    assert fully.traffic(taken) == []
    assert fully.autopilot.navigator.mode is Mode.HOLD
