"""Whatever the stream, the online model stays a proper posterior."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.learning.history import History
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static

coordinates = st.floats(-500, 500) | st.sampled_from([0.0, 1.0, 1.0 + 1e-9, -0.0])
streams = st.lists(
    st.tuples(coordinates, coordinates, st.floats(-10, 10), st.floats(0, 50)), min_size=1, max_size=60
)
models = st.builds(
    lambda capacity, novelty, jitter, scales, noise, timescale: SparseOnlineGP(
        Hyperparameters(1.0, noise, scales, timescale), capacity, novelty, jitter
    ),
    st.integers(1, 12),
    st.sampled_from([0.0, 1e-6, 1e-3, 0.3]),
    st.sampled_from([1e-12, 1e-8, 1e-4]),
    st.tuples(st.floats(1, 1e4), st.floats(1, 1e4)),
    st.floats(1e-4, 10),
    st.sampled_from([float("inf"), 30.0]),
)
PROBES = np.stack(np.meshgrid(np.linspace(-600, 600, 7), np.linspace(-600, 600, 7)), -1).reshape(-1, 2)


@settings(max_examples=150, deadline=None)
@given(models, streams)
def test_variances_stay_between_nothing_and_the_prior(gp, stream):
    for x, y, value, pause in stream:
        gp.advance(pause)
        gp.update((x, y), value)
    probes = np.vstack([PROBES, gp.basis])
    prediction = gp.predict(probes)
    assert len(gp) <= gp.capacity
    assert np.isfinite(prediction.mean).all()
    assert prediction.variance.min() >= -1e-6
    assert prediction.variance.max() <= 1 + 1e-6
    model = gp.model()
    expected = gp.kernel.covariance(gp.basis, gp.basis) + gp.jitter * np.eye(len(gp))
    np.testing.assert_allclose(model.factors[0] @ model.factors[0].T, expected, atol=1e-12)
    np.testing.assert_array_equal(model.whitened_covariance, model.whitened_covariance.T)
    assert len(gp.basis_readings) == len(gp.basis_births) == len(gp)


positive = st.floats(0.2, 2.0)
spaces = st.builds(
    lambda kind, scales: kind(scales),
    st.sampled_from([SquaredExponential, Matern32]),
    st.tuples(st.floats(20, 200), st.floats(20, 200)),
)
times = st.just(Static()) | st.builds(
    lambda kind, timescale: kind(timescale),
    st.sampled_from([OrnsteinUhlenbeck, MaternMotion]),
    st.floats(5, 500),
)
kernels = st.builds(
    Kernel,
    st.lists(st.builds(Component, positive, spaces, times), min_size=1, max_size=4),
    st.floats(0.01, 1.0),
)


@settings(max_examples=60, deadline=None)
@given(kernels, st.integers(0, 2**32 - 1), st.integers(1, 25), st.floats(0, 20), st.floats(0, 100))
def test_any_sum_of_components_is_the_dense_space_time_process(kernel, seed, n, pause, later):
    """While nothing is dropped, and noise is no smaller than a hundredth: the dense solution is then good to 1e-10."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.uniform(-60, 60, (n, 2)), axis=0)
    y, t = rng.normal(size=n), np.cumsum(pause * rng.exponential(size=n))
    gp = SparseOnlineGP(kernel, n, novelty=0.0, jitter=1e-12)
    for i in range(n):
        gp.advance(t[i] - t[i - 1] if i else 0.0)
        gp.update(x[i], y[i])
    gp.advance(later)
    points = np.vstack([x, rng.uniform(-200, 200, (10, 2))])
    K = kernel.covariance(x, x, np.abs(np.subtract.outer(t, t))) + kernel.noise_variance * np.eye(n)
    k = kernel.covariance(x, points, np.repeat((t[-1] + later - t)[:, None], len(points), axis=1))
    gain = np.linalg.solve(K, k)
    prediction = gp.predict(points)
    np.testing.assert_allclose(prediction.mean, y @ gain, atol=1e-7, rtol=0)
    variance = kernel.signal_variance - np.einsum("ij,ij->j", k, gain)
    np.testing.assert_allclose(prediction.variance, variance, atol=1e-7, rtol=0)


@settings(max_examples=60, deadline=None)
@given(kernels, streams, st.integers(1, 12), st.sampled_from([0.0, 1e-3, 0.3]))
def test_any_sum_of_components_stays_a_proper_posterior(kernel, stream, capacity, novelty):
    gp = SparseOnlineGP(kernel, capacity, novelty)
    for x, y, value, pause in stream:
        gp.advance(pause)
        gp.update((x, y), value)
    gp.resize(max(1, capacity // 2))
    gp.absorb(PROBES, np.zeros(len(PROBES)), np.ones(len(PROBES)))
    assert gp.check() is None
    variance = gp.predict(np.vstack([PROBES, gp.basis])).variance
    assert variance.min() >= -1e-6 * kernel.signal_variance
    assert variance.max() <= (1 + 1e-6) * kernel.signal_variance


@settings(max_examples=50, deadline=None)
@given(models, streams, st.data())
def test_predictions_move_with_the_readings_offset_and_unit(gp, stream, data):
    offset, unit = data.draw(st.sampled_from([-400.0, 33.5])), data.draw(st.sampled_from([1e-3, 50.0]))
    h = gp.kernel.hyperparameters
    scaled = Hyperparameters(h.signal_variance * unit**2, h.noise_variance * unit**2, h.lengthscales_m)
    plain = SparseOnlineGP(Hyperparameters(1.0, h.noise_variance, h.lengthscales_m), 100)
    other = SparseOnlineGP(scaled, 100, prior_mean=offset)
    for x, y, value, _ in stream:
        plain.update((x, y), value)
        other.update((x, y), offset + unit * value)
    one, two = plain.predict(PROBES), other.predict(PROBES)
    np.testing.assert_allclose((two.mean - offset) / unit, one.mean, atol=1e-4)
    np.testing.assert_allclose(two.variance / unit**2, one.variance, atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(streams, st.integers(10, 40))
def test_the_history_is_bounded_and_loses_nothing(stream, maximum):
    history, now = History(100.0, maximum), 0.0
    for x, y, value, pause in stream * 3:
        now += pause
        history.add((x, y), value, now)
    cells = history.cells()
    assert len(cells) <= maximum
    assert cells.counts.sum() == 3 * len(stream)
    np.testing.assert_allclose(cells.means @ cells.counts, 3 * sum(row[2] for row in stream), atol=1e-6)
