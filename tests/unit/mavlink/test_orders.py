"""One command to the autopilot: repeated, answered, refused, or never answered."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.orders import Answer, Order

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
ARM = int(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)


def order(time_scale: float = 1.0) -> Order:
    return Order(ARM, (1.0,), ROUTE, time_scale)


def ack(result: int, command: int = ARM, to: tuple[int, int] = (1, 191), component_id: int = 1) -> Any:
    message = mavlink.MAVLink_command_ack_message(command, result, 0, 0, *to)
    return Codec(1, 191).decode(Codec(1, component_id).encode(message))[0]


def test_it_is_sent_once_with_its_parameters() -> None:
    given = order()
    (sent,) = given.start(10.0)
    assert (sent.command, sent.confirmation, sent.param1, sent.param7) == (ARM, 0, 1.0, 0.0)
    assert (sent.target_system, sent.target_component) == (1, 1)
    assert (given.answer, given.next_deadline()) == (Answer.WAITING, 11.5)
    assert given.on_deadline(11.4) == []


@pytest.mark.parametrize(
    ("result", "answer"),
    [(0, Answer.ACCEPTED), (2, Answer.REFUSED), (3, Answer.REFUSED), (4, Answer.REFUSED)],
)
def test_an_answer_ends_it(result: int, answer: Answer) -> None:
    given = order()
    given.start(10.0)
    given.handle(ack(result))
    assert (given.answer, given.next_deadline()) == (answer, None)
    given.handle(ack(0 if result else 4))
    assert given.answer is answer, "the first answer holds"
    assert given.on_deadline(1e9) == []


@pytest.mark.parametrize("result", [1, 5])
def test_later_and_in_progress_are_waited_out(result: int) -> None:
    given = order()
    given.start(10.0)
    given.handle(ack(result))
    assert given.answer is Answer.WAITING
    assert [each.confirmation for each in given.on_deadline(11.5)] == [1]
    given.handle(ack(0))
    assert given.answer is Answer.ACCEPTED


def test_answers_to_others_of_others_and_for_others_say_nothing() -> None:
    given = order()
    given.start(10.0)
    for other in (ack(0, command=400 + 1), ack(0, to=(255, 190)), ack(0, component_id=100)):
        given.handle(other)
    given.handle(mavlink.MAVLink_heartbeat_message(11, 3, 81, 10, 4, 3))
    assert given.answer is Answer.WAITING
    given.handle(ack(0, to=(0, 0)))
    assert given.answer is Answer.ACCEPTED


def test_a_silent_vehicle_is_told_six_times_and_each_time_says_which() -> None:
    given = order()
    sent = given.start(0.0)
    while (deadline := given.next_deadline()) is not None:
        sent += given.on_deadline(deadline)
    assert [each.confirmation for each in sent] == [0, 1, 2, 3, 4, 5]
    assert given.answer is Answer.SILENT


def test_a_vehicle_whose_time_runs_faster_is_told_sooner() -> None:
    given = order(time_scale=0.1)
    given.start(0.0)
    assert given.next_deadline() == pytest.approx(0.15)
