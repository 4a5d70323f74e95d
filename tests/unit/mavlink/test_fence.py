"""Fences as autopilots send them, and items that make none."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.fence import FenceError, Zone, parse_fence
from autonomy.mavlink.mission_items import MissionItem

STAY_IN = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
KEEP_OUT = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE_IN = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
CIRCLE_OUT = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
RETURN_POINT = mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT


def item(command: int, param1: float, lat: int = 335_000_000, lon: int = -1_185_000_000) -> MissionItem:
    return MissionItem(mavlink.MAV_FRAME_GLOBAL, command, lat, lon, param1=param1)


def polygon(command: int, count: int, told: float | None = None) -> list[MissionItem]:
    told = float(count) if told is None else told
    return [item(command, told, 335_000_000 + 1000 * k, -1_185_000_000) for k in range(count)]


def test_no_items_are_no_fence() -> None:
    assert parse_fence([]) == ()


def test_zones_come_in_their_order_with_degrees() -> None:
    zones = parse_fence(
        [*polygon(STAY_IN, 4), item(CIRCLE_OUT, 75.0), *polygon(KEEP_OUT, 3), item(CIRCLE_IN, 2000.0)]
    )
    assert [(zone.is_inclusion, len(zone.corners_deg), zone.radius_m) for zone in zones] == [
        (True, 4, None),
        (False, 1, 75.0),
        (False, 3, None),
        (True, 1, 2000.0),
    ]
    assert zones[0].corners_deg[2] == pytest.approx((33.5002, -118.5))


def test_two_polygons_of_one_kind_are_told_apart_by_their_counts() -> None:
    zones = parse_fence([*polygon(STAY_IN, 3), *polygon(STAY_IN, 3), *polygon(STAY_IN, 5)])
    assert [len(zone.corners_deg) for zone in zones] == [3, 3, 5]


def test_the_return_point_of_older_autopilots_is_no_zone() -> None:
    assert parse_fence([item(RETURN_POINT, 0.0), item(CIRCLE_IN, 9.0)]) == (
        Zone(True, ((pytest.approx(33.5), pytest.approx(-118.5)),), 9.0),
    )


@pytest.mark.parametrize("told", [0.0, 1.0, 2.0, 5.0, 3.5, -1.0, math.nan, math.inf, -math.inf, 3e38])
def test_a_polygon_whose_vertices_are_not_there_is_refused(told: float) -> None:
    with pytest.raises(FenceError, match="item 1 of the fence begins a polygon"):
        parse_fence([item(CIRCLE_IN, 9.0), *polygon(STAY_IN, 4, told)])


def test_a_polygon_that_another_interrupts_is_refused() -> None:
    with pytest.raises(FenceError, match="which are not there"):
        parse_fence([*polygon(STAY_IN, 2, 3.0), *polygon(KEEP_OUT, 3)])


@pytest.mark.parametrize("radius_m", [0.0, -5.0, math.nan, math.inf])
def test_a_circle_without_a_radius_is_refused(radius_m: float) -> None:
    with pytest.raises(FenceError, match="circle with a radius of"):
        parse_fence([item(CIRCLE_OUT, radius_m)])


def test_what_is_no_part_of_a_fence_is_refused() -> None:
    with pytest.raises(FenceError, match="item 1 of the fence is a command 16"):
        parse_fence([item(CIRCLE_IN, 9.0), item(mavlink.MAV_CMD_NAV_WAYPOINT, 0.0)])


@pytest.mark.parametrize(("lat", "lon"), [(900_000_001, 0), (-(2**31), 0), (0, 1_800_000_001), (0, -(2**31))])
@pytest.mark.parametrize("command", [CIRCLE_IN, STAY_IN])
def test_a_place_that_is_not_on_earth_is_refused(lat: int, lon: int, command: int) -> None:
    """Integers of 32 bits reach to 214 degrees; in local metres that is nowhere."""
    items = [item(command, 3.0), item(command, 3.0, lat, lon), item(command, 3.0)]
    with pytest.raises(FenceError, match="no such place"):
        parse_fence(items)


def test_the_ends_of_the_earth_are_on_it() -> None:
    zones = parse_fence([item(CIRCLE_IN, 3.0, 900_000_000, -1_800_000_000)])
    assert zones[0].corners_deg == ((pytest.approx(90.0), pytest.approx(-180.0)),)
