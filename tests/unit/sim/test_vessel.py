"""Kinematics: arriving, turning, crabbing, stopping at the shore."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from sim.vessel import (
    Battery,
    Handling,
    Leg,
    Position,
    UniformCurrent,
    UnsteadyCurrent,
    Vessel,
    angle_between_deg,
)

GEOD = Geod(ellps="WGS84")
START = Position(33.7, -118.4)


class Shore:
    """Land everywhere north of a latitude."""

    def __init__(self, lat_deg: float) -> None:
        self.lat_deg = lat_deg

    def value(self, lat_deg, lon_deg, time_s):
        return np.where(np.asarray(lat_deg) > self.lat_deg, np.nan, 33.0)

    def is_land(self, lat_deg, lon_deg):
        return np.asarray(lat_deg) > self.lat_deg


def geodesic_m(a: Position, b: Position) -> float:
    return GEOD.inv(a.lon_deg, a.lat_deg, b.lon_deg, b.lat_deg)[2]


def across_m(vessel: Vessel, leg: Leg) -> float:
    """Distance of the vessel from the straight line of a leg."""
    x, y = leg.origin.offset_to(leg.destination)
    px, py = leg.origin.offset_to(vessel.position)
    return abs(px * y - py * x) / math.hypot(x, y)


def sail(vessel: Vessel, leg: Leg, speed_mps: float, radius_m: float, dt_s: float, most_s: float) -> bool:
    for _ in range(int(most_s / dt_s)):
        vessel.follow(leg, speed_mps, dt_s)
        if vessel.passed(leg, radius_m):
            return True
    return False


@given(
    azimuth=st.floats(0.0, 360.0),
    distance_m=st.floats(1.0, 15_000.0),
    lat=st.floats(-65.0, 65.0),
)
def test_distances_agree_with_the_geodesic(azimuth, distance_m, lat):
    here = Position(lat, 12.0)
    lon, lat_there, _ = GEOD.fwd(here.lon_deg, here.lat_deg, azimuth, distance_m)
    assert here.distance_to(Position(lat_there, lon)) == pytest.approx(distance_m, abs=0.1)


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0, 270.0])
def test_a_run_of_15_km_in_small_steps_is_as_long_on_the_ellipsoid(heading_deg):
    here, bearing = START, math.radians(heading_deg)
    for _ in range(3000):
        here = here.moved(5.0 * math.sin(bearing), 5.0 * math.cos(bearing))
    assert geodesic_m(START, here) == pytest.approx(15_000.0, abs=0.1)


@settings(deadline=None, max_examples=30)
@given(
    azimuth=st.floats(0.0, 360.0),
    heading=st.floats(0.0, 359.0),
    east=st.floats(-1.2, 1.2),
    north=st.floats(-1.2, 1.2),
)
def test_it_arrives_whatever_the_current_that_is_weaker_than_the_boat(azimuth, heading, east, north):
    lon, lat, _ = GEOD.fwd(START.lon_deg, START.lat_deg, azimuth, 800.0)
    leg = Leg(START, Position(lat, lon))
    vessel = Vessel(START, heading_deg=heading, current=UniformCurrent(east, north))
    assert sail(vessel, leg, 2.0, 5.0, 1.0, most_s=6000.0)
    assert geodesic_m(vessel.position, leg.destination) < 10.0


def test_it_keeps_to_the_line_in_a_cross_current():
    lon, lat, _ = GEOD.fwd(START.lon_deg, START.lat_deg, 90.0, 3000.0)
    leg = Leg(START, Position(lat, lon))
    vessel = Vessel(START, heading_deg=90.0, current=UniformCurrent(0.0, 0.8))
    off = []
    while not vessel.passed(leg, 2.0):
        vessel.follow(leg, 2.0, 1.0)
        off.append(across_m(vessel, leg))
    assert max(off[100:]) < 1.0
    assert max(off) < 25.0
    # The water's speed is 0.8 across 2.0 through it, so 1.83 m/s are made good.
    assert vessel.time_s == pytest.approx(3000.0 / math.sqrt(2.0**2 - 0.8**2), rel=0.02)


def test_a_15_km_leg_ends_within_a_metre():
    lon, lat, _ = GEOD.fwd(START.lon_deg, START.lat_deg, 250.0, 15_000.0)
    leg = Leg(START, Position(lat, lon))
    vessel = Vessel(START, heading_deg=250.0)
    assert sail(vessel, leg, 5.0, 0.5, 0.1, most_s=4000.0)
    assert geodesic_m(vessel.position, leg.destination) < 1.0


@pytest.mark.parametrize("dt_s", [0.05, 0.5, 1.0])
def test_turn_rate_and_acceleration_are_limits(dt_s):
    handling = Handling(acceleration_mps2=0.4, turn_rate_deg_s=7.0)
    vessel = Vessel(START, handling=handling)
    leg = Leg(START, START.moved(-300.0, -300.0))
    while vessel.time_s < 60.0:
        heading, speed = vessel.heading_deg, vessel.speed_mps
        vessel.follow(leg, 3.0, dt_s)
        assert abs(angle_between_deg(heading, vessel.heading_deg)) <= 7.0 * dt_s + 1e-9
        assert abs(vessel.speed_mps - speed) <= 0.4 * dt_s + 1e-9


def test_a_long_step_does_not_jump_over_a_small_circle():
    leg = Leg(START, START.moved(0.0, 100.0))
    vessel = Vessel(START.moved(0.0, 96.0), speed_mps=10.0)
    vessel.follow(leg, 10.0, 1.0)
    assert vessel.position.distance_to(leg.destination) > 2.0
    assert vessel.passed(leg, 1.0)


def test_passing_abeam_counts_as_arriving_but_not_before():
    leg = Leg(START, START.moved(0.0, 100.0))
    vessel = Vessel(START.moved(30.0, 98.0), speed_mps=1.0)
    vessel.drift(1.0)
    assert not vessel.passed(leg, 2.0)
    for _ in range(8):
        vessel.speed_mps = 1.0
        vessel.drift(1.0)
    assert vessel.passed(leg, 2.0)


def test_it_runs_aground_and_stays():
    shore = Shore(START.lat_deg + 0.001)
    vessel = Vessel(START, land=shore, current=UniformCurrent(0.3, 0.3))
    leg = Leg(START, START.moved(0.0, 500.0))
    for _ in range(300):
        vessel.follow(leg, 2.0, 1.0)
    assert vessel.aground
    assert not bool(shore.is_land(*vessel.position))
    assert vessel.ground_speed_mps == 0.0
    assert vessel.position.offset_to(Position(shore.lat_deg, START.lon_deg))[1] < 5.0


def test_it_keeps_station_against_a_current():
    vessel = Vessel(START, current=UniformCurrent(0.5, -0.3))
    worst = 0.0
    for _ in range(900):
        vessel.keep_station(START, 5.0, 2.0, 1.0)
        worst = max(worst, vessel.position.distance_to(START))
    assert worst < 20.0


def test_without_power_it_goes_with_the_water():
    vessel = Vessel(START, current=UniformCurrent(0.4, -0.2))
    for _ in range(100):
        vessel.drift(1.0)
    assert START.offset_to(vessel.position) == pytest.approx((40.0, -20.0), abs=1e-3)
    assert vessel.course_deg == pytest.approx(math.degrees(math.atan2(0.4, -0.2)))


def test_equal_inputs_give_equal_tracks():
    def track() -> list[Position]:
        vessel = Vessel(START, current=UniformCurrent(0.1, 0.2))
        leg = Leg(START, START.moved(200.0, 80.0))
        places = []
        for _ in range(200):
            vessel.follow(leg, 2.0, 0.7)
            places.append(vessel.position)
        return places

    assert track() == track()


@pytest.mark.parametrize("dt_s", [0.0, -1.0, 1.5, math.nan])
def test_steps_outside_their_range_are_refused(dt_s):
    with pytest.raises(ValueError, match="step must be"):
        Vessel(START).drift(dt_s)


def test_a_battery_spends_energy_and_ends_empty():
    battery = Battery(capacity_wh=10.0, hotel_w=36.0, propulsion_w_per_m3s3=0.0)
    battery.drain(0.0, 500.0)
    assert battery.used_wh == pytest.approx(5.0)
    assert battery.remaining == pytest.approx(0.5)
    battery.drain(0.0, 5000.0)
    assert battery.remaining == 0.0


def test_a_battery_counts_charge_and_energy():
    battery = Battery(capacity_wh=1000.0, hotel_w=100.0, propulsion_w_per_m3s3=0.0)
    for _ in range(36):
        battery.drain(0.0, 100.0)
    assert battery.used_wh == pytest.approx(100.0)
    mean_v = 0.5 * (16.8 + 16.8 - 0.36)  # a tenth of what the voltage falls by when it is emptied
    assert battery.drawn_c == pytest.approx(3600.0 * 100.0 / mean_v, rel=1e-3)


def test_waves_make_the_power_swing_about_its_mean():
    battery = Battery(capacity_wh=1e6, hotel_w=100.0, noise=0.2, rng=np.random.default_rng(3))
    powers = []
    for _ in range(20_000):
        battery.drain(0.0, 30.0)
        powers.append(battery.power_w)
    assert np.mean(powers) == pytest.approx(100.0, rel=0.03)
    assert np.std(powers) == pytest.approx(20.0, rel=0.1)
    assert np.corrcoef(powers[:-20], powers[20:])[0, 1] == pytest.approx(math.exp(-1.0), abs=0.1)  # 600 s


def test_an_unsteady_current_swings_about_its_mean_and_is_the_same_for_a_seed():
    rng = np.random.default_rng(5)
    currents = [UnsteadyCurrent.draw((0.3, -0.1), 0.2, rng, count=16) for _ in range(60)]
    values = np.array([each.current(33.0, -118.0, 7200.0 * k) for each in currents for k in range(40)])
    np.testing.assert_allclose(values.mean(axis=0), [0.3, -0.1], atol=0.03)
    np.testing.assert_allclose(values.std(axis=0), 0.2, rtol=0.15)
    one, other = (UnsteadyCurrent.draw((0.0, 0.0), 0.2, np.random.default_rng(1)) for _ in range(2))
    assert one.current(33.0, -118.0, 1e4) == other.current(33.0, -118.0, 1e4)
    near, far = np.subtract(one.current(33.0, -118.0, 0.0), one.current(33.0, -118.0, 60.0)), values.std()
    assert np.hypot(*near) < far  # a minute changes little
