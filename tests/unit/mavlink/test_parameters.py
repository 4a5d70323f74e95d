"""Reading parameters and home, with answers that come late, twice, from others, or never."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.parameters import ParameterReading

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
NAMES = ("FENCE_ENABLE", "FS_ACTION")


def heard(message: Any, system_id: int = 1, component_id: int = 1) -> Any:
    return Codec(1, 191).decode(Codec(system_id, component_id).encode(message))[0]


def value(name: str, number: float, **sender: int) -> Any:
    return heard(mavlink.MAVLink_param_value_message(name.encode(), number, 9, 1, 0), **sender)


def home(lat: int, lon: int) -> Any:
    return heard(mavlink.MAVLink_home_position_message(lat, lon, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))


def test_all_are_asked_for_at_once_by_name_and_home_with_them() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    assert not reading.finished
    sent = reading.start(100.0)
    assert [each.get_type() for each in sent] == ["PARAM_REQUEST_READ", "PARAM_REQUEST_READ", "COMMAND_LONG"]
    assert {each.param_index for each in sent[:2]} == {-1}
    assert (sent[2].command, sent[2].param1) == (mavlink.MAV_CMD_REQUEST_MESSAGE, 242)
    assert reading.next_deadline() == 101.5
    assert not reading.finished


def test_it_is_finished_with_the_last_answer_and_home_is_not_waited_for() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(100.0)
    assert reading.handle(value("FS_ACTION", 2.0))
    assert reading.next_deadline() is not None
    assert reading.handle(value("FENCE_ENABLE", 0.0))
    assert reading.finished
    assert reading.next_deadline() is None
    assert dict(reading.values) == {"FS_ACTION": 2.0, "FENCE_ENABLE": 0.0}
    assert reading.home_deg is None


def test_only_what_is_missing_is_asked_for_again() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(100.0)
    reading.handle(value("FS_ACTION", 2.0))
    reading.handle(home(335_000_000, -1_185_000_000))
    assert reading.on_deadline(101.4) == []
    (again,) = reading.on_deadline(101.5)
    assert (again.get_type(), again.param_id) == ("PARAM_REQUEST_READ", "FENCE_ENABLE")


def test_who_never_answers_is_asked_six_times() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    rounds = 0
    sent = reading.start(0.0)
    while sent:
        rounds += 1
        deadline = reading.next_deadline()
        assert deadline is not None
        sent = reading.on_deadline(deadline)
    assert rounds == 6
    assert reading.finished
    assert not reading.values
    assert reading.on_deadline(1e9) == []


def test_a_vehicle_whose_time_runs_faster_is_asked_sooner_at_first() -> None:
    reading = ParameterReading(NAMES, ROUTE, time_scale=0.1)
    reading.start(0.0)
    first = reading.next_deadline()
    assert first == pytest.approx(0.15)
    for _ in range(5):
        reading.on_deadline(reading.next_deadline() or 0.0)
    last = reading.next_deadline()
    assert last is not None
    assert last <= first + 5 * 1.5


def test_only_news_are_told_as_news() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(0.0)
    assert reading.handle(value("FS_ACTION", 2.0))
    assert not reading.handle(value("FS_ACTION", 2.0))
    assert reading.handle(value("FS_ACTION", 1.0)), "a ground station has changed it"
    assert not reading.handle(value("RC1_MIN", 1100.0)), "nobody asked for that"
    assert not reading.handle(value("FENCE_ENABLE", 1.0, component_id=100)), "a camera has parameters too"
    assert not reading.handle(value("FENCE_ENABLE", 1.0, system_id=2))
    assert dict(reading.values) == {"FS_ACTION": 1.0}


@pytest.mark.parametrize(
    ("lat", "lon"), [(0, 0), (900_000_001, 0), (-(2**31), 5), (5, 1_800_000_001), (5, -(2**31))]
)
def test_a_home_that_is_no_place_is_not_believed(lat: int, lon: int) -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(0.0)
    assert not reading.handle(home(lat, lon))
    assert reading.home_deg is None


def test_home_is_told_once_and_again_when_it_moves() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(0.0)
    assert reading.handle(home(335_000_000, -1_185_000_000))
    assert not reading.handle(home(335_000_000, -1_185_000_000))
    assert reading.handle(home(336_000_000, -1_185_000_000))
    assert reading.home_deg == pytest.approx((33.6, -118.5))
    assert [each.get_type() for each in reading.start(9.0)] == ["PARAM_REQUEST_READ"] * 2


def test_what_is_known_is_not_asked_for_by_a_second_start() -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(0.0)
    for name in NAMES:
        reading.handle(value(name, 1.0))
    reading.handle(home(335_000_000, -1_185_000_000))
    assert reading.start(50.0) == []
    assert reading.finished


@pytest.mark.parametrize("number", [float("nan"), float("inf"), float("-inf")])
def test_a_value_that_is_no_number_is_no_answer(number: float) -> None:
    reading = ParameterReading(NAMES, ROUTE)
    reading.start(0.0)
    assert not reading.handle(value("FS_ACTION", number))
    assert not reading.values
