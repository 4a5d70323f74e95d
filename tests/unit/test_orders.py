"""Arming, selecting AUTO and sending the boat home: one order at a time, for as long as it is wanted."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.authority_table import Action
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission import Route
from autonomy.mavlink.rover import AUTO, HOLD
from autonomy.orders import PAUSE_S, Orders

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
RTL, SMART_RTL = 11, 12
ARM, SET_MODE = 400, 176
SPEAKS = (Action.ARM, Action.SELECT_AUTO, Action.GO_HOME, Action.HOLD)
QUIET = [action for action in Action if action not in SPEAKS]


def ack(result: int, command: int) -> Any:
    message = mavlink.MAVLink_command_ack_message(command, result, 0, 0, 1, 191)
    return Codec(1, 191).decode(Codec(1, 1).encode(message))[0]


def step(orders: Orders, now: float, action: Action, heartbeats: int = 0) -> list[tuple[float, ...]]:
    """The commands given, with their first two parameters."""
    sent = orders.step(now, action, heartbeats, ROUTE, 1.0)
    return [(each.command, each.param1, each.param2) for each in sent]


@pytest.mark.parametrize("action", QUIET)
def test_no_other_action_gives_an_order(action: Action) -> None:
    orders = Orders(RTL)
    assert step(orders, 0.0, action) == []
    assert orders.next_deadline() is None


@pytest.mark.parametrize("home", [RTL, SMART_RTL])
def test_each_action_has_its_order(home: int) -> None:
    wanted = {
        Action.ARM: (ARM, 1.0, 0.0),
        Action.SELECT_AUTO: (SET_MODE, 1.0, AUTO),
        Action.HOLD: (SET_MODE, 1.0, HOLD),
    }
    for action, order in (wanted | {Action.GO_HOME: (SET_MODE, 1.0, home)}).items():
        assert step(Orders(home), 0.0, action) == [order]


def test_an_order_that_was_accepted_is_given_again_after_a_pause_if_it_is_still_wanted() -> None:
    orders = Orders(RTL)
    step(orders, 10.0, Action.ARM)
    orders.handle(ack(0, ARM))
    assert step(orders, 10.2, Action.ARM) == []
    (note,) = orders.take_notes()
    assert (note.text, note.is_warning) == ("arming: accepted", False)
    assert orders.next_deadline() == 10.2 + PAUSE_S
    assert step(orders, 10.2 + PAUSE_S - 0.01, Action.ARM) == []
    assert step(orders, 10.2 + PAUSE_S, Action.ARM) == [(ARM, 1.0, 0.0)]


def test_a_refusal_is_told_as_a_warning_and_tried_again() -> None:
    orders = Orders(RTL)
    step(orders, 10.0, Action.SELECT_AUTO)
    orders.handle(ack(4, SET_MODE))
    step(orders, 10.1, Action.SELECT_AUTO)
    (note,) = orders.take_notes()
    assert (note.text, note.is_warning) == ("selecting AUTO: refused", True)
    assert orders.take_notes() == []
    assert step(orders, 15.2, Action.SELECT_AUTO) == [(SET_MODE, 1.0, AUTO)]


def test_a_refusal_that_goes_on_is_told_every_few_minutes_and_a_new_outcome_at_once() -> None:
    orders, told = Orders(RTL), []
    for second in range(0, 600, 5):
        step(orders, 6.0 + second, Action.ARM)
        orders.handle(ack(4, ARM))
        step(orders, 6.1 + second, Action.ARM)
        told += [note.text for note in orders.take_notes()]
    assert told == ["arming: refused", "arming: refused"]
    step(orders, 700.0, Action.ARM)
    orders.handle(ack(0, ARM))
    step(orders, 700.1, Action.ARM)
    assert [note.text for note in orders.take_notes()] == ["arming: accepted"]
    step(orders, 701.0, Action.SAIL)
    step(orders, 702.0, Action.ARM)
    orders.handle(ack(4, ARM))
    step(orders, 702.1, Action.ARM)
    assert [note.text for note in orders.take_notes()] == ["arming: refused"], "that is another time"


def test_an_order_that_is_not_answered_is_repeated_and_then_told() -> None:
    orders = Orders(SMART_RTL)
    given = len(step(orders, 0.0, Action.GO_HOME))
    now = 0.0
    while not (notes := orders.take_notes()):
        deadline = orders.next_deadline()
        assert deadline is not None
        now = max(now, deadline)
        given += len(step(orders, now, Action.GO_HOME))
    assert given == 6
    assert "not answered" in notes[0].text
    assert notes[0].is_warning


def test_another_action_takes_the_place_of_the_one_before_at_once() -> None:
    orders = Orders(RTL)
    step(orders, 10.0, Action.ARM)
    assert step(orders, 10.1, Action.SELECT_AUTO) == [(SET_MODE, 1.0, AUTO)]
    orders.handle(ack(0, ARM))  # late, to the order before
    step(orders, 10.2, Action.SELECT_AUTO)
    assert orders.take_notes() == []


def test_nothing_is_repeated_once_the_action_is_over() -> None:
    """The operator has the boat: an order that was not answered dies with the right to give it."""
    orders = Orders(RTL)
    step(orders, 10.0, Action.ARM)
    assert step(orders, 10.1, Action.LISTEN) == []
    assert orders.next_deadline() is None
    for now in (11.5, 13.0, 100.0):
        assert step(orders, now, Action.LISTEN) == []
    assert step(orders, 100.1, Action.ARM) == [(ARM, 1.0, 0.0)], "and no pause is left of before"


@pytest.mark.parametrize("action", SPEAKS)
def test_what_was_accepted_and_is_still_wanted_two_heartbeats_later_was_undone(action: Action) -> None:
    orders, command = Orders(RTL), ARM if action is Action.ARM else SET_MODE
    step(orders, 10.0, action, 100)
    orders.handle(ack(0, command))
    step(orders, 10.1, action, 100)
    step(orders, 11.0, action, 101)
    assert not orders.take_undone(), "this heartbeat may be an older one"
    step(orders, 12.0, action, 102)
    # Whoever stops a boat has taken it; one that does not hold, or return, is told again.
    assert orders.take_undone() is (action in (Action.ARM, Action.SELECT_AUTO))
    assert not orders.take_undone()


def test_what_was_followed_or_refused_was_not_undone() -> None:
    orders = Orders(RTL)
    step(orders, 10.0, Action.SELECT_AUTO, 100)
    orders.handle(ack(0, SET_MODE))
    step(orders, 10.1, Action.SELECT_AUTO, 100)
    step(orders, 11.0, Action.ARM, 101)
    orders.handle(ack(4, ARM))
    for beat in range(2, 9):
        step(orders, 10.0 + beat, Action.ARM, 100 + beat)
        assert not orders.take_undone()
