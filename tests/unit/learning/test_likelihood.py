import math

import numpy as np
import pytest

from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.likelihood import Readings, log_marginal_likelihood, log_parameters, loo_log_likelihood
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck

H = Hyperparameters(1.7, 0.05, (40.0, 25.0))


def readings(seed=0, n=60):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, 200, (n, 2))
    return x, np.sin(x[:, 0] / 30) + 0.3 * rng.normal(size=n), rng.uniform(0.05, 2.0, n)


def shifted(h, parameter, by):
    values = np.array([h.signal_variance, *h.lengthscales_m, h.noise_variance])
    values[parameter] *= math.exp(by)
    return Hyperparameters(values[0], values[-1], tuple(values[1:-1]))


# Long and short, still; an anomaly of two parts that share their motion; one that moves in its own way.
SUM = Kernel(
    (
        Component(1.7, SquaredExponential((70.0, 50.0))),
        Component(0.4, Matern32((12.0, 12.0))),
        Component(0.6, Matern32((25.0, 40.0)), OrnsteinUhlenbeck(80.0)),
        Component(0.3, SquaredExponential((30.0, 30.0)), OrnsteinUhlenbeck(80.0)),
        Component(0.2, SquaredExponential((60.0, 20.0)), MaternMotion(200.0)),
    ),
    0.05,
)


def with_logs(kernel, logs):
    """The kernel whose log parameters, in a gradient's order, are these."""
    values, components = iter(np.exp(logs).tolist()), []
    for c in kernel.components:
        variance, space = next(values), type(c.space)((next(values), next(values)))
        time = c.time if math.isinf(c.time.timescale_s) else type(c.time)(next(values))
        components.append(Component(variance, space, time))
    return Kernel(tuple(components), next(values))


@pytest.mark.parametrize("mean", ["gls", 0.5])
@pytest.mark.parametrize("timed", [True, False])
@pytest.mark.parametrize("objective", ["loo", "marginal"])
def test_gradients_of_a_sum_are_those_of_finite_differences(objective, timed, mean):
    x, y, scale = readings()
    times = np.random.default_rng(9).uniform(0, 300, len(y)) if timed else None
    target = getattr(Readings.of(x, y, scale, times, mean), objective)
    logs = log_parameters(SUM)
    _, gradient = target(SUM)
    assert gradient.shape == logs.shape == (3 + 3 + 4 + 4 + 4 + 1,)
    step = 1e-4
    for i in range(len(logs)):
        shift = np.eye(len(logs))[i] * step
        values = [target(with_logs(SUM, logs + k * shift))[0] for k in (-2, -1, 1, 2)]
        numeric = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * step)
        assert gradient[i] == pytest.approx(numeric, rel=1e-6, abs=1e-6 * np.abs(gradient).max())


@pytest.mark.parametrize("timed", [True, False])
def test_both_objectives_of_a_sum_are_those_of_its_dense_covariance(timed):
    x, y, scale = readings(4, 40)
    times = np.random.default_rng(9).uniform(0, 300, 40) if timed else None
    lag = np.abs(np.subtract.outer(times, times)) if timed else None
    K = SUM.covariance(x, x, lag) + np.diag(SUM.noise_variance * scale)
    joint = -0.5 * (y @ np.linalg.solve(K, y) + np.linalg.slogdet(2 * math.pi * K)[1])
    assert log_marginal_likelihood(x, y, SUM, scale, times)[0] == pytest.approx(joint, abs=1e-8)
    total = 0.0
    for i in range(40):
        rest = np.arange(40) != i
        weights = np.linalg.solve(K[np.ix_(rest, rest)], K[rest, i])
        total += log_density(y[i], weights @ y[rest], K[i, i] - weights @ K[rest, i])
    assert loo_log_likelihood(x, y, SUM, scale, times)[0] == pytest.approx(total, abs=1e-8)


def test_a_common_offset_of_clock_and_place_does_not_matter():
    x, y, scale = readings(5, 30)
    times = np.random.default_rng(9).uniform(0, 300, 30)
    value, gradient = log_marginal_likelihood(x, y, SUM, scale, times)
    other, slope = log_marginal_likelihood(x + 1e5, y, SUM, scale, times + 1.7e9)
    assert other == pytest.approx(value, rel=1e-6)
    np.testing.assert_allclose(slope, gradient, rtol=1e-4, atol=1e-6)


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
        K = H.kernel.covariance(x[rest], x[rest]) + np.diag(noise[rest])
        k = H.kernel.covariance(x[rest], x[[i]])[:, 0]
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
        K = H.kernel.covariance(x[rest], x[rest]) + H.noise_variance * np.eye(24)
        k, ones = H.kernel.covariance(x[rest], x[[i]])[:, 0], np.ones(24)
        weight = ones @ np.linalg.solve(K, ones)
        mean = ones @ np.linalg.solve(K, y[rest]) / weight
        predicted = mean + k @ np.linalg.solve(K, y[rest] - mean)
        variance = H.signal_variance + H.noise_variance - k @ np.linalg.solve(K, k)
        variance += (1 - ones @ np.linalg.solve(K, k)) ** 2 / weight
        total += log_density(y[i], predicted, variance)
    assert Readings.of(x, y, None, None, "gls").loo(H)[0] == pytest.approx(total, abs=1e-8)


def test_marginal_likelihood_is_the_joint_normal_density():
    x, y, scale = readings(3, 30)
    K = H.kernel.covariance(x, x) + np.diag(H.noise_variance * scale)
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


def test_bad_times_are_refused():
    with pytest.raises(ValueError, match="times_s"):
        loo_log_likelihood(np.zeros((3, 2)), np.zeros(3), H, None, [0.0, 1.0])
    with pytest.raises(ValueError, match=r"times_s.*finite"):
        loo_log_likelihood(np.zeros((3, 2)), np.zeros(3), H, None, [0.0, 1.0, math.inf])


def test_revisits_are_readings_near_in_space_and_far_in_time():
    x = np.array([[0.0, 0.0], [3.0, 4.0], [0.0, 1.0], [50.0, 0.0], [51.0, 0.0]])
    visits = Readings.of(x, np.zeros(5), None, [0.0, 100.0, 1.0, 5.0, 6.0])
    assert visits.revisits(6.0, 50.0) == 3
    assert visits.revisits(4.5, 50.0) == 2
    assert visits.revisits(6.0, 100.0) == 0
    assert visits.revisits(6.0, 0.5) == 5
    assert Readings.of(x, np.zeros(5)).revisits(6.0, 0.5) == 0
