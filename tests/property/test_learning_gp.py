"""Whatever the stream, the online model stays a proper posterior."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.learning.history import History
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP

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
