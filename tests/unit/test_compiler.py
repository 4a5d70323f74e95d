"""Mission items of a plan: a place for each corner, and a radius at which the next leg can be met."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.compiler import LEAST_RADIUS_M, Handling, acceptance_radii_m, compile_mission, handling_of
from autonomy.config import Configuration
from autonomy.geometry import LocalFrame
from autonomy.planning.plan import Plan

FRAME = LocalFrame(33.5, -118.5)
BOAT = Handling(speed_mps=3.0, turn_rate_rad_s=0.3, clearance_m=1000.0)
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]


def radii(*points, **changes):
    return acceptance_radii_m(np.array(points, dtype=float), Handling(**{**vars(BOAT), **changes}))


@pytest.mark.parametrize("angle_deg", [30.0, 60.0, 90.0, 120.0])
def test_a_boat_that_turns_at_the_radius_comes_out_on_the_next_leg(angle_deg):
    """Sailed in small steps with the turn rate that was given: on the next leg it is aligned and on the line."""
    angle = math.radians(angle_deg)
    out = np.array([math.cos(angle), math.sin(angle)])
    radius_m = radii((-500.0, 0.0), (0.0, 0.0), tuple(500.0 * out))[0]
    position, heading, step_s = np.array([-radius_m, 0.0]), 0.0, 1e-3
    while heading < angle:
        heading += BOAT.turn_rate_rad_s * step_s
        position += BOAT.speed_mps * step_s * np.array([math.cos(heading), math.sin(heading)])
    across_m = abs(position[0] * out[1] - position[1] * out[0])
    assert across_m < 0.05
    assert position @ out == pytest.approx(radius_m, abs=0.05)


def test_straight_on_and_at_the_end_nothing_is_cut():
    assert radii((0, 0), (100, 0), (200, 0)) == [LEAST_RADIUS_M, LEAST_RADIUS_M]


def test_a_corner_is_cut_by_no_more_than_half_the_clearance_or_the_leg():
    reversal = [(0, 0), (500, 0), (10, 0)]
    assert radii(*reversal)[0] == pytest.approx(10.0 * math.tan(math.radians(75.0)))
    assert radii(*reversal, clearance_m=12.0)[0] == 6.0
    assert radii((0, 0), (500, 0), (500, 14.0))[0] == 7.0
    assert radii(*reversal, clearance_m=0.0)[0] == LEAST_RADIUS_M


def test_a_radius_that_is_set_is_sent():
    assert radii((0, 0), (500, 0), (500, 3.0), fixed_radius_m=15.0) == [15.0, 15.0]


coordinates = st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4))


@given(
    st.lists(coordinates, min_size=2, max_size=12), st.floats(0, 20), st.floats(0.02, 6), st.floats(0, 500)
)
def test_radii_stay_within_their_bounds(points, speed_mps, turn_rate_rad_s, clearance_m):
    found = radii(*points, speed_mps=speed_mps, turn_rate_rad_s=turn_rate_rad_s, clearance_m=clearance_m)
    assert len(found) == len(points) - 1
    assert all(LEAST_RADIUS_M <= radius <= max(LEAST_RADIUS_M, 0.5 * clearance_m) for radius in found)


def test_each_corner_is_an_item_and_the_boat_holds_at_spots():
    corners = np.array([(100.0, 0.0), (100.0, 100.0), (0.0, 100.0)])
    plan = Plan(np.zeros(2), corners, np.array([True, False, True]), 0.0, "paper", "test")
    items = compile_mission(plan, FRAME, Handling(**{**vars(BOAT), "hold_s": 20.0}))
    places = FRAME.to_local(*np.transpose([(item.lat_deg, item.lon_deg) for item in items]))
    np.testing.assert_allclose(places, corners, atol=0.02)
    assert [item.param1 for item in items] == [20.0, 0.0, 20.0]


def test_the_clearance_is_the_smaller_of_what_is_kept_from_land_and_fence():
    sections = {"survey": {"area": AREA, "standoff_m": 50.0}, "authority": {"fence_margin_m": 8.0}}
    made = handling_of(Configuration.model_validate(sections), 2.0)
    assert (made.clearance_m, made.speed_mps, made.fixed_radius_m) == (8.0, 2.0, None)
    assert made.turn_rate_rad_s == pytest.approx(math.radians(20.0))
