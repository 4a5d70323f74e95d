"""Reading fence, rally points and failsafes from vehicles that answer, refuse, or talk nonsense."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.fence import Zone
from autonomy.mavlink.mission_items import MissionItem, Route
from autonomy.mavlink.safeguards import NAMES, Safeguards, SafeguardsReading

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
BACK = Route(own_system=1, own_component=1, vehicle_system=1, vehicle_component=191)
ARDUPILOT = int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
FENCE, RALLY = mavlink.MAV_MISSION_TYPE_FENCE, mavlink.MAV_MISSION_TYPE_RALLY
SQUARE = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
HOLE = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
DISC = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
LAT, LON = 335_000_000, -1_185_000_000


def heard(message: Any) -> Any:
    return Codec(1, 191).decode(Codec(1, 1).encode(message))[0]


def point(command: int, param1: float = 0.0, north: int = 0) -> MissionItem:
    return MissionItem(mavlink.MAV_FRAME_GLOBAL, command, LAT + north, LON, param1=param1)


FENCE_ITEMS = (*(point(SQUARE, 3.0, k) for k in range(3)), point(HOLE, 50.0))


class Vehicle:
    """Answers what it is asked, with what it has."""

    def __init__(self, parameters: Mapping[str, float], fence: Any = (), rally: Any = ()) -> None:
        self.parameters = dict(parameters)
        self.points = {FENCE: tuple(fence), RALLY: tuple(rally)}
        self.home: tuple[int, int] | None = (LAT, LON)
        self.refuses: tuple[int, ...] = ()

    def answer(self, message: Any) -> list[Any]:
        kind = message.get_type()
        if kind == "PARAM_REQUEST_READ":
            name = (
                bytes(message.param_id).decode() if isinstance(message.param_id, bytes) else message.param_id
            )
            return [self.tell(name)] if name in self.parameters else []
        if kind == "COMMAND_LONG":
            return [] if self.home is None else [self.tell_home()]
        if kind == "MISSION_REQUEST_LIST":
            if message.mission_type in self.refuses:
                return [heard(mavlink.MAVLink_mission_ack_message(1, 191, 3, message.mission_type))]
            items = self.points[message.mission_type]
            return [heard(mavlink.MAVLink_mission_count_message(1, 191, len(items), message.mission_type))]
        if kind == "MISSION_REQUEST_INT":
            sent = self.points[message.mission_type][message.seq].to_message(BACK, message.seq)
            sent.mission_type = message.mission_type
            return [heard(sent)]
        return []

    def tell(self, name: str) -> Any:
        number = self.parameters[name]
        return heard(mavlink.MAVLink_param_value_message(name.encode(), number, 9, 1, 0))

    def tell_home(self) -> Any:
        assert self.home is not None
        return heard(mavlink.MAVLink_home_position_message(*self.home, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0))


ALL_ON = dict.fromkeys(NAMES, 1.0) | {"FENCE_TYPE": 4.0, "FENCE_OPTIONS": 0.0, "FENCE_RADIUS": 300.0}


def serve(reading: SafeguardsReading, vehicle: Vehicle, now: float, sent: list[Any]) -> None:
    """Let the vehicle answer until nothing more is said."""
    while sent:
        sent = [
            more for each in sent for reply in vehicle.answer(each) for more in reading.handle(now, reply)
        ]


def read(vehicle: Vehicle, until_s: float = 60.0) -> SafeguardsReading:
    reading = SafeguardsReading(ROUTE, autopilot=ARDUPILOT)
    serve(reading, vehicle, 0.0, reading.start(0.0))
    run(reading, vehicle, 0.0, until_s)
    return reading


def run(reading: SafeguardsReading, vehicle: Vehicle, now: float, until_s: float) -> list[float]:
    """Serve its deadlines; returns when it said something."""
    spoke = []
    while (deadline := reading.next_deadline()) is not None and deadline <= until_s:
        now = max(now, deadline)
        sent = reading.step(now)
        if sent:
            spoke.append(now)
        serve(reading, vehicle, now, sent)
    return spoke


def test_everything_is_read_without_waiting() -> None:
    rally = [point(mavlink.MAV_CMD_NAV_RALLY_POINT)]
    reading = SafeguardsReading(ROUTE, autopilot=ARDUPILOT)
    assert reading.problem == "the autopilot's fence has not been read yet"
    serve(reading, Vehicle(ALL_ON, FENCE_ITEMS, rally), 5.0, reading.start(5.0))
    known = reading.known
    assert known is not None
    assert reading.problem is None
    assert [len(group) for group in known.inclusions] == [1]
    assert known.exclusions == (Zone(False, ((pytest.approx(33.5), pytest.approx(-118.5)),), 50.0),)
    assert known.summary == "a fence of 2 zones and 1 rally point"
    assert known.warnings == ()
    assert reading.next_deadline() is None
    assert reading.step(1e6) == []


def test_parameters_that_the_vehicle_does_not_know_hold_nothing_up_for_ever() -> None:
    parameters = {name: number for name, number in ALL_ON.items() if name != "BATT_MONITOR"}
    known = read(Vehicle(parameters)).known
    assert known is not None
    assert known.warnings == (
        "the fence is on, and there is none on board",
        "the autopilot does not tell BATT_MONITOR",
    )
    assert known.summary == "no fence and 0 rally points"


def test_each_failsafe_that_is_off_is_told() -> None:
    known = read(Vehicle(dict.fromkeys(NAMES, 0.0))).known
    assert known is not None
    assert len(known.warnings) == 9
    assert all(" 0)" in warning for warning in known.warnings)


def test_zones_are_all_of_them_or_any_of_them_as_the_options_say() -> None:
    two = (*(point(SQUARE, 3.0, k) for k in range(3)), point(DISC, 400.0))
    every = read(Vehicle(ALL_ON, two)).known
    some = read(Vehicle(ALL_ON | {"FENCE_OPTIONS": 2.0}, two)).known
    assert every is not None
    assert some is not None
    assert [len(group) for group in every.inclusions] == [1, 1]
    assert [len(group) for group in some.inclusions] == [2]


def test_a_circle_about_home_is_a_zone_while_the_fence_is_on() -> None:
    circle = ALL_ON | {"FENCE_TYPE": 6.0, "FENCE_RADIUS": 250.0}
    on = read(Vehicle(circle)).known
    off = read(Vehicle(circle | {"FENCE_ENABLE": 0.0})).known
    assert on is not None
    assert off is not None
    assert [zone.radius_m for group in on.inclusions for zone in group] == [250.0]
    assert off.inclusions == ()


def test_without_a_home_such_a_circle_is_waited_for() -> None:
    vehicle = Vehicle(ALL_ON | {"FENCE_TYPE": 2.0})
    vehicle.home = None
    reading = read(vehicle, until_s=20.0)
    assert reading.known is None
    assert "circle about home, which the autopilot does not tell" in str(reading.problem)
    vehicle.home = (LAT, LON)
    run(reading, vehicle, 20.0, 120.0)
    assert reading.known is not None


@pytest.mark.parametrize("radius_m", [0.0, -30.0])
def test_a_circle_about_home_without_a_radius_is_no_fence(radius_m: float) -> None:
    reading = read(Vehicle(ALL_ON | {"FENCE_TYPE": 2.0, "FENCE_RADIUS": radius_m}))
    assert reading.known is None
    assert "with a radius of" in str(reading.problem)


@pytest.mark.parametrize("name", ["FENCE_TYPE", "FENCE_OPTIONS", "FENCE_RADIUS", "FENCE_ENABLE"])
@pytest.mark.parametrize("number", [float("nan"), float("inf"), float("-inf"), 3e38, -3e38])
def test_nonsense_in_any_parameter_of_the_fence_is_survived(name: str, number: float) -> None:
    reading = read(Vehicle(ALL_ON | {"FENCE_TYPE": 6.0} | {name: number}, FENCE_ITEMS))
    assert reading.known is not None or reading.problem


def test_what_can_not_be_understood_is_read_again_with_longer_and_longer_pauses() -> None:
    vehicle = Vehicle(ALL_ON, [point(SQUARE, 4.0)])
    reading = SafeguardsReading(ROUTE, autopilot=ARDUPILOT)
    serve(reading, vehicle, 0.0, reading.start(0.0))
    assert "the fence can't be understood" in str(reading.problem)
    spoke = run(reading, vehicle, 0.0, 400.0)
    begun = [spoke[0]] + [late for early, late in pairwise(spoke) if late - early > 1.0]
    assert [round(later - earlier) for earlier, later in zip([0.0, *begun], begun, strict=False)] == [
        *(5, 10, 20, 40),
        *(60,) * 5,
    ]
    vehicle.points[FENCE] = FENCE_ITEMS
    run(reading, vehicle, 400.0, 500.0)
    assert reading.problem is None


def test_a_vehicle_without_fences_has_none() -> None:
    vehicle = Vehicle(ALL_ON)
    vehicle.refuses = (FENCE, RALLY)
    known = read(vehicle).known
    assert known is not None
    assert not known.has_fence
    assert known.rally_deg == ()


def test_another_fence_is_noticed_and_read_and_the_old_one_holds_meanwhile() -> None:
    vehicle = Vehicle(ALL_ON, FENCE_ITEMS)
    reading = read(vehicle)
    first = reading.known
    vehicle.parameters["FENCE_TOTAL"] = 7.0
    vehicle.points[FENCE] = FENCE_ITEMS[:3]
    assert reading.handle(100.0, vehicle.tell("FENCE_TOTAL")) == []
    assert reading.known is first
    serve(reading, vehicle, 100.1, reading.step(100.1))
    assert reading.known is not first
    assert reading.known is not None
    assert reading.known.exclusions == ()


def test_home_that_moves_matters_to_a_circle_about_it_alone() -> None:
    for fence_type, matters in ((2.0, True), (4.0, False)):
        vehicle = Vehicle(ALL_ON | {"FENCE_TYPE": fence_type}, FENCE_ITEMS)
        reading = read(vehicle)
        vehicle.home = (LAT + 10_000, LON)
        reading.handle(100.0, vehicle.tell_home())
        assert bool(reading.step(100.1)) == matters


def test_a_failsafe_that_is_changed_starts_no_reading() -> None:
    vehicle = Vehicle(ALL_ON, FENCE_ITEMS)
    reading = read(vehicle)
    vehicle.parameters["FS_ACTION"] = 2.0
    reading.handle(100.0, vehicle.tell("FS_ACTION"))
    assert reading.step(100.1) == []


def test_safeguards_of_nothing() -> None:
    nothing = Safeguards((), (), (), {})
    assert not nothing.has_fence
    assert nothing.warnings[0].startswith("the autopilot does not tell FS_ACTION, FS_THR_ENABLE")
