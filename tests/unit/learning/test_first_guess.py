"""The first guess: noise and field told apart on short stretches, and caution where they can't be."""

import math
import pickle

import numpy as np
import pytest

from autonomy.learning.first_guess import FirstGuess
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import Matern32

SPAN_M = 6000.0
TRUE = Kernel((Component(1.0, Matern32((1000.0, 1000.0))),), 0.0025)


def line(n: int, step_m: float) -> np.ndarray:
    return np.column_stack([step_m * np.arange(n), np.zeros(n)])


def guessed(x: np.ndarray, y: np.ndarray) -> Kernel:
    guess = FirstGuess(SPAN_M)
    for point, value in zip(x, y, strict=True):
        guess.add(point, float(value))
    return guess.kernel()


def test_the_noise_is_found_on_a_slope_whatever_the_spacing() -> None:
    # Second differences know no slope. Of 400 readings they tell the noise variance to a tenth: their variance is
    # 35/9 n⁻¹ of its square (Gasser et al. 1986).
    rng = np.random.default_rng(0)
    x = np.column_stack([np.cumsum(rng.uniform(0.5, 5.0, 400)), np.zeros(400)])
    y = 33.0 + 0.01 * x[:, 0] + 0.05 * rng.normal(size=400)
    assert guessed(x, y).noise_variance == pytest.approx(0.05**2, rel=0.3)


def test_a_stretch_of_wide_steps_is_field_and_not_noise() -> None:
    # A share of the variance would be 1 % of it; a kilometre apart nothing tells noise from field.
    x = line(40, 100.0)
    y = np.sin(x[:, 0] / 1500.0)
    assert guessed(x, y).noise_variance < 1e-3 * y.var()


def test_the_field_is_not_believed_smaller_than_it_is_while_the_boat_has_hardly_moved() -> None:
    # Draws of the process itself, twenty readings 2 m apart: what is guessed is seldom less than the true variance.
    rng = np.random.default_rng(1)
    x = line(20, 2.0)
    covariance = TRUE.covariance(x, x)
    factor = np.linalg.cholesky(covariance + 1e-12 * np.eye(20))
    signals = [guessed(x, factor @ rng.normal(size=20) + 0.05 * rng.normal(size=20)) for _ in range(200)]
    assert np.mean([kernel.signal_variance >= 1.0 for kernel in signals]) >= 0.95
    # By noise alone it is enlarged, but not without end.
    assert max(kernel.signal_variance for kernel in signals) <= 5e4 * 0.05**2 * 3.0


def test_it_comes_down_to_the_field_as_the_boat_gets_on() -> None:
    rng = np.random.default_rng(2)
    x = line(2000, 2.0)
    waves = np.sin(x[:, 0] / 900.0) + np.cos(x[:, 0] / 700.0)
    y = waves + 0.2 * rng.normal(size=2000)
    early, late = guessed(x[:20], y[:20]), guessed(x, y)
    assert late.signal_variance < 0.2 * early.signal_variance
    assert 1.0 < late.signal_variance / waves.var() < 100.0


def test_no_guess_is_less_than_half_the_one_before() -> None:
    # A slope, then a plateau: that the field does not vary there is no news of how much it does elsewhere.
    guess, signals = FirstGuess(SPAN_M), []
    for i in range(320):
        guess.add(np.array([2.0 * i, 0.0]), 33.0 + 0.01 * min(i, 20) + 1e-4 * (-1) ** i)
        if i >= 19 and guess.is_due:
            signals.append(guess.kernel().signal_variance)
    ratios = np.divide(signals[1:], signals[:-1])
    assert len(signals) == 5
    assert ratios.min() == pytest.approx(0.5)


def test_it_is_due_at_every_doubling_and_keeps_few_places() -> None:
    guess, due = FirstGuess(SPAN_M), []
    for i in range(1, 3000):
        guess.add(np.array([float(i), 0.0]), math.sin(i))
        if guess.is_due and i >= 20:
            due.append(i)
            guess.kernel()
    assert due == [20, 40, 80, 160, 320, 640, 1280, 2560]
    assert len(pickle.dumps(guess)) < 20_000
    assert pickle.loads(pickle.dumps(guess)).kernel() == guess.kernel()


@pytest.mark.parametrize("value", [0.0, 33.5, 1e-100, 1e150])
@pytest.mark.parametrize("step_m", [0.0, 1.0])
@pytest.mark.parametrize("n", [1, 2, 20])
def test_readings_that_do_not_vary_give_a_kernel_all_the_same(value: float, step_m: float, n: int) -> None:
    kernel = guessed(line(n, step_m), np.full(n, value))
    assert math.isfinite(kernel.signal_variance)
    assert kernel.noise_variance < kernel.signal_variance


def test_without_readings_there_is_nothing_to_guess_from() -> None:
    with pytest.raises(ValueError, match="no readings"):
        FirstGuess(SPAN_M).kernel()
