import math

import numpy as np
import pytest

from autonomy.learning.hyperparameters import Priors, fit
from autonomy.learning.kernel import Hyperparameters, covariance

TRUE = Hyperparameters(2.0, 0.05, (150.0, 150.0))
SPAN = 1000.0


def drawn(seed, n=150, h=TRUE, mean=33.5):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, SPAN, (n, 2))
    K = covariance(x, x, h) + h.noise_variance * np.eye(n)
    return x, mean + np.linalg.cholesky(K) @ rng.normal(size=n)


@pytest.mark.parametrize("optimiser", ["lbfgs", "gradient_ascent"])
@pytest.mark.parametrize("objective", ["loo", "marginal"])
@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_fit_finds_the_scales_from_starts_ten_times_off(objective, optimiser, factor):
    x, y = drawn(0)
    start = Hyperparameters(1.0, 0.5, (150 * factor,) * 2, timescale_s=99.0)
    priors = Priors.scaled(SPAN, y.var())
    found = fit(x, y, start, objective, priors, optimiser, 0.01, 300, isotropic=True)
    assert not found.kept_start
    assert found.hyperparameters.lengthscales_m[0] == found.hyperparameters.lengthscales_m[1]
    assert found.hyperparameters.lengthscales_m[0] == pytest.approx(150, rel=0.3)
    assert found.hyperparameters.noise_variance == pytest.approx(0.05, rel=0.8)
    assert found.hyperparameters.timescale_s == 99.0
    assert found.prior_mean == pytest.approx(33.5, abs=1.5)
    assert math.isfinite(found.log_likelihood)


def test_lengthscales_of_an_anisotropic_field_come_out_apart():
    x, y = drawn(1, 200, Hyperparameters(1.0, 0.01, (100.0, 400.0)))
    found = fit(x, y, Hyperparameters(1.0, 0.1, (200.0, 200.0)), "marginal")
    assert found.converged
    np.testing.assert_allclose(found.hyperparameters.lengthscales_m, (100, 400), rtol=0.35)


@pytest.mark.parametrize("objective", ["loo", "marginal"])
@pytest.mark.parametrize("scale", [1e-6, 1e4])
def test_units_and_offset_of_the_sensor_do_not_matter(objective, scale):
    x, y = drawn(2, 80)
    start = Hyperparameters(1.0, 0.1, (200.0, 200.0))
    plain = fit(x, y, start, objective, Priors.scaled(SPAN, y.var()))
    start = Hyperparameters(scale**2, 0.1 * scale**2, (200.0, 200.0))
    other = fit(x, scale * (y - 20), start, objective, Priors.scaled(SPAN, y.var() * scale**2))
    assert other.hyperparameters.signal_variance == pytest.approx(
        plain.hyperparameters.signal_variance * scale**2, rel=1e-2
    )
    np.testing.assert_allclose(
        other.hyperparameters.lengthscales_m, plain.hyperparameters.lengthscales_m, rtol=1e-2
    )
    assert other.prior_mean == pytest.approx((plain.prior_mean - 20) * scale, rel=1e-2)


def test_a_short_track_does_not_run_away_with_priors():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = np.cumsum(rng.normal([10.0, 3.0], 2.0, (25, 2)), axis=0)
        K = covariance(x, x, TRUE) + TRUE.noise_variance * np.eye(25)
        y = np.linalg.cholesky(K) @ rng.normal(size=25)
        priors = Priors.scaled(SPAN, y.var())
        found = fit(x, y, priors.medians(2), "loo", priors, isotropic=True)
        assert 15 < found.hyperparameters.lengthscales_m[0] < 1500


def test_means_of_many_readings_are_trusted_more():
    rng = np.random.default_rng(3)
    x, y = drawn(3, 200, Hyperparameters(2.0, 1e-9, (150.0, 150.0)))
    counts = rng.integers(1, 50, 200)
    y = y + rng.normal(size=200) * np.sqrt(0.5 / counts)
    found = fit(x, y, TRUE, "marginal", noise_scale=1 / counts)
    assert found.hyperparameters.noise_variance == pytest.approx(0.5, rel=0.4)


@pytest.mark.parametrize("learning_rate", [1e-4, 1.0, 1e6])
def test_gradient_ascent_never_ends_lower_than_it_began(learning_rate):
    x, y = drawn(4, 60)
    start = Hyperparameters(1.0, 0.5, (500.0, 500.0))
    found = fit(x, y, start, "loo", None, "gradient_ascent", learning_rate, 40, mean=33.5)
    begun = fit(x, y, start, "loo", None, "gradient_ascent", 1e-300, 1, mean=33.5)
    assert found.log_likelihood >= begun.log_likelihood
    assert found.prior_mean == 33.5


@pytest.mark.parametrize("optimiser", ["lbfgs", "gradient_ascent"])
@pytest.mark.parametrize("priors", [None, Priors.scaled(SPAN, 1.0)])
@pytest.mark.parametrize("objective", ["loo", "marginal"])
@pytest.mark.parametrize("case", ["few", "constant", "one place", "none", "two places", "a line", "outlier"])
def test_degenerate_readings_never_break_a_fit(case, objective, priors, optimiser):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0, SPAN, (40, 2)), rng.normal(size=40)
    match case:
        case "few":
            x, y = x[:19], y[:19]
        case "none":
            x, y = x[:0], y[:0]
        case "constant":
            y = np.full(40, 33.5)
        case "one place":
            x = np.full((40, 2), 5.0)
        case "two places":
            x = np.repeat([[0.0, 0.0], [SPAN, SPAN]], 20, axis=0)
        case "a line":
            x[:, 1] = 0.0
        case "outlier":
            y[3] = 1e30
    start = Hyperparameters(1.0, 0.01, (100.0, 100.0))
    found = fit(x, y, start, objective, priors, optimiser, iterations=30)
    h = found.hyperparameters
    assert np.isfinite([h.signal_variance, h.noise_variance, *h.lengthscales_m, found.prior_mean]).all()
    assert not math.isnan(found.log_likelihood)
    if case in ("few", "none", "constant", "one place"):
        assert found.kept_start
        assert not found.converged
        assert found.hyperparameters is start
        assert found.message


def test_unknown_methods_and_rates_are_refused():
    x, y = drawn(6, 30)
    with pytest.raises(ValueError, match="objective"):
        fit(x, y, TRUE, "nonsense")
    with pytest.raises(ValueError, match="optimiser"):
        fit(x, y, TRUE, optimiser="nonsense")
    with pytest.raises(ValueError, match="learning_rate"):
        fit(x, y, TRUE, optimiser="gradient_ascent", learning_rate=0.0)
    with pytest.raises(ValueError, match="mean"):
        fit(x, y, TRUE, mean=math.nan)
    with pytest.raises(ValueError, match="span_m"):
        Priors.scaled(0.0, 1.0)
    with pytest.raises(ValueError, match="variance"):
        Priors.scaled(1.0, math.nan)
