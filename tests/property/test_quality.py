"""Quality control against ioos-qc, which judges whole series at once, and against definitions written out."""

import math
import pickle

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ioos_qc import qartod

from autonomy.config import QualitySection
from autonomy.quality import Check, Flag, QualityControl, Reading, Waters, aggregate
from autonomy.quality.checks import gross_range, syntax
from autonomy.quality.flat_line import FlatLine
from autonomy.quality.running import RunningMedian
from autonomy.quality.stream import WARM_UP

# Machines that are busy with something else are no failure.
patient = settings(deadline=None, max_examples=60)
OPEN_SEA = Waters(shapely.box(-1e6, -1e6, 1e6, 1e6), shapely.Polygon(), 0.0)
NO_SPAN = (-math.inf, math.inf)
OFF = {
    "gap_s": 1e6,
    "maximum_speed_mps": 1e9,
    **dict.fromkeys(("spike_suspect", "spike_fail", "rate_suspect_per_s", "rate_fail_per_s"), math.inf),
    **dict.fromkeys(("flat_suspect_s", "flat_fail_s"), math.inf),
}

# Multiples of an eighth: differences of them are exact, so that equal means equal.
eighths = st.integers(-400, 400).map(lambda k: k / 8.0)
series = st.lists(eighths, min_size=3, max_size=60)
limits = st.tuples(st.integers(1, 200), st.integers(0, 200)).map(lambda k: (k[0] / 8.0, (k[0] + k[1]) / 8.0))


def control(**limits):
    return QualityControl(QualitySection(**limits), NO_SPAN, OPEN_SEA)


def judge(values, times_s=None, **limits):
    quality = control(**limits)
    times = range(len(values)) if times_s is None else times_s
    readings = [Reading(float(t), 0.0, 0.0, v) for t, v in zip(times, values, strict=True)]
    judged = [one for k, reading in enumerate(readings) for one in quality.add(reading, k)] + quality.flush()
    assert [one.subject for one in judged] == list(range(len(values)))
    return judged


def flags(judged, check):
    return [int(one.flags[check]) for one in judged]


@patient
@given(st.lists(eighths | st.just(math.nan), min_size=1), limits, limits)
def test_gross_range_is_that_of_ioos_qc(values, low, high):
    fail, suspect = (-low[1], high[1]), (-low[0], high[0])
    expected = qartod.gross_range_test(values, fail, suspect)
    ours = [
        Flag.MISSING if syntax(value) is Flag.MISSING else gross_range(value, fail, suspect)
        for value in values
    ]
    assert ours == expected.tolist()


@patient
@given(series, limits)
def test_spikes_are_those_of_ioos_qc(values, limits):
    suspect, fail = limits
    expected = qartod.spike_test(values, suspect, fail, method="differential")
    judged = judge(values, **{**OFF, "spike_suspect": suspect, "spike_fail": fail})
    assert flags(judged, Check.SPIKE) == expected.tolist()


@patient
@given(st.lists(eighths | st.just(math.nan), min_size=3, max_size=60), limits)
def test_where_a_value_is_missing_spikes_are_those_of_the_series_without_it(values, limits):
    judged = judge(values, **{**OFF, "spike_suspect": limits[0], "spike_fail": limits[1]})
    there = [value for value in values if not math.isnan(value)]
    if there:
        expected = qartod.spike_test(there, *limits, method="differential").tolist()
        ours = flags(judged, Check.SPIKE)
        assert [flag for flag, v in zip(ours, values, strict=True) if not math.isnan(v)] == expected
        assert [flag for flag, v in zip(ours, values, strict=True) if math.isnan(v)] == [9] * (
            len(values) - len(there)
        )


@patient
@given(st.lists(st.tuples(eighths, st.integers(1, 20)), min_size=2, max_size=30), limits)
def test_rates_of_change_are_those_of_ioos_qc_from_the_last_good_reading(steps, limits):
    """ioos-qc takes the reading before; so each pair of a reading and the last good one is given to it by itself."""
    values, times = [step[0] for step in steps], np.cumsum([step[1] for step in steps])
    judged = judge(values, times, **{**OFF, "rate_suspect_per_s": limits[0], "rate_fail_per_s": limits[1]})
    first = sorted(zip(values[: WARM_UP + 1], times[: WARM_UP + 1], strict=True), key=lambda one: one[0])
    good = first[len(first) // 2]
    for one, value, time in zip(judged, values, times, strict=True):
        flag = 1
        if time != good[1]:
            pair = sorted([(good[1], good[0]), (time, value)])
            instants = np.array([1_000_000 + t for t, _ in pair], dtype="datetime64[s]")
            flag = int(qartod.rate_of_change_test([v for _, v in pair], instants, *limits)[1])
        assert one.flags[Check.RATE_OF_CHANGE] == flag
        good = (value, time) if flag == 1 else good


@patient
@given(
    st.lists(st.integers(0, 3).map(lambda k: k / 8.0), min_size=3, max_size=80),
    st.integers(1, 12),
    st.integers(0, 12),
    st.integers(0, 3),
)
def test_flat_lines_are_those_of_ioos_qc(values, suspect_s, more_s, tolerance):
    """With a tolerance of half a step more, since ioos-qc asks for less than it and we for no more than it."""
    instants = np.arange(len(values)).astype("datetime64[s]")
    fail_s = suspect_s + more_s
    expected = qartod.flat_line_test(values, instants, suspect_s, fail_s, (tolerance + 0.5) / 8.0)
    line = FlatLine(float(suspect_s), float(fail_s), tolerance / 8.0)
    assert [line.add(float(k), value) for k, value in enumerate(values)] == expected.tolist()


@patient
@given(st.tuples(st.sampled_from([1, 3, 4]), *[st.sampled_from([1, 2, 3, 4])] * 6))
def test_the_roll_up_is_that_of_ioos_qc(numbers):
    expected = qartod.qartod_compare([np.array([number]) for number in numbers])
    assert aggregate(tuple(map(Flag, numbers))) == expected[0]


@patient
@given(st.lists(st.floats(-1e6, 1e6), min_size=1), st.integers(1, 20), st.floats(0, 1))
def test_a_running_quantile_is_that_of_the_last_values(values, window, share):
    running = RunningMedian(window)
    for k, value in enumerate(values):
        running.add(value)
        last = sorted(values[max(0, k + 1 - window) : k + 1])
        assert len(running) == len(last)
        assert running.quantile(share) == last[min(len(last) - 1, int(share * len(last)))]


readings = st.builds(
    Reading,
    st.floats(-1e4, 1e4),
    st.floats(-2e6, 2e6),
    st.floats(-2e6, 2e6),
    st.floats(width=32) | st.sampled_from([0.0, 33.0, 33.5]),
)


@patient
@given(st.lists(readings, max_size=60), st.booleans())
@example([Reading(time_s, 0.0, 0.0, 0.0) for time_s in (-1.2e-308, 0.0, 3.0)], False)
def test_whatever_comes_in_comes_out_once_and_in_order(given_readings, in_time_order):
    if in_time_order:
        given_readings.sort(key=lambda reading: reading.model_time_s)
    quality = control()
    came = [one for k, reading in enumerate(given_readings) for one in quality.add(reading, k)]
    came += quality.release(math.inf)
    assert [one.subject for one in came] == list(range(len(given_readings)))
    for one in came:
        assert len(one.flags) == len(Check)
        assert math.isnan(one.reading.value) == (one.flag is Flag.MISSING)
        assert (one.flags[Check.SYNTAX] is Flag.FAIL) <= (one.flag is Flag.FAIL)


def wavy(count, seed, noise=0.01):
    """Slow waves of amplitude 1 about 8, with noise."""
    rng = np.random.default_rng(seed)
    return 8.0 + np.sin(np.arange(count) / 90.0) + noise * rng.standard_normal(count)


def with_glitches(values, seed):
    rng = np.random.default_rng(seed)
    values = values.copy()
    places = rng.choice(len(values), len(values) // 20, replace=False)
    values[places] += rng.choice([-1, 1], len(places)) * np.exp(rng.uniform(-3, 6, len(places)))
    values[rng.integers(len(values) - 30) :][:25] = values[0]
    values[places[0]] = math.nan
    return values


@patient
@given(st.integers(0, 50), st.integers(-60, 60), st.sampled_from([-1.0, 1.0]))
def test_the_defaults_do_not_know_the_unit(seed, exponent, sign):
    """Scaled by a power of two, which is exact, a stream gets the same flags: no limit is in anybody's unit."""
    values = with_glitches(wavy(300, seed), seed)
    here = [one.flags for one in judge(values.tolist())]
    there = [one.flags for one in judge((values * sign * 2.0**exponent).tolist())]
    # The median of an even number of values is the upper one, which mirrored is the lower one.
    differ = sum(a != b for a, b in zip(here, there, strict=True))
    assert differ <= (0 if sign > 0 else 3)


@pytest.mark.parametrize("at", [5, 100])
def test_a_stream_goes_on_where_it_was_pickled(at):
    values = with_glitches(wavy(200, 3), 3).tolist()
    quality, expected = control(), judge(values)
    came = []
    for k, value in enumerate(values):
        if k == at:
            quality = pickle.loads(pickle.dumps(quality))
        came += quality.add(Reading(float(k), 0.0, 0.0, value), k)
    came += quality.flush()
    assert [one.flags for one in came] == [one.flags for one in expected]
