import math

import numpy as np
import pytest

from autonomy.learning.hyperparameters import log_marginal_likelihood, loo_log_likelihood
from autonomy.learning.kernel import Hyperparameters, covariance
from autonomy.learning.likelihood import Readings

H = Hyperparameters(1.7, 0.05, (40.0, 25.0))


def readings(seed=0, n=60):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, 200, (n, 2))
    return x, np.sin(x[:, 0] / 30) + 0.3 * rng.normal(size=n), rng.uniform(0.05, 2.0, n)


def shifted(h, parameter, by):
    values = np.array([h.signal_variance, *h.lengthscales_m, h.noise_variance])
    values[parameter] *= math.exp(by)
    return Hyperparameters(values[0], values[-1], tuple(values[1:-1]))


def log_density(y, mean, variance):
    return -0.5 * math.log(2 * math.pi * variance) - 0.5 * (y - mean) ** 2 / variance


@pytest.mark.parametrize("scaled", [False, True])
@pytest.mark.parametrize("objective", [loo_log_likelihood, log_marginal_likelihood])
@pytest.mark.parametrize(
    "h", [H, Hyperparameters(0.2, 1e-3, (300.0, 5.0)), Hyperparameters(9.0, 3.0, (8.0, 80.0))]
)
def test_gradients_are_those_of_finite_differences(objective, h, scaled):
    x, y, scale = readings()
    scale = scale if scaled else None
    _, gradient = objective(x, y, h, scale)
    assert gradient.shape == (4,)
    step = 1e-4
    for i in range(4):
        values = [objective(x, y, shifted(h, i, k * step), scale)[0] for k in (-2, -1, 1, 2)]
        numeric = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
        assert gradient[i] == pytest.approx(numeric, rel=1e-6, abs=1e-6 * np.abs(gradient).max())


@pytest.mark.parametrize("objective", ["loo", "marginal"])
def test_gradients_with_an_unknown_mean_are_those_of_finite_differences(objective):
    x, y, scale = readings()
    target = getattr(Readings.of(x, 33 + y, scale, None, "gls"), objective)
    _, gradient = target(H)
    step = 1e-4
    for i in range(4):
        values = [target(shifted(H, i, k * step))[0] for k in (-2, -1, 1, 2)]
        numeric = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
        assert gradient[i] == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize("scaled", [False, True])
def test_loo_is_brute_force_leave_one_out(scaled):
    x, y, scale = readings(1, 40)
    noise = H.noise_variance * (scale if scaled else np.ones(40))
    total = 0.0
    for i in range(40):
        rest = np.arange(40) != i
        K = covariance(x[rest], x[rest], H) + np.diag(noise[rest])
        k = covariance(x[rest], x[[i]], H)[:, 0]
        mean = k @ np.linalg.solve(K, y[rest])
        variance = H.signal_variance + noise[i] - k @ np.linalg.solve(K, k)
        total += log_density(y[i], mean, variance)
    assert loo_log_likelihood(x, y, H, scale if scaled else None)[0] == pytest.approx(total, abs=1e-8)


def test_loo_with_an_unknown_mean_estimates_it_from_the_others():
    x, y, _ = readings(2, 25)
    y = y + 7.0
    total = 0.0
    for i in range(25):
        rest = np.arange(25) != i
        K = covariance(x[rest], x[rest], H) + H.noise_variance * np.eye(24)
        k, ones = covariance(x[rest], x[[i]], H)[:, 0], np.ones(24)
        weight = ones @ np.linalg.solve(K, ones)
        mean = ones @ np.linalg.solve(K, y[rest]) / weight
        predicted = mean + k @ np.linalg.solve(K, y[rest] - mean)
        variance = H.signal_variance + H.noise_variance - k @ np.linalg.solve(K, k)
        variance += (1 - ones @ np.linalg.solve(K, k)) ** 2 / weight
        total += log_density(y[i], predicted, variance)
    assert Readings.of(x, y, None, None, "gls").loo(H)[0] == pytest.approx(total, abs=1e-8)


def test_marginal_likelihood_is_the_joint_normal_density():
    x, y, scale = readings(3, 30)
    K = covariance(x, x, H) + np.diag(H.noise_variance * scale)
    expected = -0.5 * (y @ np.linalg.solve(K, y) + np.linalg.slogdet(2 * math.pi * K)[1])
    assert log_marginal_likelihood(x, y, H, scale)[0] == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize(
    ("x", "y", "scale", "complaint"),
    [
        (np.zeros((3, 1)), np.zeros(3), None, "x must have shape"),
        (np.zeros((3, 2)), np.zeros(2), None, "y must have shape"),
        (np.zeros((3, 2)), [0, 1, math.nan], None, "finite"),
        (np.zeros((3, 2)), np.zeros(3), [1.0, 1.0, 0.0], "positive"),
        (np.zeros((3, 2)), np.zeros(3), [1.0, 1.0], "noise_scale"),
    ],
)
def test_bad_readings_are_refused(x, y, scale, complaint):
    with pytest.raises(ValueError, match=complaint):
        loo_log_likelihood(x, y, H, scale)
