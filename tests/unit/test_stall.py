"""A boat that stays where it is, the water behind its stalls, and whether it makes for its first waypoint."""

import math

import numpy as np
import pytest

from autonomy.stall import CLOSING_S, ClosingWatch, GivenUp, StallWatch


def at(x: float, y: float = 0.0) -> np.ndarray:
    return np.array([x, y])


class TestStallWatch:
    def test_a_boat_that_stays_has_stalled_once_after_its_time(self):
        watch = StallWatch(60.0, 5.0)
        told = [watch.follow(float(t), at(0.03 * t), "a") for t in range(131)]
        # Noticed at the first fix after 60 s, and from then on counted anew: the next could come at 61 + 1 + 60.
        assert [t for t, stalled in enumerate(told) if stalled] == [61, 123]

    def test_a_boat_that_moves_has_not(self):
        watch = StallWatch(60.0, 5.0)
        assert not any(watch.follow(float(t), at(0.1 * t), "a") for t in range(1000))

    def test_slow_circles_within_the_distance_are_no_way(self):
        watch = StallWatch(60.0, 5.0)
        circle = [at(2.0 * math.cos(0.1 * t), 2.0 * math.sin(0.1 * t)) for t in range(100)]
        assert any(watch.follow(float(t), point, "a") for t, point in enumerate(circle))

    def test_another_waypoint_begins_anew(self):
        watch = StallWatch(60.0, 5.0)
        assert not any(watch.follow(float(t), at(0.0), t // 50) for t in range(300))

    def test_a_rest_begins_anew(self):
        watch = StallWatch(60.0, 5.0)
        for t in range(300):
            assert not watch.follow(float(t), at(0.0), "a")
            if t % 50 == 0:
                watch.rest()

    def test_never_is_never(self):
        watch = StallWatch(None, 5.0)
        assert not any(watch.follow(1e4 * t, at(0.0), "a") for t in range(100))


class TestGivenUp:
    def test_water_about_the_waypoint_but_not_where_the_boat_is(self):
        given_up = GivenUp(600.0, 25.0)
        assert given_up.add(0.0, at(0.0), at(400.0)) == 600.0
        (region,) = given_up.regions(0.0)
        assert region.corners_m == ((400.0, 0.0),)
        assert region.radius_m == 300.0
        assert region.radius_m < 400.0, "else the boat would lie in water given up"

    def test_near_its_waypoint_it_is_the_least(self):
        given_up = GivenUp(600.0, 25.0)
        given_up.add(0.0, at(0.0), at(4.0))
        assert given_up.regions(0.0)[0].radius_m == 25.0

    def test_it_is_taken_up_again_to_the_second(self):
        given_up = GivenUp(600.0, 25.0)
        given_up.add(100.0, at(0.0), at(400.0))
        assert len(given_up.regions(699.9)) == 1
        assert given_up.regions(700.0) == ()

    def test_the_next_stall_before_the_same_water_lasts_twice_as_long(self):
        given_up = GivenUp(600.0, 25.0)
        given_up.add(0.0, at(0.0), at(400.0))
        assert given_up.add(1000.0, at(0.0), at(300.0)) == 1200.0
        assert given_up.add(3000.0, at(0.0), at(310.0)) == 2400.0
        assert len(given_up.regions(3000.0)) == 1, "they stand for one place"

    def test_water_elsewhere_is_another_matter(self):
        given_up = GivenUp(600.0, 25.0)
        given_up.add(0.0, at(0.0), at(400.0))
        assert given_up.add(10.0, at(0.0), at(-400.0)) == 600.0
        assert len(given_up.regions(10.0)) == 2

    def test_a_month_of_stalls_does_not_grow_without_end(self):
        """Each at another place: what has long been taken up again is not kept for ever."""
        given_up = GivenUp(600.0, 25.0)
        rng = np.random.default_rng(3)
        for k in range(4000):
            waypoint = rng.uniform(-50e3, 50e3, 2)
            given_up.add(200.0 * k, waypoint + at(200.0), waypoint)
            assert any(region.corners_m[0] == tuple(waypoint) for region in given_up.regions(200.0 * k))
        assert len(given_up._places) <= 64


class TestClosingWatch:
    def test_nothing_begun_is_in_no_doubt(self):
        watch = ClosingWatch()
        assert not watch.open
        assert not any(watch.follow(float(t), 500.0, reached=False) for t in range(100))

    def test_a_boat_that_does_not_come_nearer_is_doubted_once(self):
        watch = ClosingWatch()
        watch.begin("m")
        told = [watch.follow(float(t), 500.0 - 0.1 * t, reached=False) for t in range(100)]
        assert [t for t, doubted in enumerate(told) if doubted] == [int(CLOSING_S) + 1]
        assert not watch.open

    @pytest.mark.parametrize("distance_m", [500.0, 12.0])
    def test_a_boat_that_comes_nearer_is_believed(self, distance_m):
        """Ten metres nearer; of a waypoint that is nearer than twenty, half the way."""
        watch = ClosingWatch()
        watch.begin("m")
        assert not watch.follow(0.0, distance_m, reached=False)
        assert not watch.follow(5.0, distance_m - min(10.0, 0.5 * distance_m) + 0.01, reached=False)
        assert watch.open
        assert not watch.follow(6.0, distance_m - min(10.0, 0.5 * distance_m), reached=False)
        assert not watch.open

    def test_a_boat_that_comes_nearer_on_its_way_elsewhere_is_doubted(self):
        watch = ClosingWatch()
        watch.begin("m")
        told = [watch.follow(float(t), 500.0 - 8.0 * t, reached=False, elsewhere=True) for t in range(30)]
        assert [t for t, doubted in enumerate(told) if doubted] == [int(CLOSING_S) + 1]

    def test_what_the_autopilot_said_of_the_mission_before_is_forgiven(self):
        watch = ClosingWatch()
        watch.begin("m")
        assert not any(
            watch.follow(float(t), 500.0 - 8.0 * t, reached=False, elsewhere=t < 3) for t in range(30)
        )

    def test_a_waypoint_behind_the_boat_needs_no_closing(self):
        watch = ClosingWatch()
        watch.begin("m")
        assert not watch.follow(0.0, 500.0, reached=True)
        assert not watch.open

    def test_a_new_mission_begins_anew(self):
        watch = ClosingWatch()
        watch.begin("m")
        watch.follow(0.0, 500.0, reached=False)
        watch.begin("n")
        assert not any(watch.follow(10.0 + t, 900.0, reached=False) for t in range(int(CLOSING_S)))
