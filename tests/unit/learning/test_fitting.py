import math
import pickle

import numpy as np
import pytest

from autonomy.learning import fitting
from autonomy.learning.fitting import Method, fit
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.likelihood import Readings, log_parameters
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.structures import STRUCTURES, Scales

TRUE = Hyperparameters(2.0, 0.05, (150.0, 150.0))
SPAN = 1000.0
SE, SE_ARD = STRUCTURES["squared_exponential"], STRUCTURES["squared_exponential_ard"]
ALL = pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
PAPER = Method("loo", "gradient_ascent", priors=False, iterations=300)


def drawn(seed, n=150, h=TRUE, mean=33.5):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, SPAN, (n, 2))
    K = h.kernel.covariance(x, x) + h.noise_variance * np.eye(n)
    return x, mean + np.linalg.cholesky(K) @ rng.normal(size=n)


def readings(x, y, noise_scale=None, times_s=None, mean="gls"):
    return Readings.of(x, y, noise_scale, times_s, mean)


@pytest.mark.parametrize("optimiser", ["lbfgs", "gradient_ascent"])
@pytest.mark.parametrize("objective", ["loo", "marginal"])
@pytest.mark.parametrize("factor", [0.1, 10.0])
def test_a_fit_finds_the_scales_from_starts_ten_times_off(objective, optimiser, factor):
    x, y = drawn(0)
    start = Hyperparameters(1.0, 0.5, (150 * factor,) * 2).kernel
    found = fit(readings(x, y), SE, SPAN, start, Method(objective, optimiser, iterations=300))
    h = found.hyperparameters
    assert not found.kept_start
    assert h.lengthscales_m[0] == h.lengthscales_m[1]
    assert h.lengthscales_m[0] == pytest.approx(150, rel=0.3)
    assert h.noise_variance == pytest.approx(0.05, rel=0.8)
    assert found.prior_mean == pytest.approx(33.5, abs=1.5)
    assert math.isfinite(found.log_likelihood)


@pytest.mark.parametrize("objective", ["loo", "marginal"])
def test_the_likelihood_told_is_that_of_the_kernel_told(objective):
    x, y = drawn(7, 60)
    r = readings(x, 1e-3 * y)
    found = fit(r, SE, SPAN, method=Method(objective))
    assert getattr(r, objective)(found.kernel)[0] == pytest.approx(found.log_likelihood, abs=1e-6)


def test_a_summit_far_from_the_priors_has_to_be_two_nats_higher(monkeypatch):
    # Without climbing, the two summits are the two starts: the priors' medians, and lengths five times shorter.
    monkeypatch.setattr(fitting, "_lbfgs", lambda target, theta, method: (theta, 0, True, "did not climb"))
    leads = []
    for seed in range(40):
        x, y = drawn(seed, 25, Hyperparameters(1.0, 0.01, (100.0, 100.0)))
        found = []
        for margin in (math.inf, -math.inf, 2.0):
            with monkeypatch.context() as patched:
                if math.isinf(margin):
                    patched.setattr(fitting, "_SECOND_SUMMIT", margin)
                found.append(fit(readings(x, y), SE, SPAN))
        near, far, chosen = found
        leads.append(far.score - near.score)
        assert far.hyperparameters.lengthscales_m[0] == pytest.approx(
            near.hyperparameters.lengthscales_m[0] / 5
        )
        assert chosen.kernel == (far if leads[-1] > 2.0 else near).kernel
    assert any(0.0 < lead < 2.0 for lead in leads)
    assert any(lead > 2.0 for lead in leads)
    assert any(lead < 0.0 for lead in leads)


def test_lengthscales_of_an_anisotropic_field_come_out_apart():
    x, y = drawn(1, 200, Hyperparameters(1.0, 0.01, (100.0, 400.0)))
    found = fit(readings(x, y), SE_ARD, SPAN, method=Method(priors=False))
    np.testing.assert_allclose(found.hyperparameters.lengthscales_m, (100, 400), rtol=0.35)


@ALL
@pytest.mark.parametrize(
    ("factor", "shift"), [(1e-6, 0.0), (1e4, 0.0), (-3.7, 2.5), (1.0, 33.5), (1.0, -20.0)]
)
def test_units_and_offset_of_the_sensor_do_not_matter(structure, factor, shift):
    rng = np.random.default_rng(2)
    x, t = rng.uniform(0, SPAN, (60, 2)), np.sort(rng.uniform(0, 4000, 60))
    y = np.sin(x[:, 0] / 150) * np.cos(x[:, 1] / 200 + t / 3000) + 0.1 * rng.normal(size=60)
    places = rng.uniform(0, SPAN, (30, 2))
    start = structure.median(Scales(0.5 * SPAN, 0.7, 5000.0))
    plain = fit(readings(x, y, None, t), structure, SPAN, start)
    shifted = readings(x, factor * (y + shift), None, t)
    other = fit(shifted, structure, SPAN, start.scaled(factor**2, factor**2))
    mean, sd = exact(plain, x, t, y, places)
    other_mean, other_sd = exact(other, x, t, shifted.y, places)
    np.testing.assert_allclose(other_mean, factor * (mean + shift), rtol=0, atol=1e-9 * abs(factor))
    np.testing.assert_allclose(other_sd, abs(factor) * sd, rtol=1e-9)


def exact(found, x, t, y, places):
    """Mean and deviation of the nowcast of the exact GP."""
    now = np.tile(t[-1] - t, (len(places), 1))
    K = found.kernel.covariance(x, x, np.abs(np.subtract.outer(t, t))) + found.kernel.noise_variance * np.eye(
        len(x)
    )
    k = found.kernel.covariance(places, x, now)
    mean = found.prior_mean + k @ np.linalg.solve(K, y - found.prior_mean)
    return mean, np.sqrt(found.kernel.signal_variance - np.einsum("ij,ji->i", k, np.linalg.solve(K, k.T)))


def test_a_short_track_does_not_run_away_with_priors():
    for seed in range(20):
        rng = np.random.default_rng(seed)
        x = np.cumsum(rng.normal([10.0, 3.0], 2.0, (25, 2)), axis=0)
        K = TRUE.kernel.covariance(x, x) + TRUE.noise_variance * np.eye(25)
        y = np.linalg.cholesky(K) @ rng.normal(size=25)
        found = fit(readings(x, y), SE, SPAN, method=Method("loo"))
        assert 15 < found.hyperparameters.lengthscales_m[0] < 1500


def test_means_of_many_readings_are_trusted_more():
    rng = np.random.default_rng(3)
    x, y = drawn(3, 200, Hyperparameters(2.0, 1e-9, (150.0, 150.0)))
    counts = rng.integers(1, 50, 200)
    y = y + rng.normal(size=200) * np.sqrt(0.5 / counts)
    found = fit(readings(x, y, 1 / counts), SE, SPAN, TRUE.kernel, Method(priors=False))
    assert found.hyperparameters.noise_variance == pytest.approx(0.5, rel=0.4)


@pytest.mark.parametrize("learning_rate", [1e-4, 1.0, 1e6])
def test_gradient_ascent_never_ends_lower_than_it_began(learning_rate):
    x, y = drawn(4, 60)
    start = Hyperparameters(1.0, 0.5, (500.0, 500.0)).kernel
    r = readings(x, y, mean=33.5)
    found = fit(r, SE_ARD, SPAN, start, Method("loo", "gradient_ascent", False, 40, learning_rate))
    assert found.log_likelihood >= r.loo(start)[0] - 1e-9
    assert found.prior_mean == 33.5


def test_the_paper_s_ascent_is_plain_gradient_ascent_on_the_logarithms():
    x, y = drawn(8, 50, mean=0.0)
    start = Hyperparameters(3.0, 0.3, (100.0, 250.0)).kernel
    r = readings(x, y, mean=0.0)
    found = fit(r, SE_ARD, SPAN, start, Method("loo", "gradient_ascent", False, 5, 1e-4))
    theta = log_parameters(start)
    for _ in range(5):
        values = np.exp(theta).tolist()
        kernel = Kernel((Component(values[0], SquaredExponential((values[1], values[2]))),), values[3])
        theta = theta + 1e-4 * r.loo(kernel)[1]
    np.testing.assert_allclose(log_parameters(found.kernel), theta, rtol=1e-9)


@pytest.mark.parametrize(
    "method", [Method(), Method("loo", iterations=30), PAPER], ids=["default", "loo", "paper"]
)
@pytest.mark.parametrize("structure", [SE, STRUCTURES["static_moving"]], ids=["static", "moving"])
@pytest.mark.parametrize(
    "case", ["few", "constant", "one place", "none", "two places", "a line", "outlier", "one time"]
)
def test_degenerate_readings_never_break_a_fit(case, structure, method):
    rng = np.random.default_rng(5)
    x, y, t = rng.uniform(0, SPAN, (40, 2)), rng.normal(size=40), np.arange(40.0)
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
        case "one time":
            t[:] = 7.0
    start = structure.median(Scales(SPAN, 1.0, 100.0))
    for begin in (start, None):
        found = fit(readings(x, y, None, t[: len(x)]), structure, SPAN, begin, method)
        assert np.isfinite([*log_parameters(found.kernel), found.prior_mean]).all()
        assert not math.isnan(found.log_likelihood)
        assert pickle.loads(pickle.dumps(found)) == found
        kept = case in ("few", "none", "constant", "one place") or (case == "one time" and structure.moves)
        assert found.kept_start == kept
        if kept:
            assert not found.converged
            assert begin is None or found.kernel is start
            assert found.message


def test_unknown_methods_and_rates_are_refused():
    with pytest.raises(ValueError, match="objective"):
        Method("nonsense")
    with pytest.raises(ValueError, match="optimiser"):
        Method(optimiser="nonsense")
    with pytest.raises(ValueError, match="learning_rate"):
        Method(learning_rate=0.0)
    with pytest.raises(ValueError, match="iterations"):
        Method(iterations=0)
    x, y = drawn(6, 30)
    with pytest.raises(ValueError, match="mean"):
        readings(x, y, mean=math.nan)
    with pytest.raises(ValueError, match="span_m"):
        fit(readings(x, y), SE, 0.0)
    with pytest.raises(ValueError, match="times"):
        fit(readings(x, y), STRUCTURES["ou"], SPAN)
