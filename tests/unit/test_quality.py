"""Each test of a reading's quality, and the stream that runs them one reading behind the probe."""

import math

import numpy as np
import pytest
import shapely

from autonomy.config import QualitySection
from autonomy.quality import Check, Flag, QualityControl, Reading, Tally, Waters, aggregate, refused_by
from autonomy.quality.checks import gross_range, spike_height, syntax
from autonomy.quality.flat_line import FEWEST_REPEATS, FlatLine
from autonomy.quality.location import CONSISTENT_READINGS, Location
from autonomy.quality.running import RunningMedian
from autonomy.quality.stream import CONSISTENT_READINGS as CONSISTENT_VALUES
from autonomy.quality.stream import MOST_HELD, WARM_UP

AREA = shapely.box(0.0, 0.0, 10_000.0, 10_000.0)
ISLAND = shapely.box(4000.0, 4000.0, 5000.0, 5000.0)
WATERS = Waters(AREA, ISLAND, 500.0)
GOOD, UNKNOWN, SUSPECT, FAIL, MISSING = Flag
ALL_GOOD = (GOOD,) * len(Check)


def with_flags(**changed):
    return tuple(changed.get(check.name.lower(), GOOD) for check in Check)


class Stream:
    """A probe on a boat that sails east at 2 m/s; a reading a second unless told otherwise."""

    def __init__(self, span=(-math.inf, math.inf), **limits):
        self.quality = QualityControl(QualitySection(**limits), span, WATERS)
        self.judged = []
        self.time_s = 0.0

    def add(self, *values, interval_s=1.0):
        """Returns how many were judged at once."""
        known = len(self.judged)
        for value in values:
            self.time_s += interval_s
            reading = Reading(self.time_s, 100.0 + 2.0 * (self.time_s % 4000.0), 100.0, float(value))
            self.judged += self.quality.add(reading, value)
        return len(self.judged) - known

    def finish(self):
        self.judged += self.quality.flush()
        return self

    def flags(self, check=None):
        return [one.flag if check is None else one.flags[check] for one in self.judged]


def noisy(count, seed=0, noise=0.01):
    return 33.0 + noise * np.random.default_rng(seed).standard_normal(count)


class TestFlags:
    @pytest.mark.parametrize(
        ("flags", "expected"),
        [
            (ALL_GOOD, GOOD),
            (with_flags(spike=UNKNOWN, rate_of_change=UNKNOWN), GOOD),
            (with_flags(spike=SUSPECT, flat_line=UNKNOWN), SUSPECT),
            (with_flags(spike=SUSPECT, location=FAIL), FAIL),
            (with_flags(syntax=MISSING, location=FAIL), MISSING),
        ],
    )
    def test_a_reading_is_as_good_as_its_worst_test(self, flags, expected):
        assert aggregate(flags) is expected

    @pytest.mark.parametrize(
        ("flags", "check"),
        [
            (ALL_GOOD, None),
            (with_flags(spike=SUSPECT), Check.SPIKE),
            (with_flags(spike=SUSPECT, rate_of_change=FAIL), Check.RATE_OF_CHANGE),
            (with_flags(spike=FAIL, rate_of_change=FAIL), Check.SPIKE),
            (with_flags(syntax=MISSING, gross_range=MISSING, location=FAIL), Check.SYNTAX),
        ],
    )
    def test_the_reason_is_the_worst_test(self, flags, check):
        assert refused_by(flags, {GOOD}) is check

    def test_suspect_readings_may_be_allowed_but_not_failed_ones(self):
        assert refused_by(with_flags(spike=SUSPECT), {GOOD, SUSPECT}) is None
        assert refused_by(with_flags(spike=FAIL), {GOOD, SUSPECT}) is Check.SPIKE

    def test_every_flag_of_every_test_is_counted(self):
        tally = Tally()
        tally.add(with_flags(spike=SUSPECT))
        tally.add(with_flags(spike=FAIL, rate_of_change=UNKNOWN))
        tally.add_missing(3)
        assert set(tally.counts) == {"aggregate", *(check.name.lower() for check in Check)}
        assert tally.counts["aggregate"] == (0, 0, 1, 1, 3)
        assert tally.counts["spike"] == (0, 0, 1, 1, 0)
        assert tally.counts["rate_of_change"] == (1, 1, 0, 0, 0)
        assert tally.counts["timing"] == (2, 0, 0, 0, 3)


class TestChecks:
    @pytest.mark.parametrize(
        ("value", "flag"),
        [(33.0, GOOD), (0.0, GOOD), (-1e29, GOOD), (math.nan, MISSING), (math.inf, FAIL), (-math.inf, FAIL)]
        + [(fill, FAIL) for fill in (9.96921e36, 1e37, 3.4e38, -3.4e38, 1e30)],
    )
    def test_what_cannot_be_a_measurement_has_no_syntax(self, value, flag):
        assert syntax(value) is flag

    @pytest.mark.parametrize(
        ("value", "flag"),
        [
            (1.9, FAIL),
            (2.0, SUSPECT),
            (29.9, SUSPECT),
            (30.0, GOOD),
            (36.0, GOOD),
            (36.1, SUSPECT),
            (42.1, FAIL),
        ],
    )
    def test_the_ends_of_a_span_belong_to_it(self, value, flag):
        assert gross_range(value, (2.0, 42.0), (30.0, 36.0)) is flag

    @pytest.mark.parametrize(
        ("before", "value", "after", "height"),
        [
            (1.0, 5.0, 2.0, 3.0),
            (1.0, -4.0, 2.0, 5.0),
            (0.0, 0.0, 9.0, 0.0),  # the foot of a front
            (0.0, 9.0, 9.0, 0.0),  # its top
            (0.0, 4.0, 9.0, 0.0),  # on its way
            (0.0, 0.0, -9.0, 0.0),  # a good reading beside a spike
        ],
    )
    def test_a_spike_stands_out_from_both_neighbours(self, before, value, after, height):
        assert spike_height(before, value, after) == height
        argo = abs(value - (before + after) / 2) - abs(after - before) / 2
        assert height == max(0.0, argo)

    def test_a_window_has_room_for_something(self):
        with pytest.raises(ValueError, match="window must be at least 1, not 0"):
            RunningMedian(0)
        with pytest.raises(ValueError, match="no values yet"):
            _ = RunningMedian(3).median


class TestFlatLine:
    def test_a_probe_that_never_repeats_itself_is_stuck_after_four_repeats(self):
        line = FlatLine()
        values = [*noisy(100), *[33.0] * 40, *noisy(5, seed=1)]
        flags = [line.add(float(k), value) for k, value in enumerate(values)]
        stuck = flags[100:140]
        assert flags[:100] + flags[140:] == [GOOD] * 105
        assert stuck.index(SUSPECT) == FEWEST_REPEATS
        assert stuck.index(FAIL) == 2 * FEWEST_REPEATS
        assert stuck == [GOOD] * 4 + [SUSPECT] * 4 + [FAIL] * 32

    @pytest.mark.parametrize("times", [2, 4, 8])
    def test_one_that_sends_each_value_several_times_is_not_judged_without_a_limit(self, times):
        line = FlatLine()
        values = np.repeat(noisy(400), times)
        flags = [line.add(float(k), value) for k, value in enumerate(values)]
        # The first run of eight is longer than is usual of what is known by then.
        assert set(flags[times:]) <= {GOOD, UNKNOWN}
        assert (flags[-1] is UNKNOWN) == (times > 2)

    def test_nor_is_one_that_rounds_coarsely(self):
        line = FlatLine()
        values = np.round(15.0 + np.sin(np.arange(20_000) / 2000.0) + noisy(20_000, noise=0.02), 1)
        flags = [line.add(float(k), value) for k, value in enumerate(values)]
        assert np.mean(np.diff(values) == 0) > 0.7
        assert np.mean([flag >= SUSPECT for flag in flags]) < 5e-3
        assert np.mean([flag is UNKNOWN for flag in flags]) > 0.9
        given = FlatLine(suspect_s=3600.0, fail_s=7200.0)
        assert {given.add(float(k), value) for k, value in enumerate(values)} == {GOOD}

    def test_a_probe_that_stays_stuck_stays_refused_and_is_caught_again_a_minute_later(self):
        line, rng = FlatLine(), np.random.default_rng(0)
        stuck, moving = np.full(300, 33.0), 33.0 + 0.01 * rng.standard_normal(100)
        flags = [line.add(float(k), v) for k, v in enumerate(np.r_[moving, stuck, moving, stuck])]
        assert [k for k, flag in enumerate(flags) if flag < SUSPECT] == [*range(104), *range(400, 504)]

    def test_a_slow_drift_within_the_tolerance_is_no_flat_line_for_longer_than_it_takes(self):
        line = FlatLine(suspect_s=10.0, fail_s=100.0, tolerance=1.0)
        flags = [line.add(float(k), 0.2 * k) for k in range(1000)]
        assert set(flags) == {GOOD}

    def test_after_an_interruption_the_time_counts_anew(self):
        line = FlatLine(suspect_s=10.0, fail_s=20.0)
        assert [line.add(float(k), 1.0) for k in range(12)][-2:] == [SUSPECT, SUSPECT]
        line.interrupt()
        assert [line.add(1000.0 + k, 1.0) for k in range(11)] == [GOOD] * 10 + [SUSPECT]


class TestLocation:
    def test_places_far_outside_fail_and_on_land_are_suspect(self):
        location = Location(WATERS, 1e9)
        places = {(50.0, 50.0): GOOD, (-400.0, 50.0): GOOD, (-501.0, 50.0): FAIL, (4500.0, 4500.0): SUSPECT}
        for k, ((x, y), flag) in enumerate(places.items()):
            assert location.add(float(k), x, y) is flag

    def test_a_jump_fails_until_the_fix_is_back(self):
        location = Location(WATERS, None)
        x = 100.0 + 2.0 * np.arange(60)
        x[30:35] += 3000.0
        assert [location.add(float(k), xk, 100.0) for k, xk in enumerate(x)] == [
            FAIL if 30 <= k < 35 else GOOD for k in range(60)
        ]

    def test_a_first_fix_that_was_wrong_is_given_up(self):
        location = Location(WATERS, 10.0)
        location.add(0.0, 9000.0, 9000.0)
        flags = [location.add(float(k), 100.0 + 2.0 * k, 100.0) for k in range(1, 40)]
        assert flags == [FAIL] * CONSISTENT_READINGS + [GOOD] * (39 - CONSISTENT_READINGS)

    @pytest.mark.parametrize("speed_mps", [0.5, 2.0, 12.0, 90.0])
    def test_any_speed_is_possible_for_who_sails_at_it(self, speed_mps):
        location = Location(Waters(shapely.box(-1e6, -1e6, 1e6, 1e6), shapely.Polygon(), 0.0), None)
        place = np.cumsum(np.r_[np.zeros(20), np.linspace(0.0, speed_mps, 5), np.full(100, speed_mps)])
        flags = [location.add(float(k), x, 0.0) for k, x in enumerate(place)]
        assert flags.count(FAIL) <= (1 if speed_mps > 15.0 else 0)

    def test_a_given_speed_is_the_limit(self):
        location = Location(WATERS, 3.0)
        assert location.add(0.0, 0.0, 0.0) is GOOD
        assert location.add(10.0, 44.0, 0.0) is GOOD  # with the receiver's error
        assert location.add(20.0, 90.0, 0.0) is FAIL


class TestStream:
    def test_a_good_stream_is_good(self):
        stream = Stream()
        stream.add(*noisy(500))
        assert stream.finish().flags() == [GOOD] * 500
        assert stream.flags(Check.SPIKE) == [UNKNOWN] + [GOOD] * 498 + [UNKNOWN]

    def test_one_reading_is_held_back_once_the_stream_is_known(self):
        stream = Stream()
        assert [stream.add(value) for value in noisy(16)] == [0] * WARM_UP + [WARM_UP, 1, 1, 1]

    @pytest.mark.parametrize("at", [0, 5, 11, 12, 100])
    @pytest.mark.parametrize("glitch", [0.0, 1e20, -9999.0, 34.0, 33.3])
    def test_a_glitch_is_caught_wherever_it_comes(self, glitch, at):
        """33.3 is 30 standard deviations of the noise; the first of a stream has only those after it to differ from."""
        values = noisy(200)
        values[at] = glitch
        stream = Stream()
        stream.add(*values)
        assert [k for k, flag in enumerate(stream.finish().flags()) if flag >= SUSPECT] == [at]

    @pytest.mark.parametrize("length", [2, 3, 10, 25])
    def test_a_row_of_bad_readings_is_caught_whole_and_the_good_ones_after_it_are_kept(self, length):
        rng = np.random.default_rng(length)
        values = noisy(300)
        values[150 : 150 + length] += rng.uniform(3.0, 6.0, length)
        stream = Stream()
        stream.add(*values)
        bad = [k for k, flag in enumerate(stream.finish().flags()) if flag >= SUSPECT]
        assert bad == list(range(150, 150 + length))

    def test_a_step_that_stays_is_believed(self):
        stream = Stream()
        stream.add(*noisy(200), *(10.0 + noisy(200, seed=1)))
        flags = stream.finish().flags()
        refused = [k for k, flag in enumerate(flags) if flag >= SUSPECT]
        assert refused == list(range(200, 200 + CONSISTENT_VALUES))

    def test_a_steep_front_in_water_without_noise_is_kept(self):
        """From a gradient of 1e-5 to one of 1e-2 a second, from one reading to the next, and back."""
        slope = np.r_[np.full(600, 1e-5), np.full(300, 1e-2), np.full(600, -1e-5)]
        stream = Stream()
        stream.add(*(33.0 + np.cumsum(slope)))
        flags = stream.finish().flags()
        # What the test costs such water: until the steps of the front are usual or consistent.
        assert sum(flag >= SUSPECT for flag in flags) <= CONSISTENT_VALUES

    def test_with_a_little_noise_that_front_costs_nothing(self):
        slope = np.r_[np.full(600, 1e-5), np.full(300, 1e-2), np.full(600, -1e-5)]
        stream = Stream()
        stream.add(*(noisy(1500, noise=2e-3) + np.cumsum(slope)))
        assert stream.finish().flags().count(GOOD) == 1500

    def test_a_stuck_probe_teaches_neither_then_nor_is_it_the_measure_of_what_follows(self):
        values = np.r_[noisy(200), np.full(100, 33.005), 33.4 + noisy(100, seed=2, noise=0.01) - 33.0]
        stream = Stream()
        stream.add(*values)
        flags = stream.finish().flags()
        assert flags[:204] == [GOOD] * 204
        assert min(flags[204:300]) >= SUSPECT

    def test_missing_values_are_no_neighbours(self):
        values = noisy(60)
        values[[30, 32]] = math.nan
        values[31] = 40.0
        stream = Stream()
        stream.add(*values)
        flags = stream.finish().flags()
        assert flags[30:33] == [MISSING, FAIL, MISSING]
        assert flags[:30] + flags[33:] == [GOOD] * 57
        assert stream.judged[30].flags == with_flags(
            syntax=MISSING, gross_range=MISSING, spike=MISSING, rate_of_change=MISSING, flat_line=MISSING
        )

    def test_what_the_probe_cannot_measure_is_no_neighbour(self):
        values = noisy(60)
        values[30] = 45.0
        stream = Stream(span=(2.0, 42.0))
        stream.add(*values)
        stream.finish()
        assert stream.judged[30].flags == with_flags(
            gross_range=FAIL, spike=UNKNOWN, rate_of_change=UNKNOWN, flat_line=UNKNOWN
        )
        assert stream.flags().count(GOOD) == 59

    def test_what_is_unexpected_is_suspect(self):
        stream = Stream(span=(2.0, 42.0), suspect_minimum=32.99)
        stream.add(*noisy(100))
        suspect = [value < 32.99 for value in noisy(100)]
        assert [flag is SUSPECT for flag in stream.finish().flags()] == suspect
        assert 5 < sum(suspect) < 50

    def test_a_gap_is_counted_and_the_stream_begins_anew_after_it(self):
        stream = Stream()
        stream.add(*noisy(100))
        assert stream.add(33.5, interval_s=61.0) == 1  # the one held back before the gap
        stream.add(*(33.5 + 0.01 * np.sin(np.arange(50.0) * 7.0)))
        assert stream.finish().flags() == [GOOD] * 151
        assert stream.quality.counts["timing"] == (151, 0, 0, 0, 60)
        assert stream.flags(Check.SPIKE)[99:101] == [UNKNOWN, UNKNOWN]

    def test_a_glitch_right_after_a_gap_is_caught(self):
        stream = Stream()
        stream.add(*noisy(100))
        stream.add(20.0, interval_s=61.0)
        stream.add(*noisy(50, seed=1))
        assert [k for k, flag in enumerate(stream.finish().flags()) if flag >= SUSPECT] == [100]

    def test_a_probe_that_comes_back_from_a_gap_with_nothing_but_bad_readings_is_not_believed(self):
        stream = Stream()
        stream.add(*noisy(100), *[math.nan] * 15, *(0.01 * np.random.default_rng(4).standard_normal(20)))
        stream.add(*noisy(100, seed=1))
        flags = stream.finish().flags()
        assert min(flags[100:135]) >= SUSPECT
        assert flags[:100] + flags[135:] == [GOOD] * 200

    def test_when_the_probe_falls_silent_what_is_held_back_is_let_go(self):
        stream = Stream()
        stream.add(*noisy(100))
        assert stream.quality.release(stream.time_s + 4.9) == []
        (last,) = stream.quality.release(stream.time_s + 5.1)
        assert (last.flag, last.flags[Check.SPIKE]) == (GOOD, UNKNOWN)
        assert stream.quality.release(stream.time_s + 100.0) == []

    def test_two_readings_at_one_time_are_one_too_many(self):
        stream = Stream()
        stream.add(*noisy(20))
        stream.add(33.0, interval_s=0.0)
        stream.add(*noisy(20, seed=1))
        assert stream.finish().flags() == [GOOD] * 20 + [SUSPECT] + [GOOD] * 20
        assert stream.judged[20].flags[:2] == (SUSPECT, GOOD)

    @pytest.mark.parametrize("broken", [33.0, math.nan])
    def test_a_sender_whose_clock_stands_still_fills_no_memory(self, broken):
        """None of these readings is a next one to compare the last with, and no gap ever ends the wait."""
        stream = Stream()
        stream.add(*noisy(100))
        stream.add(*[broken] * 3000, interval_s=0.0)
        assert len(stream.judged) >= 3100 - MOST_HELD
        stream.add(*noisy(100, seed=1))
        stream.finish()
        assert stream.flags(Check.TIMING).count(SUSPECT) == 3000
        assert len(stream.judged) == 3200
        assert set(stream.flags()[-100:]) == {GOOD}

    def test_a_clock_that_is_set_back_does_not_end_the_stream(self):
        stream = Stream()
        stream.add(*noisy(50))
        stream.time_s -= 1000.0
        stream.add(*noisy(50, seed=1))
        assert stream.finish().flags() == [GOOD] * 100

    def test_limits_in_the_sensors_unit_are_kept_to_the_letter(self):
        limits = {"rate_suspect_per_s": 0.5, "rate_fail_per_s": 1.0, "spike_suspect": 0.2, "spike_fail": 0.4}
        stream = Stream(**limits)
        values = np.full(40, 33.0) + 1e-3 * (np.arange(40) % 2)
        values[20], values[30] = 33.3, 33.45
        values[35:] += 0.75
        stream.add(*values)
        stream.finish()
        assert {k: flag for k, flag in enumerate(stream.flags(Check.SPIKE)) if flag in (SUSPECT, FAIL)} == {
            20: SUSPECT,
            30: FAIL,
        }
        rate = {k: flag for k, flag in enumerate(stream.flags(Check.RATE_OF_CHANGE)) if flag is not GOOD}
        assert rate == {35: SUSPECT}  # and the next is 0.375 a second from the last good one

    def test_tests_can_be_turned_off(self):
        off = dict.fromkeys(
            ("spike_suspect", "spike_fail", "rate_suspect_per_s", "rate_fail_per_s"), math.inf
        )
        stream = Stream(**off)
        values = noisy(100)
        values[50] = 1000.0
        stream.add(*values)
        assert stream.finish().flags() == [GOOD] * 100
        assert set(stream.flags(Check.SPIKE) + stream.flags(Check.RATE_OF_CHANGE)) == {UNKNOWN}
