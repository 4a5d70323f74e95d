"""Telemetry: choosing the autopilot, following its state, pairing readings with positions."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.geometry import LocalFrame
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.pairing import Intake, Observation
from autonomy.mavlink.telemetry import Telemetry


class Vehicle:
    """Makes messages as they arrive from one component of a vehicle."""

    def __init__(self, system_id: int = 1, component_id: int = 1) -> None:
        self.codec = Codec(system_id, component_id)

    def say(self, message: Any) -> Any:
        return Codec(1, 191).decode(self.codec.encode(message))[0]

    def heartbeat(self, mode: int = 4, armed: bool = False, autopilot: int = 3, kind: int = 11) -> Any:
        base = 81 | (128 if armed else 0)
        return self.say(mavlink.MAVLink_heartbeat_message(kind, autopilot, base, mode, 4, 3))

    def position(
        self, time_s: float, lat: float = 33.0, lon: float = -118.0, heading_deg: float = 90.0
    ) -> Any:
        hdg = round(heading_deg * 100)
        fields = (round(time_s * 1000), round(lat * 1e7), round(lon * 1e7), 0, 0, 30, 40, 0, hdg)
        return self.say(mavlink.MAVLink_global_position_int_message(*fields))

    def reading(self, time_s: float, value: float, name: bytes = b"SALT") -> Any:
        return self.say(mavlink.MAVLink_named_value_float_message(round(time_s * 1000), name, value))


def ready(**options: Any) -> tuple[Telemetry, Vehicle]:
    telemetry, boat = Telemetry("SALT", **options), Vehicle()
    telemetry.handle(0.0, boat.heartbeat())
    return telemetry, boat


def test_the_autopilot_is_the_first_component_that_is_one() -> None:
    telemetry = Telemetry("SALT")
    station, camera, boat, other = Vehicle(255, 190), Vehicle(1, 100), Vehicle(1, 1), Vehicle(2, 1)
    telemetry.handle(0.0, station.heartbeat(autopilot=8, kind=6))
    telemetry.handle(0.0, camera.heartbeat(autopilot=8, kind=30))
    telemetry.handle(0.0, Vehicle(255, 1).heartbeat(autopilot=3, kind=6))
    assert telemetry.state is None
    telemetry.handle(0.0, boat.heartbeat(mode=10, armed=True))
    telemetry.handle(0.1, other.heartbeat(mode=0))
    assert telemetry.state is not None
    assert (telemetry.state.system_id, telemetry.state.component_id) == (1, 1)
    assert (telemetry.state.mode, telemetry.state.armed) == (10, True)
    telemetry.handle(0.2, other.position(1.0))
    assert telemetry.state.lat_deg is None


def test_a_configured_system_is_waited_for() -> None:
    telemetry = Telemetry("SALT", vehicle_system_id=2)
    telemetry.handle(0.0, Vehicle(1, 1).heartbeat())
    assert telemetry.state is None
    telemetry.handle(0.0, Vehicle(2, 1).heartbeat())
    assert telemetry.state is not None


def test_a_reading_with_the_time_of_a_fix_gets_that_fix() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0, 33.1, -118.2))
    (observation,) = telemetry.handle(0.0, boat.reading(10.0, 33.5))
    assert (observation.model_time_s, observation.value) == (10.0, 33.5)
    assert observation.lat_deg == pytest.approx(33.1, abs=1e-7)
    assert observation.lon_deg == pytest.approx(-118.2, abs=1e-7)


def test_a_reading_between_two_fixes_is_interpolated() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0, 33.0, -118.0))
    assert telemetry.handle(0.2, boat.reading(10.25, 33.5)) == []
    (observation,) = telemetry.handle(1.0, boat.position(11.0, 33.4, -118.8))
    assert observation.lat_deg == pytest.approx(33.1, abs=1e-7)
    assert observation.lon_deg == pytest.approx(-118.2, abs=1e-7)


def test_interpolation_goes_the_short_way_over_the_antimeridian() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0, 0.5, 179.9999))
    telemetry.handle(0.2, boat.reading(10.75, 33.5))
    (observation,) = telemetry.handle(1.0, boat.position(11.0, 0.5, -179.9999))
    assert observation.lon_deg == pytest.approx(-179.99995, abs=1e-6)


def test_readings_far_from_any_fix_are_dropped() -> None:
    telemetry, boat = ready(pairing_gap_s=1.0)
    assert telemetry.handle(0.0, boat.reading(5.0, 1.0)) == []
    telemetry.handle(0.0, boat.position(10.0))
    telemetry.handle(1.0, boat.reading(11.5, 1.0))
    assert telemetry.handle(3.0, boat.position(13.0)) == []
    assert telemetry.dropped == {"older than every fix": 1, "no fix near in time": 1}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_values_that_are_no_numbers_are_passed_on_once(value: float) -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0))
    (observation,) = telemetry.handle(0.0, boat.reading(10.0, value))
    assert repr(observation.value) == repr(value)
    assert telemetry.handle(0.0, boat.reading(10.0, value)) == []
    assert telemetry.dropped == {"repeated": 1}


def test_names_are_compared_as_the_wire_cuts_them() -> None:
    telemetry, boat = Telemetry("SALINITY_PROBE"), Vehicle()
    telemetry.handle(0.0, boat.heartbeat())
    telemetry.handle(0.0, boat.position(10.0))
    assert len(telemetry.handle(0.0, boat.reading(10.0, 1.0, b"SALINITY_P"))) == 1
    assert telemetry.handle(0.0, boat.reading(10.0, 2.0, b"SALINITY")) == []


def test_names_may_be_text_padded_with_zeros() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0))
    message = boat.reading(10.0, 1.0)
    message.name = "SALT\0\0\0"
    assert len(telemetry.handle(0.0, message)) == 1


def test_a_doubled_reading_counts_once() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0))
    message = boat.reading(10.0, 33.5)
    assert len(telemetry.handle(0.0, message)) == 1
    assert telemetry.handle(0.1, message) == []
    assert telemetry.dropped["repeated"] == 1


def test_another_components_reading_is_timed_by_its_arrival() -> None:
    telemetry, boat = ready()
    probe = Vehicle(1, 191)
    for step in range(20):
        telemetry.handle(step * 0.5, boat.position(100 + step * 0.5, 33.0 + step * 0.001))
    assert telemetry.handle(9.75, probe.reading(3.0, 33.5)) == []
    (observation,) = telemetry.handle(10.0, boat.position(110.0, 33.020))
    assert observation.model_time_s == pytest.approx(109.75)
    assert observation.lat_deg == pytest.approx(33.0195, abs=1e-6)


def test_a_probe_without_a_clock_is_heard_at_every_reading() -> None:
    telemetry, boat = ready()
    probe = Vehicle(1, 191)
    telemetry.handle(0.0, boat.position(10.0))
    for step in range(4):
        telemetry.handle(0.1 + 0.1 * step, probe.reading(0.0, 33.5))
    assert len(telemetry.handle(1.0, boat.position(11.0))) == 4


def test_a_probe_without_a_clock_may_say_the_same_for_hours() -> None:
    """Its packets' numbers come again after 256, and a probe that rounds to a hundredth repeats itself."""
    telemetry, boat = ready()
    probe = Vehicle(1, 191)
    observations: list[Observation] = []
    for step in range(1000):
        message = probe.reading(0.0, 33.5)
        observations += telemetry.handle(float(step), message)
        observations += telemetry.handle(step + 0.3, message)  # on a second way
        observations += telemetry.handle(step + 0.5, boat.position(10.5 + step))
    assert len(observations) == 1000 - 1  # one before the first position
    assert telemetry.dropped["repeated"] == 1000 - 1


def test_a_zero_stamp_of_the_autopilots_own_says_nothing_about_its_clock() -> None:
    telemetry, boat = ready()
    observations: list[Observation] = []
    for step in range(1, 41):
        now = step * 0.25
        for number in range(3):
            observations += telemetry.handle(now, boat.reading(0.0, 33.0 + number))
        observations += telemetry.handle(now, boat.position(100 + now))
    assert telemetry.reboots == 0
    assert len(observations) == 3 * 39
    assert observations[-1].model_time_s == pytest.approx(110.0, abs=0.3)


def test_readings_of_another_system_are_not_ours() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0))
    assert telemetry.handle(0.0, Vehicle(2, 1).reading(10.0, 1.0)) == []
    assert telemetry.dropped["not from our vehicle"] == 1


def test_positions_without_a_fix_are_no_positions() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.position(10.0, 0.0, 0.0))
    assert telemetry.handle(0.0, boat.reading(10.0, 1.0)) == []
    assert telemetry.state is not None
    assert not telemetry.state.position_ok


def test_a_reboot_is_counted_and_pairs_nothing_across_it() -> None:
    telemetry, boat = ready()
    for step in range(20):
        telemetry.handle(step * 0.5, boat.position(100 + step * 0.5))
    telemetry.handle(9.6, boat.reading(109.6, 1.0))
    observations: list[Observation] = []
    for step in range(20):
        observations += telemetry.handle(60 + step * 0.5, boat.position(2 + step * 0.5, 34.0))
    assert telemetry.reboots == 1
    assert observations == []
    (observation,) = telemetry.handle(69.5, boat.reading(11.5, 1.0))
    assert observation.lat_deg == pytest.approx(34.0)
    assert observation.model_time_s == pytest.approx(169.0, abs=1.0)


def test_lost_after_five_heartbeats() -> None:
    telemetry, boat = ready()
    for second in range(1, 10):
        telemetry.handle(float(second), boat.heartbeat())
    assert not telemetry.lost(13.9)
    assert telemetry.lost(14.1)


def test_fast_heartbeats_are_missed_sooner() -> None:
    telemetry, boat = ready()
    for step in range(1, 50):
        telemetry.handle(step * 0.1, boat.heartbeat())
    assert not telemetry.lost(4.9 + 1.9)
    assert telemetry.lost(4.9 + 2.1)


def test_nothing_is_lost_before_it_was_found() -> None:
    assert not Telemetry("SALT").lost(1e9)


def test_mission_progress_texts_battery_and_estimator() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_mission_current_message(3, 12, 3, 0)))
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_mission_item_reached_message(2)))
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_mission_item_reached_message(3)))
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_statustext_message(4, b"EKF variance")))
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_ekf_status_report_message(0x9F, 0, 0, 0, 0, 0)))
    system = (0, 0, 0, 0, 12_600, -1, 80, 0, 0, 0, 0, 0, 0)
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_sys_status_message(*system)))
    state = telemetry.state
    assert state is not None
    assert (state.mission_current, state.mission_total, state.mission_state) == (3, 12, 3)
    assert (state.battery_voltage_v, state.battery_remaining) == (12.6, 0.8)
    assert state.ekf_ok is False
    assert telemetry.take_reached() == [2, 3]
    assert telemetry.take_reached() == []
    assert [(each.severity, each.text) for each in telemetry.take_texts()] == [(4, "EKF variance")]
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_ekf_status_report_message(0x1F, 0, 0, 0, 0, 0)))
    telemetry.handle(0.0, boat.position(1.0))
    assert telemetry.state is not None
    assert telemetry.state.ekf_ok is True
    assert telemetry.state.position_ok
    assert telemetry.state.groundspeed_mps == pytest.approx(0.5)
    assert telemetry.state.heading_deg == 90.0


@given(order=st.permutations(range(12)), doubled=st.sets(st.integers(0, 11)))
def test_over_a_doubling_reordering_link_each_reading_counts_at_most_once_and_where_it_was(
    order: list[int], doubled: set[int]
) -> None:
    telemetry, boat = ready()
    observations: list[Observation] = []

    def deliver(now: float, message: Any) -> None:
        observations.extend(telemetry.handle(now, message))

    # Positions and readings alternate, ten model seconds a second; a shuffled dozen spans 0.6 s.
    packets = []
    for step in range(12):
        time_s = 100 + step * 0.5
        if step % 2:
            packets.append(boat.reading(time_s, float(step)))
        else:
            packets.append(boat.position(time_s, 33 + time_s / 1000))
    for step in range(20):
        telemetry.handle(step * 0.25, boat.position(50 + step * 2.5, 33.0 + (50 + step * 2.5) / 1000))
    for place, step in enumerate(order):
        for _ in range(2 if step in doubled else 1):
            deliver(5.0 + place * 0.05, packets[step])
    deliver(6.0, boat.position(107.0, 33 + 107 / 1000))
    assert len({observation.value for observation in observations}) == len(observations)
    for observation in observations:
        assert observation.model_time_s == pytest.approx(100 + observation.value * 0.5)
        assert observation.lat_deg == pytest.approx(33 + observation.model_time_s / 1000, abs=1e-6)


def battery(*, consumed_hj: int = -1, drawn_mah: int = -1, remaining: int = -1, number: int = 0) -> object:
    """BATTERY_STATUS; -1 is unknown."""
    volts = [12_600, *[0xFFFF] * 9]
    return mavlink.MAVLink_battery_status_message(
        number, 0, 0, 0, volts, -1, drawn_mah, consumed_hj, remaining
    )


def test_energy_and_charge_come_in_joules_and_coulombs_and_minus_one_is_unknown() -> None:
    telemetry, boat = ready()
    telemetry.handle(0.0, boat.say(battery()))
    state = telemetry.state
    assert state is not None
    assert (state.battery_consumed_j, state.battery_drawn_c, state.battery_remaining) == (None, None, None)
    telemetry.handle(0.0, boat.say(battery(consumed_hj=36, drawn_mah=1000, remaining=55)))
    telemetry.handle(0.0, boat.say(battery(consumed_hj=99, number=1)))  # another battery
    telemetry.handle(0.0, boat.say(battery(remaining=54)))
    state = telemetry.state
    assert state is not None
    assert state.battery_consumed_j == 3600.0  # a watt-hour
    assert state.battery_drawn_c == 3600.0  # an ampere-hour
    assert state.battery_remaining == 0.54


def test_home_is_where_the_autopilot_says_unless_it_has_none() -> None:
    telemetry, boat = ready()
    rest = (0, 0.0, 0.0, 0.0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0)
    for lat, lon in ((0, 0), (910_000_000, 0)):
        telemetry.handle(0.0, boat.say(mavlink.MAVLink_home_position_message(lat, lon, *rest)))
    assert telemetry.state is not None
    assert telemetry.state.home_deg is None
    telemetry.handle(0.0, boat.say(mavlink.MAVLink_home_position_message(335_000_000, -1_185_000_000, *rest)))
    assert telemetry.state.home_deg == pytest.approx((33.5, -118.5))


def test_a_reading_of_the_past_is_placed_where_its_water_was_taken_in() -> None:
    """Its sender is another component, which stamps by the autopilot's clock; nothing of it moves that clock."""
    telemetry, boat = ready(stamped_by_vehicle=True)
    bridge = Vehicle(1, 158)
    for second in range(20):
        telemetry.handle(second, boat.position(100.0 + second, lat=33.0 + 1e-4 * second))
    (observation,) = telemetry.handle(19.0, bridge.reading(106.5, 34.0))
    assert observation.model_time_s == pytest.approx(106.5)
    assert observation.lat_deg == pytest.approx(33.00065, abs=1e-7)
    assert telemetry.model_time(19.0) == 119.0


@pytest.mark.parametrize("stamp_s", [121.0, 5000.0, 20.0])
def test_stamps_that_are_not_of_the_vehicles_clock_teach_nothing(stamp_s: float) -> None:
    telemetry, boat = ready(stamped_by_vehicle=True)
    for second in range(20):
        telemetry.handle(second, boat.position(100.0 + second))
    assert telemetry.handle(19.0, Vehicle(1, 158).reading(stamp_s, 34.0)) == []
    assert telemetry.dropped == {"time unknown": 1}
    assert telemetry.clock_breaks == 0


def test_stamps_of_before_the_wrap_are_understood_after_it() -> None:
    telemetry, boat = ready(stamped_by_vehicle=True)
    wrap_s = 2**32 / 1000
    for second in range(-10, 10):
        telemetry.handle(second + 10, boat.position((wrap_s + second) % wrap_s))
    (observation,) = telemetry.handle(19.0, Vehicle(1, 158).reading(wrap_s - 4.5, 34.0))
    assert observation.model_time_s == pytest.approx(wrap_s - 4.5)


@pytest.mark.parametrize(
    ("heading_deg", "east_m", "north_m"),
    [(0.0, 1.0, 3.0), (90.0, 3.0, -1.0), (225.0, -2 * 2**0.5, -(2**0.5))],
)
def test_the_place_of_a_reading_is_the_intakes(heading_deg: float, east_m: float, north_m: float) -> None:
    """Three metres ahead of the antenna and one to starboard of it; the truth is pyproj's."""
    telemetry, boat = ready(intake=Intake(3.0, 1.0))
    telemetry.handle(0.0, boat.position(10.0, 60.0, 5.0, heading_deg))
    (observation,) = telemetry.handle(0.0, boat.reading(10.0, 34.0))
    place = LocalFrame(60.0, 5.0).to_local(observation.lat_deg, observation.lon_deg)
    assert place == pytest.approx([east_m, north_m], abs=1e-3)


def test_between_two_headings_it_is_turned_the_short_way() -> None:
    telemetry, boat = ready(intake=Intake(10.0, 0.0))
    telemetry.handle(0.0, boat.position(10.0, 60.0, 5.0, 350.0))
    telemetry.handle(0.1, boat.position(10.5, 60.0, 5.0, 10.0))
    (observation,) = telemetry.handle(0.2, boat.reading(10.25, 34.0))
    assert LocalFrame(60.0, 5.0).to_local(observation.lat_deg, observation.lon_deg) == pytest.approx(
        [0.0, 10.0], abs=1e-3
    )


def test_without_a_heading_nobody_knows_where_the_intake_is() -> None:
    telemetry, boat = ready(intake=Intake(3.0, 0.0))
    telemetry.handle(0.0, boat.position(10.0, heading_deg=655.35))
    assert telemetry.handle(0.0, boat.reading(10.0, 34.0)) == []
    assert telemetry.dropped == {"no heading to find the intake by": 1}
