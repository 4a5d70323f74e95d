"""The online model against the dense Gaussian process, batch FITC, and itself taken the long way round."""

import copy
import math
import pickle

import numpy as np
import pytest

from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP, Update

H = Hyperparameters(2.0, 0.02, (30.0, 50.0))


def dense(x, y, h, points, prior_mean=0.0, noise=None):
    """The textbook posterior: mean (n,) and full covariance (n, n)."""
    noise = np.full(len(x), h.noise_variance) if noise is None else noise
    K = h.kernel.covariance(x, x) + np.diag(noise)
    k = h.kernel.covariance(x, points)
    mean = prior_mean + k.T @ np.linalg.solve(K, y - prior_mean)
    return mean, h.kernel.covariance(points, points) - k.T @ np.linalg.solve(K, k)


def readings(seed, n, extent=200.0):
    rng = np.random.default_rng(seed)
    x = rng.uniform(0, extent, (n, 2))
    return x, np.sin(x[:, 0] / 35) + np.cos(x[:, 1] / 45) + 0.1 * rng.normal(size=n)


def fed(gp, x, y):
    for point, value in zip(x, y, strict=True):
        gp.update(point, value)
    return gp


def spaced_points(seed, n, extent, apart):
    """`n` random points, no two of them closer than `apart` (in length-scales)."""
    rng = np.random.default_rng(seed)
    points = []
    while len(points) < n:
        p = rng.uniform(0, extent, 2)
        if all(math.hypot(*(p - q)) >= apart for q in points):
            points.append(p)
    return np.array(points)


@pytest.mark.parametrize("seed", range(3))
def test_with_capacity_to_spare_it_is_the_dense_gaussian_process(seed):
    x = spaced_points(seed, 60, 3.0, 0.25) * [30.0, 50.0]
    y = readings(seed, 60)[1]
    gp = SparseOnlineGP(H, 100, novelty=0.0, jitter=1e-12, prior_mean=0.3)
    assert [gp.update(p, v) for p, v in zip(x, y, strict=True)] == [Update.ADDED] * 60
    points = np.random.default_rng(seed).uniform(-30, 250, (80, 2))
    mean, covariance_ = dense(x, y, H, points, 0.3)
    prediction = gp.predict(points)
    np.testing.assert_allclose(prediction.mean, mean, atol=1e-8, rtol=0)
    np.testing.assert_allclose(gp.covariance(points), covariance_, atol=1e-8, rtol=0)
    np.testing.assert_allclose(prediction.variance, np.diag(covariance_), atol=1e-8, rtol=0)


def test_a_noise_variance_of_its_own_counts_for_that_reading_only():
    x, y = readings(0, 25)
    noise = np.linspace(0.01, 1.0, 25)
    gp = SparseOnlineGP(H, 100, novelty=0.0, jitter=1e-12)
    for point, value, variance in zip(x, y, noise, strict=True):
        gp.update(point, value, noise_variance=variance)
    mean, covariance_ = dense(x, y, H, x, noise=noise)
    np.testing.assert_allclose(gp.predict(x).mean, mean, atol=1e-8)
    np.testing.assert_allclose(gp.covariance(x), covariance_, atol=1e-8)


@pytest.mark.parametrize("jitter", [1e-12, 1e-8, 1e-4])
def test_a_reduced_update_is_adding_and_then_deleting_the_added(jitter):
    x, y = readings(1, 30)
    gp = fed(SparseOnlineGP(H, 40, novelty=0.0, jitter=jitter), x, y)
    long_way = copy.deepcopy(gp)
    place, value = np.array([77.0, 88.0]), 1.7
    gp.project(place, value)
    assert long_way.update(place, value) is Update.ADDED
    long_way.delete(len(long_way) - 1)
    points = readings(2, 50)[0]
    np.testing.assert_allclose(gp.predict(points).mean, long_way.predict(points).mean, atol=1e-9)
    np.testing.assert_allclose(gp.covariance(points), long_way.covariance(points), atol=1e-9)


def test_deletion_preserves_the_marginal_of_the_retained_basis():
    x, y = readings(3, 40)
    gp = fed(SparseOnlineGP(H, 60, novelty=0.0, jitter=1e-10), x, y)
    for index in (0, 17, 37, 5, 20):
        before, kept = gp.model(), np.delete(np.arange(len(gp)), index)
        mean = (before.factors[0] @ before.whitened_mean)[kept]
        spread = (before.factors[0] @ before.whitened_covariance @ before.factors[0].T)[np.ix_(kept, kept)]
        retained = gp.basis[kept]
        gp.delete(index)
        after = gp.model()
        np.testing.assert_array_equal(gp.basis, retained)
        np.testing.assert_allclose(after.factors[0] @ after.whitened_mean, mean, atol=1e-8)
        np.testing.assert_allclose(
            after.factors[0] @ after.whitened_covariance @ after.factors[0].T, spread, atol=1e-8
        )


def test_deleting_everything_leaves_the_prior():
    x, y = readings(4, 5)
    gp = fed(SparseOnlineGP(H, 10, prior_mean=3.0), x, y)
    while len(gp):
        gp.delete(len(gp) // 2)
    prediction = gp.predict(x)
    assert (prediction.mean == 3.0).all()
    assert (prediction.variance == 2.0).all()
    assert gp.update(x[0], 1.0) is Update.ADDED


def test_on_a_frozen_basis_the_stream_is_batch_fitc():
    x, y = readings(5, 300)
    gp = SparseOnlineGP(H, 30, novelty=0.0)
    gp.start_basis(x[:30], y[:30], np.ones(30))
    batch = copy.deepcopy(gp)
    for point, value in zip(x, y, strict=True):
        gp.project(point, value)
    batch.absorb(x[:100], y[:100], np.full(100, H.noise_variance))
    batch.absorb(x[100:], y[100:], np.full(200, H.noise_variance))
    points = readings(6, 60)[0]
    expected = fitc(x, y, x[:30], H, points)
    for model in (gp, batch):
        prediction = model.predict(points)
        np.testing.assert_allclose(prediction.mean, expected[0], atol=1e-6)
        np.testing.assert_allclose(prediction.variance, expected[1], atol=1e-6)
    np.testing.assert_allclose(gp.predict(points).mean, batch.predict(points).mean, atol=1e-9)


def fitc(x, y, basis, h, points, jitter=1e-8):
    """Snelson & Ghahramani 2006, literally."""
    K = h.kernel.covariance(basis, basis) + jitter * h.signal_variance * np.eye(len(basis))
    Kx, Ks = h.kernel.covariance(basis, x), h.kernel.covariance(basis, points)
    noise = (
        h.signal_variance * (1 + jitter)
        - np.einsum("ij,ij->j", Kx, np.linalg.solve(K, Kx))
        + h.noise_variance
    )
    A = K + (Kx / noise) @ Kx.T
    mean = Ks.T @ np.linalg.solve(A, Kx @ (y / noise))
    reduction = np.linalg.solve(K, Ks) - np.linalg.solve(A, Ks)
    return mean, h.signal_variance - np.einsum("ij,ij->j", Ks, reduction)


def test_the_views_alpha_c_and_q_are_those_of_the_textbook():
    x, y = readings(7, 30)
    gp = fed(SparseOnlineGP(H, 20, novelty=1e-2, prior_mean=0.5), x, y)
    points = readings(8, 20)[0]
    k = H.kernel.covariance(gp.basis, points)
    prediction = gp.predict(points)
    np.testing.assert_allclose(0.5 + gp.alpha @ k, prediction.mean, atol=1e-9)
    np.testing.assert_allclose(2.0 + np.einsum("ij,ij->j", k, gp.C @ k), prediction.variance, atol=1e-7)
    K = H.kernel.covariance(gp.basis, gp.basis) + 2e-8 * np.eye(len(gp))
    np.testing.assert_allclose(gp.Q @ K, np.eye(len(gp)), atol=1e-5)


def test_the_score_kept_from_update_to_update_is_the_one_from_scratch():
    """|alpha_i|/Q_ii: the basis vector that goes is the least important after learning, whoever it is."""
    x, y = readings(9, 400, extent=400.0)
    gp = SparseOnlineGP(H, 25, novelty=1e-3)
    seen = set()
    for point, value in zip(x, y, strict=True):
        reference = copy.deepcopy(gp)
        reference.resize(26)
        outcome, before = gp.update(point, value), reference.basis
        if reference.update(point, value) is Update.ADDED and len(before) == 25:
            scores = np.abs(reference.alpha) / np.diag(reference.Q)
            worst = int(scores.argmin())
            assert outcome is (Update.PROJECTED if worst == 25 else Update.REPLACED)
            np.testing.assert_array_equal(gp.basis, np.delete(reference.basis, worst, axis=0))
            seen.add(outcome)
    assert seen == {Update.PROJECTED, Update.REPLACED}


def test_capacity_binds_and_every_reading_is_answered():
    x, y = readings(10, 200, extent=1000.0)
    gp = SparseOnlineGP(H, 15)
    outcomes = [gp.update(p, v) for p, v in zip(x, y, strict=True)]
    assert len(gp) == 15
    assert outcomes.count(Update.ADDED) == 15
    assert outcomes.count(Update.REPLACED) == gp.replacements > 0
    assert gp.updates == 200
    assert (np.diff(gp.basis_births) > 0).all()
    for point, reading, birth in zip(gp.basis, gp.basis_readings, gp.basis_births, strict=True):
        np.testing.assert_array_equal(point, x[birth - 1])
        assert reading == y[birth - 1]


def test_a_basis_vector_knows_of_how_many_readings_its_own_is_the_mean():
    x, y = readings(12, 40, extent=1000.0)
    gp = SparseOnlineGP(H, 20)
    gp.start_basis(x[:20], y[:20], np.arange(1.0, 21.0))
    of = dict(zip(map(tuple, x[:20]), np.arange(1.0, 21.0), strict=True))
    for point, value in zip(x[20:30], y[20:30], strict=True):
        gp.update(point, value)
        of[tuple(point)] = 1.0
    for point, value in zip(x[30:], y[30:], strict=True):
        gp.update(point, value, H.noise_variance / 4)
        of[tuple(point)] = 4.0
    assert gp.replacements > 5
    np.testing.assert_allclose(gp.basis_counts, [of[tuple(point)] for point in gp.basis])
    with pytest.raises(ValueError, match="counts must be positive"):
        SparseOnlineGP(H, 20).start_basis(x[:2], y[:2], [1.0, 0.0])


def test_memory_that_is_used_again_is_not_shared_and_does_not_travel():
    x, y = readings(17, 120, extent=1000.0)
    one = fed(SparseOnlineGP(H, 15), x[:60], y[:60])
    other, model = copy.deepcopy(one), one.model()
    sent = pickle.loads(pickle.dumps(one))
    before = model.predict(x)
    assert one.replacements > 0
    assert len(pickle.dumps(one)) < 3 * 15 * 15 * 8 + 3000
    for gp in (one, other, sent):
        fed(gp, x[60:], y[60:])
        gp.delete(3)
    for gp in (other, sent):
        np.testing.assert_array_equal(gp.predict(x).mean, one.predict(x).mean)
        np.testing.assert_array_equal(gp.predict(x).variance, one.predict(x).variance)
    np.testing.assert_array_equal(model.predict(x).mean, before.mean)


def test_capacity_one_works():
    x, y = readings(11, 50)
    gp = fed(SparseOnlineGP(H, 1), x, y)
    assert len(gp) == 1
    assert np.isfinite(gp.predict(x).variance).all()


def test_novelty_keeps_a_revisited_place_out_of_the_basis():
    gp = SparseOnlineGP(H, 10, novelty=1e-3)
    assert gp.update([1.0, 2.0], 1.0) is Update.ADDED
    assert gp.update([1.0, 2.0], 1.1) is Update.PROJECTED
    mean, _ = dense(np.array([[1.0, 2.0]] * 2), np.array([1.0, 1.1]), H, np.array([[1.0, 2.0]]))
    assert gp.predict([[1.0, 2.0]]).mean == pytest.approx(mean, abs=1e-6)


def test_forgetting_is_exact_for_the_separable_kernel():
    h = Hyperparameters(2.0, 0.02, (30.0, 50.0), timescale_s=100.0)
    x, y = readings(12, 30)
    t = np.cumsum(np.random.default_rng(0).uniform(0, 20, 30))
    gp = SparseOnlineGP(h, 50, novelty=0.0, jitter=1e-12, prior_mean=0.4)
    for i in range(30):
        gp.advance(t[i] - t[i - 1] if i else 0.0)
        gp.update(x[i], y[i])
    gp.advance(15.0)
    points = readings(13, 40)[0]
    K = h.kernel.covariance(x, x) * np.exp(-abs(np.subtract.outer(t, t)) / 100.0)
    k = h.kernel.covariance(x, points) * np.exp(-(t[-1] + 15.0 - t) / 100.0)[:, None]
    noisy = K + 0.02 * np.eye(30)
    np.testing.assert_allclose(
        gp.predict(points).mean, 0.4 + k.T @ np.linalg.solve(noisy, y - 0.4), atol=1e-7
    )
    posterior = h.kernel.covariance(points, points) - k.T @ np.linalg.solve(noisy, k)
    np.testing.assert_allclose(gp.covariance(points), posterior, atol=1e-7)


def test_a_still_field_and_no_time_change_nothing():
    x, y = readings(14, 20)
    still = fed(SparseOnlineGP(H, 20), x, y)
    before = still.predict(x)
    still.advance(1e9)
    np.testing.assert_array_equal(still.predict(x).mean, before.mean)
    moving = fed(SparseOnlineGP(Hyperparameters(2.0, 0.02, (30.0, 50.0), 10.0), 20), x, y)
    moving.advance(1e4)
    assert np.allclose(moving.predict(x).variance, 2.0)


def test_it_travels_by_pickle():
    x, y = readings(15, 60)
    gp = fed(SparseOnlineGP(H, 20), x, y)
    other = pickle.loads(pickle.dumps(gp))
    more_x, more_y = readings(16, 60)
    fed(gp, more_x, more_y)
    fed(other, more_x, more_y)
    np.testing.assert_array_equal(gp.predict(x).mean, other.predict(x).mean)
    np.testing.assert_array_equal(gp.basis, other.basis)


def test_a_model_does_not_change_when_learning_goes_on():
    x, y = readings(17, 40)
    gp = fed(SparseOnlineGP(H, 20), x[:20], y[:20])
    model = gp.model()
    before = model.predict(x).mean
    fed(gp, x[20:], y[20:])
    np.testing.assert_array_equal(model.predict(x).mean, before)
    with pytest.raises(ValueError, match="read-only"):
        model.basis[0, 0] = 1.0


@pytest.mark.parametrize(
    ("x", "y", "noise"),
    [
        ([math.nan, 0.0], 1.0, None),
        ([0.0, math.inf], 1.0, None),
        ([0.0], 1.0, None),
        ([[0.0, 0.0]], 1.0, None),
        ([0.0, 0.0], math.nan, None),
        ([0.0, 0.0], math.inf, None),
        ([0.0, 0.0], 1.0, 0.0),
        ([0.0, 0.0], 1.0, math.nan),
    ],
)
def test_bad_input_is_refused_and_leaves_the_state_alone(x, y, noise):
    gp = fed(SparseOnlineGP(H, 20), *readings(18, 20))
    before = pickle.dumps(gp)
    with pytest.raises(ValueError, match="must"):
        gp.update(x, y, noise)
    assert pickle.dumps(gp) == before


@pytest.mark.parametrize(
    ("keywords", "complaint"),
    [
        ({"capacity": 0}, "capacity"),
        ({"capacity": 2.5}, "capacity"),
        ({"capacity": 10, "novelty": 1.0}, "novelty"),
        ({"capacity": 10, "novelty": math.nan}, "novelty"),
        ({"capacity": 10, "jitter": 0.0}, "jitter"),
        ({"capacity": 10, "prior_mean": math.nan}, "prior_mean"),
    ],
)
def test_impossible_settings_are_refused(keywords, complaint):
    with pytest.raises(ValueError, match=complaint):
        SparseOnlineGP(H, **keywords)


@pytest.mark.parametrize("dt", [-1.0, math.nan, math.inf])
def test_time_does_not_run_backwards(dt):
    with pytest.raises(ValueError, match="dt_s"):
        SparseOnlineGP(H, 5).advance(dt)


def test_a_missing_basis_vector_cannot_be_deleted():
    with pytest.raises(ValueError, match="no basis vector 3"):
        fed(SparseOnlineGP(H, 5), *readings(0, 2)).delete(3)
