"""A ship's track, 100 000 readings a metre apart: the textbook recursions diverge within a hundred."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP, Update


def track(seed, n, extent):
    """A vessel turning smoothly inside a square, one reading a metre."""
    rng = np.random.default_rng(seed)
    turns, points = 0.05 * rng.normal(size=n), np.empty((n, 2))
    position, heading = np.full(2, extent / 2), 0.0
    for i in range(n):
        heading += turns[i]
        step = np.array([np.cos(heading), np.sin(heading)])
        if not ((position + step > 0) & (position + step < extent)).all():
            centre = np.full(2, extent / 2) - position
            heading = np.arctan2(centre[1], centre[0]) + turns[i]
            step = np.array([np.cos(heading), np.sin(heading)])
        position = position + step
        points[i] = position
    return points


def field(points, lengthscale):
    x, y = points.T / lengthscale
    return np.sin(1.1 * x + 0.3) * np.cos(0.8 * y) + 0.5 * np.cos(0.7 * x - 0.9 * y)


def batch(gp, points, values):
    """Batch FITC on the same basis, a thousand readings at a time."""
    whole = SparseOnlineGP(gp.kernel, gp.capacity, gp.novelty, gp.jitter, gp.prior_mean)
    whole.start_basis(gp.basis, gp.basis_readings, gp.basis_counts)
    for start in range(0, len(points), 1000):
        part = slice(start, start + 1000)
        whole.absorb(points[part], values[part], np.full(len(values[part]), gp.kernel.noise_variance))
    return whole


def plain_variance(model, axis):
    """1 − |a|² + aᵀSa with a = L⁻¹k: unlike the model's own form, one minus squares, it can exceed one."""
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    k = model.kernel.covariance(model.basis, points)
    a = solve_triangular(model.factors[0], k, lower=True)
    variance = 1.0 - np.einsum("ij,ij->j", a, a) + np.einsum("ij,ij->j", a, model.whitened_covariance @ a)
    return variance.reshape(len(axis), len(axis))


def test_the_plain_variance_would_show_a_posterior_wider_than_the_prior():
    gp = SparseOnlineGP(Hyperparameters(1.0, 0.01, (10.0, 10.0)), 5)
    for i in range(5):
        gp.update((4.0 * i, 0.0), 0.0)
    model = gp.model()
    too_wide = replace(model, whitened_covariance=model.whitened_covariance + 2 * np.eye(5))
    axis = np.linspace(0, 16, 9)
    assert plain_variance(model, axis).max() <= 1
    assert plain_variance(too_wide, axis).max() > 1.5


@pytest.mark.parametrize("extent_in_scales", [3.0, 30.0], ids=["capacity suffices", "capacity is short"])
@pytest.mark.parametrize("lengthscale", [10.0, 30.0, 1000.0])
def test_a_hundred_thousand_readings_a_metre_apart(lengthscale, extent_in_scales):
    n = 100_000 if extent_in_scales < 10 else 30_000
    extent = extent_in_scales * lengthscale
    h = Hyperparameters(1.0, 0.01, (lengthscale, lengthscale))
    points = track(1, n, extent)
    values = field(points, lengthscale) + 0.1 * np.random.default_rng(2).normal(size=n)
    gp = SparseOnlineGP(h, 100)
    outcomes = {gp.update(p, v) for p, v in zip(points, values, strict=True)}
    assert Update.PROJECTED in outcomes
    axis = np.linspace(-0.1 * extent, 1.1 * extent, 60)
    prediction = gp.predict_grid(axis, axis)
    assert np.isfinite(prediction.mean).all()
    variance = plain_variance(gp.model(), axis)
    assert variance.min() >= -1e-6
    assert variance.max() <= 1 + 1e-6
    np.testing.assert_allclose(prediction.variance, variance, atol=1e-6)
    eigenvalues = np.linalg.eigvalsh(np.eye(len(gp)) - gp.model().whitened_covariance)
    assert eigenvalues[0] > -1e-9
    assert eigenvalues[-1] < 1 + 1e-9
    if extent_in_scales < 10:
        visited = points[:: n // 500]
        exact = batch(gp, points, values).predict(visited)
        assert np.abs(gp.predict(visited).mean - exact.mean).max() < 0.01


@pytest.mark.parametrize("lengthscale", [10.0, 1000.0])
def test_no_novelty_threshold_is_needed_for_stability(lengthscale):
    h = Hyperparameters(1.0, 0.01, (lengthscale, lengthscale))
    points = track(3, 5000, 300.0)
    values = field(points, lengthscale) + 0.1 * np.random.default_rng(4).normal(size=5000)
    gp = SparseOnlineGP(h, 50, novelty=0.0)
    for p, v in zip(points, values, strict=True):
        gp.update(p, v)
    axis = np.linspace(0, 300, 40)
    prediction = gp.predict_grid(axis, axis)
    assert np.abs(prediction.mean).max() < 5
    variance = plain_variance(gp.model(), axis)
    assert variance.min() >= -1e-6
    assert variance.max() <= 1 + 1e-6
    np.testing.assert_allclose(prediction.variance, variance, atol=1e-6)
