"""The speed that is counted on."""

import math

import pytest

from autonomy.pace import MEMORY_S, Pace


def test_the_usual_speed_gives_way_to_the_measured_one():
    pace = Pace(1.5)
    assert pace.speed_mps == 1.5
    for second in range(601):
        pace.follow(float(second), 3.0)
    # The usual one counts for ten seconds of those that are remembered.
    assert pace.speed_mps == pytest.approx((10.0 * 1.5 + MEMORY_S * 3.0) / (10.0 + MEMORY_S))


def test_a_change_is_followed_within_some_minutes():
    pace = Pace(1.5)
    for second in range(1000):
        pace.follow(float(second), 3.0)
    for second in range(1000, 1000 + 3 * int(MEMORY_S)):
        pace.follow(float(second), 1.0)
    assert pace.speed_mps == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("speed_mps", [None, math.nan, math.inf])
def test_what_is_no_speed_tells_nothing(speed_mps):
    pace = Pace(1.5)
    pace.follow(0.0, 1.0)
    pace.follow(1.0, speed_mps)
    assert pace.speed_mps == 1.5


def test_neither_a_pause_nor_a_clock_that_goes_back_counts_as_time_under_way():
    pace = Pace(1.5)
    pace.follow(0.0, 9.0)
    pace.rest()
    pace.follow(100.0, 9.0)
    pace.follow(50.0, 9.0)
    assert pace.speed_mps == 1.5
