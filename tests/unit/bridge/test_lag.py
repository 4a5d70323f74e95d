"""Hose and response undone: against the very differential equation, solved by hand."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.bridge.lag import Sharpen, Shift, Timed
from autonomy.geometry import FloatArray

TAU = 5.0


def responded(times: FloatArray, step_s: float) -> FloatArray:
    """What a sensor of first order says of a step from 0 to 1: the textbook's 1 - exp(-t/τ)."""
    return np.where(times < step_s, 0.0, -np.expm1(-(times - step_s).clip(0.0) / TAU))


def crossing(made: list[Timed], level: float = 0.5) -> float:
    """When the values go through a level, between two of them by a straight line."""
    for before, after in pairwise(made):
        if before.value < level <= after.value:
            share = (level - before.value) / (after.value - before.value)
            return before.taken_s + share * (after.taken_s - before.taken_s)
    raise AssertionError("it is never crossed")


def run(correction: Shift | Sharpen, times: FloatArray, values: FloatArray) -> list[Timed]:
    made = [correction.add(float(time), float(value)) for time, value in zip(times, values, strict=True)]
    return [each for each in made if each is not None]


def test_a_steady_gradient_is_only_late_and_a_shift_cures_that() -> None:
    """y = x(t - τ) solves the equation for x = k t, but for what dies away with exp(-t/τ)."""
    times = np.arange(100.0, 200.0)
    (first, *_) = run(Shift(8.0 + TAU), times, 0.25 * (times - 8.0 - TAU))
    assert first.value == pytest.approx(0.25 * first.taken_s)


@pytest.mark.parametrize("interval_s", [0.05, 0.3, 1.0, 4.0])
def test_a_step_is_where_it_was(interval_s: float) -> None:
    times = np.arange(80.0, 150.0, interval_s)
    made = run(Sharpen(8.0, TAU, TAU), times, responded(times, 100.3 + 8.0))
    assert abs(crossing(made) - 100.3) < 0.5 * interval_s + 0.01


def test_shifted_alone_a_step_is_too_early_by_a_third_of_the_response() -> None:
    """That is what sharpening is for. The middle of a step is reached after τ ln 2."""
    times = np.arange(0.0, 200.0, 0.05)
    made = run(Shift(8.0 + TAU), times, responded(times, 108.0))
    assert crossing(made) - 100.0 == pytest.approx(-(1.0 - math.log(2.0)) * TAU, abs=0.05)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.floats(0.02, 3.0), min_size=30, max_size=60), st.floats(-0.5, 0.5))
def test_whatever_the_intervals_a_gradient_is_restored(intervals: list[float], slope: float) -> None:
    """y = k (t - τ) + k τ exp(-t/τ) is the answer to x = k t from rest, exactly."""
    times = np.cumsum(intervals)
    answer = slope * (times - TAU) + slope * TAU * np.exp(-times / TAU)
    for each in run(Sharpen(0.0, TAU, TAU), times, answer):
        assert each.value == pytest.approx(slope * each.taken_s, abs=1e-9)


def test_the_noise_grows_by_what_is_promised() -> None:
    """A window as long as τ: about 1.2 sqrt(n)... for n readings in it the factor is near sqrt(12 / n)."""
    rng = np.random.default_rng(1)
    times = np.arange(0.0, 2000.0, 0.25)
    made = run(Sharpen(0.0, TAU, TAU), times, rng.normal(size=times.size))
    assert np.std([each.value for each in made]) == pytest.approx(math.sqrt(12 / 20), rel=0.15)


def test_after_a_pause_it_begins_anew() -> None:
    correction = Sharpen(0.0, TAU, TAU)
    times = np.array([0.0, 1, 2, 3, 4, 5, 6, 30, 31, 32, 33, 34, 35, 36])
    made = [correction.add(time, 1.0 if time < 10 else 9.0) for time in times]
    assert [each is None for each in made] == [True] * 5 + [False] * 2 + [True] * 5 + [False] * 2
    assert made[-1] is not None
    assert made[-1].value == pytest.approx(9.0)


def test_a_stuck_sensor_stays_stuck() -> None:
    made = run(Sharpen(0.0, TAU, TAU), np.arange(30.0), np.full(30, 33.512))
    assert {np.float32(each.value) for each in made} == {np.float32(33.512)}
