"""A companion's manners: heartbeat, stream requests, status texts."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.companion import Answer, StreamRequests, heartbeat, status_text, wanted_streams
from autonomy.mavlink.mission import Route

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
STREAMS = wanted_streams(4.0)[:2]


def answer(result: int, command: int = 511, to: tuple[int, int] = (1, 191)) -> Any:
    ack = mavlink.MAVLink_command_ack_message(command, result, 0, 0, *to)
    return Codec(1, 191).decode(Codec(1, 1).encode(ack))[0]


def test_our_heartbeat_is_no_autopilots() -> None:
    (message,) = Codec(1, 1).decode(Codec(1, 191).encode(heartbeat(active=True)))
    assert (message.type, message.autopilot, message.system_status) == (18, 8, 4)
    assert heartbeat(active=False).system_status == mavlink.MAV_STATE_STANDBY


def test_status_texts_fit_the_wire() -> None:
    (message,) = Codec(1, 1).decode(Codec(1, 191).encode(status_text("plan 7: " + "x" * 60 + "é")))
    assert len(message.text) == 50
    assert status_text("5 °C").text == "5 ?C"


def test_streams_are_asked_for_one_after_the_other() -> None:
    requests = StreamRequests(STREAMS, ROUTE)
    (first,) = requests.start(0.0)
    assert (first.command, first.param1, first.param2) == (511, 33, 250_000)
    assert requests.handle(0.1, answer(0, command=512)) == []
    assert requests.handle(0.1, answer(0, to=(255, 190))) == []
    assert requests.handle(0.1, answer(1)) == [], "later"
    (second,) = requests.handle(0.2, answer(0))
    assert second.param1 == mavlink.MAVLINK_MSG_ID_MISSION_CURRENT
    assert requests.handle(0.3, answer(0)) == []
    assert requests.finished
    assert requests.next_deadline() is None
    assert set(requests.answers.values()) == {Answer.GRANTED}


def test_an_old_autopilot_is_asked_for_groups() -> None:
    requests = StreamRequests(STREAMS, ROUTE)
    requests.start(0.0)
    group, following = requests.handle(0.1, answer(3))
    assert (group.get_type(), group.req_stream_id, group.req_message_rate, group.start_stop) == (
        "REQUEST_DATA_STREAM",
        mavlink.MAV_DATA_STREAM_POSITION,
        4,
        1,
    )
    assert following.get_type() == "COMMAND_LONG"
    assert requests.answers[STREAMS[0]] is Answer.GROUP_REQUESTED


def test_a_silent_vehicle_is_asked_six_times_for_each() -> None:
    requests = StreamRequests(STREAMS, ROUTE)
    sent = requests.start(0.0)
    while (deadline := requests.next_deadline()) is not None:
        sent += requests.on_deadline(deadline)
    assert [message.confirmation for message in sent] == [0, 1, 2, 3, 4, 5] * 2
    assert set(requests.answers.values()) == {Answer.SILENT}


def test_how_far_the_boat_is_from_where_it_makes_for_is_asked_once_a_second() -> None:
    (wanted,) = [each for each in wanted_streams(4.0) if each.message_id == 62]  # NAV_CONTROLLER_OUTPUT
    assert (wanted.rate_hz, wanted.group) == (1.0, mavlink.MAV_DATA_STREAM_EXTENDED_STATUS)


def test_a_budget_lives_on_two_streams_more() -> None:
    plain, with_battery = wanted_streams(4.0), wanted_streams(4.0, battery=True)
    assert with_battery[: len(plain)] == plain
    assert [each.message_id for each in with_battery[len(plain) :]] == [
        147,
        242,
    ]  # BATTERY_STATUS, HOME_POSITION
