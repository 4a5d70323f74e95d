"""The live calibration against numpy over the window, and on streams whose truth is known."""

import math
import pickle

import numpy as np
import pytest
from scipy.stats import norm

from autonomy.learning.calibration import Calibration


def filled(z: np.ndarray, variance: np.ndarray, window: int) -> Calibration:
    calibration = Calibration(window)
    for one, spread in zip(z * np.sqrt(variance), variance, strict=True):
        calibration.add(float(one), float(spread))
    return calibration


@pytest.mark.parametrize("readings", [1, 7, 99, 100, 101, 250, 1000])
def test_figures_are_those_of_numpy_over_the_last_window(readings: int) -> None:
    rng = np.random.default_rng(readings)
    variance = rng.uniform(0.01, 4.0, readings)
    innovation = rng.standard_t(3, readings) * np.sqrt(variance)
    calibration = Calibration(100)
    for one, spread in zip(innovation, variance, strict=True):
        calibration.add(float(one), float(spread))
    last, spreads = innovation[-100:], variance[-100:]
    low, high = norm.interval(0.95, scale=np.sqrt(spreads))
    assert calibration.count == min(readings, 100)
    assert calibration.coverage_95 == pytest.approx(np.mean((low <= last) & (last <= high)), abs=1e-12)
    assert calibration.mean_square == pytest.approx(np.mean(last**2 / spreads), rel=1e-12)
    expected = norm.logpdf(last, scale=np.sqrt(spreads)).mean()
    assert calibration.log_score == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("factor", "coverage"),
    # A predicted standard deviation that is `factor` times the true one covers 2Φ(1.96·factor) − 1.
    [(1.0, 0.95), (0.5, 0.673), (2.0, 0.99991)],
)
def test_over_and_under_confidence_show(factor: float, coverage: float) -> None:
    z = np.random.default_rng(3).standard_normal(20_000) / factor
    calibration = filled(z, np.full(20_000, 0.3), 20_000)
    assert calibration.coverage_95 == pytest.approx(coverage, abs=4 * math.sqrt(0.25 / 20_000))
    # The variance of z² is 2/factor⁴.
    assert calibration.mean_square == pytest.approx(factor**-2, abs=4 * math.sqrt(2 / 20_000) * factor**-2)


def test_the_log_score_is_best_for_the_true_spread() -> None:
    truth = np.random.default_rng(5).standard_normal(5000)
    scores = {}
    for factor in (0.5, 0.8, 1.0, 1.25, 2.0):
        calibration = Calibration(5000)
        for value in truth:
            calibration.add(float(value), factor**2)
        scores[factor] = calibration.log_score
    assert max(scores, key=lambda factor: scores[factor]) == 1.0


def test_nothing_drifts_over_a_long_stream_with_glitches() -> None:
    rng = np.random.default_rng(1)
    calibration = Calibration(50)
    for step in range(20_000):
        calibration.add(1e12 if step % 997 == 0 else float(rng.normal()), 1.0)
    last = rng.standard_normal(50)
    for value in last:
        calibration.add(float(value), 1.0)
    assert calibration.mean_square == pytest.approx(np.mean(last**2), rel=1e-14)


def test_units_shift_the_score_by_the_logarithm_of_their_ratio() -> None:
    z = np.random.default_rng(8).standard_normal(200)
    plain, scaled, corrected = Calibration(), Calibration(), Calibration()
    for value in z:
        plain.add(float(value), 1.0)
        scaled.add(10.0 * float(value), 100.0)
        corrected.add(10.0 * float(value), 100.0, log_slope=math.log(10.0))
    assert scaled.log_score == pytest.approx(plain.log_score - math.log(10.0), rel=1e-12)
    assert corrected.log_score == pytest.approx(plain.log_score, rel=1e-12)
    assert scaled.coverage_95 == plain.coverage_95


def test_an_empty_window_has_no_figures() -> None:
    figures = Calibration().figures
    assert figures.count == 0
    assert all(math.isnan(value) for value in (figures.coverage_95, figures.mean_square, figures.log_score))


@pytest.mark.parametrize(
    ("innovation", "variance", "log_slope"),
    [
        (math.nan, 1.0, 0.0),
        (math.inf, 1.0, 0.0),
        (0.0, 0.0, 0.0),
        (0.0, -1.0, 0.0),
        (0.0, math.nan, 0.0),
        (0.0, math.inf, 0.0),
        (0.0, 1.0, math.nan),
    ],
)
def test_what_is_no_prediction_is_refused_and_changes_nothing(
    innovation: float, variance: float, log_slope: float
) -> None:
    calibration = Calibration(10)
    calibration.add(1.0, 1.0)
    before = calibration.figures
    with pytest.raises(ValueError, match="must be"):
        calibration.add(innovation, variance, log_slope)
    assert calibration.figures == before


@pytest.mark.parametrize("window", [0, -1, 2.5, True])
def test_a_window_is_a_whole_number_of_readings(window: float) -> None:
    with pytest.raises(ValueError, match="window must be"):
        Calibration(window)  # type: ignore[arg-type]


def test_a_pickled_copy_goes_on_alike() -> None:
    calibration = filled(np.arange(30.0) / 10.0, np.full(30, 2.0), 20)
    copy = pickle.loads(pickle.dumps(calibration))
    for one in (calibration, copy):
        one.add(0.25, 0.5)
    assert copy.figures == calibration.figures


def test_after_a_restart_only_what_follows_counts() -> None:
    calibration, fresh = filled(np.full(30, 5.0), np.ones(30), 20), Calibration(20)
    calibration.restart()
    assert calibration.count == 0
    for one in (calibration, fresh):
        one.add(0.5, 2.0)
    assert calibration.figures == fresh.figures
