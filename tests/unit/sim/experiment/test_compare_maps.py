"""The batch process that maps other strategies' readings, against another library's and against brute force."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import Matern32
from autonomy.learning.temporal import OrnsteinUhlenbeck
from sim.experiment.compare_maps import BatchMap, Read

LENGTH_M, SIGNAL, NOISE = 2000.0, 0.8, 0.02
STILL = Kernel((Component(SIGNAL, Matern32((LENGTH_M, LENGTH_M))),), NOISE)


def read(count: int = 60, seed: int = 0) -> Read:
    rng = np.random.default_rng(seed)
    points = rng.uniform(0.0, 10_000.0, (count, 2))
    values = 30.0 + np.sin(points[:, 0] / 1500.0) + 0.1 * rng.normal(size=count)
    return Read(points, values, np.arange(count, dtype=float), np.ones(count))


def test_the_map_is_that_of_another_library() -> None:
    known = read()
    wanted = np.random.default_rng(1).uniform(-1000.0, 11_000.0, (30, 2))
    made = BatchMap(STILL, known)
    theirs = GaussianProcessRegressor(
        ConstantKernel(SIGNAL) * Matern(LENGTH_M, nu=1.5), alpha=NOISE, optimizer=None
    ).fit(known.points_m, known.values - made.prior_mean)
    mean, deviation = theirs.predict(wanted, return_std=True)
    found = made.predict(wanted, 0.0)
    assert found.mean == pytest.approx(mean + made.prior_mean, abs=1e-9)
    assert found.variance == pytest.approx(deviation**2, abs=1e-9)
    _, covariance = theirs.predict(wanted, return_cov=True)
    assert made.covariance(wanted, 0.0) == pytest.approx(covariance + NOISE * np.eye(30), abs=1e-9)


def test_an_average_counts_as_often_as_it_was_read() -> None:
    # Three readings at each place, or their mean with a third of the noise: the same belief.
    one = read(20)
    values = np.concatenate([one.values - 0.1, one.values, one.values + 0.1])
    thrice = Read(np.tile(one.points_m, (3, 1)), values, np.tile(one.times_s, 3), np.ones(60))
    mean = Read(one.points_m, one.values, one.times_s, np.full(20, 3.0))
    wanted = np.random.default_rng(1).uniform(0.0, 10_000.0, (30, 2))
    a, b = BatchMap(STILL, thrice).predict(wanted, 0.0), BatchMap(STILL, mean).predict(wanted, 0.0)
    assert a.mean == pytest.approx(b.mean, abs=1e-8)
    assert a.variance == pytest.approx(b.variance, abs=1e-8)


def test_what_moves_is_forgotten() -> None:
    component = Component(SIGNAL, Matern32((LENGTH_M, LENGTH_M)), OrnsteinUhlenbeck(100.0))
    known = read()
    made = BatchMap(Kernel((component,), NOISE), known)
    late = made.predict(known.points_m, 1e5)
    assert late.mean == pytest.approx(np.full(60, made.prior_mean))
    assert late.variance == pytest.approx(np.full(60, SIGNAL))
    newest = made.predict(known.points_m[-1:], float(known.times_s[-1]))
    assert newest.variance[0] < NOISE


def test_the_fit_finds_the_scales_of_a_draw() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, 10_000.0, (250, 2))
    K = STILL.covariance(points, points) + NOISE * np.eye(250)
    drawn = Read(points, np.linalg.cholesky(K) @ rng.normal(size=250), np.arange(250.0), np.ones(250))
    found = BatchMap.fitted(drawn, 10_000.0, may_move=True).kernel
    assert found.is_static
    assert found.components[0].space.lengthscales_m[0] == pytest.approx(LENGTH_M, rel=0.4)
    assert found.noise_variance == pytest.approx(NOISE, rel=0.5)


def test_before_anything_is_read_the_map_is_the_prior() -> None:
    made = BatchMap.fitted(Read.nothing(), 10_000.0, may_move=True)
    found = made.predict(np.zeros((3, 2)), 0.0)
    assert found.variance == pytest.approx(np.full(3, made.kernel.signal_variance))
    assert len(made.covariance(np.zeros((1, 2)), 0.0)) == 1
