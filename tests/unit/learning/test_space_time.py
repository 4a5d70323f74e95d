"""Several components, still and moving, against the dense space-time Gaussian process and the long way round."""

import copy
import math

import numpy as np
import pytest

from autonomy.learning.basis import prior_factors, select_basis
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP, Update
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck

SE = SquaredExponential
KERNELS = {
    "static": Kernel((Component(2.0, SE((30.0, 50.0))),), 0.02),
    "ou": Kernel((Component(2.0, SE((30.0, 50.0)), OrnsteinUhlenbeck(100.0)),), 0.02),
    "matern motion": Kernel((Component(2.0, SE((30.0, 50.0)), MaternMotion(100.0)),), 0.02),
    "static + ou": Kernel(
        (Component(2.0, SE((60.0, 80.0))), Component(0.7, SE((20.0, 30.0)), OrnsteinUhlenbeck(100.0))), 0.02
    ),
    "long + short": Kernel((Component(2.0, SE((60.0, 80.0))), Component(0.5, Matern32((20.0, 20.0)))), 0.02),
    "everything": Kernel(
        (
            Component(0.3, Matern32((25.0, 20.0)), OrnsteinUhlenbeck(60.0)),
            Component(2.0, SE((60.0, 80.0))),
            Component(0.5, Matern32((20.0, 20.0)), MaternMotion(60.0)),
            Component(0.4, SE((25.0, 20.0)), OrnsteinUhlenbeck(60.0)),
        ),
        0.02,
    ),
}
by_kernel = pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
POINTS = np.random.default_rng(99).uniform(-20, 220, (50, 2))


def stream(seed, n):
    """Places, readings and the pauses before them."""
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 200, (n, 2)), rng.normal(size=n), rng.uniform(0, 10, n)


def fed(gp, x, y, pauses):
    for point, value, pause in zip(x, y, pauses, strict=True):
        gp.advance(pause)
        gp.update(point, value)
    return gp


def dense(kernel, x, y, t, now, prior_mean, points=POINTS):
    """The textbook posterior over (place, time): mean (N,) and covariance (N, N) at one moment."""
    lags = np.abs(np.subtract.outer(t, t))
    K = kernel.covariance(x, x, lags) + kernel.noise_variance * np.eye(len(x))
    k = kernel.covariance(x, points, np.repeat((now - t)[:, None], len(points), axis=1))
    mean = prior_mean + k.T @ np.linalg.solve(K, y - prior_mean)
    return mean, kernel.covariance(points, points) - k.T @ np.linalg.solve(K, k)


@by_kernel
@pytest.mark.parametrize("seed", range(2))
def test_with_capacity_to_spare_it_is_the_dense_space_time_process(kernel, seed):
    x, y, pauses = stream(seed, 60)
    gp = fed(SparseOnlineGP(kernel, 100, novelty=0.0, jitter=1e-12, prior_mean=0.4), x, y, pauses)
    assert len(gp) == 60
    t = np.cumsum(pauses)
    for later in (0.0, 15.0, 300.0):
        mean, covariance = dense(kernel, x, y, t, t[-1] + later, 0.4)
        model = gp.model().advanced(later)
        prediction = model.predict(POINTS)
        np.testing.assert_allclose(prediction.mean, mean, atol=1e-7, rtol=0)
        np.testing.assert_allclose(prediction.variance, np.diag(covariance), atol=1e-7, rtol=0)
        np.testing.assert_allclose(model.covariance(POINTS), covariance, atol=1e-7, rtol=0)
    before = gp.model()
    gp.advance(15.0)
    np.testing.assert_array_equal(gp.predict(POINTS).mean, before.advanced(15.0).predict(POINTS).mean)


@by_kernel
def test_the_residual_is_the_next_reading_against_the_dense_prediction_of_it(kernel):
    x, y, pauses = stream(3, 25)
    gp = SparseOnlineGP(kernel, 100, novelty=0.0, jitter=1e-12, prior_mean=0.4)
    assert gp.residual is None
    t = np.cumsum(pauses)
    for i in range(25):
        gp.advance(pauses[i])
        noise = 0.02 + 0.1 * (i % 2)
        projected = copy.deepcopy(gp)
        projected.project(x[i], y[i], noise)
        gp.update(x[i], y[i], noise)
        assert projected.residual == gp.residual
        assert gp.residual.variance > noise
        if i % 2 == 0:
            continue
        gp = fed(
            SparseOnlineGP(kernel, 100, novelty=0.0, jitter=1e-12, prior_mean=0.4), x[:i], y[:i], pauses[:i]
        )
        gp.advance(pauses[i])
        gp.update(x[i], y[i])
        mean, covariance = dense(kernel, x[:i], y[:i], t[:i], t[i], 0.4, x[i : i + 1])
        assert gp.residual.innovation == pytest.approx(y[i] - mean[0], abs=1e-8)
        assert gp.residual.variance == pytest.approx(covariance[0, 0] + kernel.noise_variance, abs=1e-8)


@by_kernel
@pytest.mark.parametrize("jitter", [1e-12, 1e-8, 1e-4])
def test_a_reduced_update_is_adding_and_then_deleting_the_added(kernel, jitter):
    gp = fed(SparseOnlineGP(kernel, 40, novelty=0.0, jitter=jitter), *stream(1, 30))
    long_way = copy.deepcopy(gp)
    place, value = np.array([77.0, 88.0]), 1.7
    gp.project(place, value)
    assert long_way.update(place, value) is Update.ADDED
    assert gp.residual == long_way.residual
    long_way.delete(len(long_way) - 1)
    for later in (0.0, 30.0):
        one, two = gp.model().advanced(later), long_way.model().advanced(later)
        np.testing.assert_allclose(one.predict(POINTS).mean, two.predict(POINTS).mean, atol=1e-9)
        np.testing.assert_allclose(one.covariance(POINTS), two.covariance(POINTS), atol=1e-9)


def unwhitened(model):
    """Mean (states, m) and covariance (states, m, states, m) of every state at the basis vectors."""
    kernel, m = model.kernel, len(model)
    factors = [
        f for f, group in zip(model.factors, kernel.groups, strict=True) for _ in range(group.time.states)
    ]
    F = np.zeros((len(factors) * m, len(factors) * m))
    for b, factor in enumerate(factors):
        F[b * m : (b + 1) * m, b * m : (b + 1) * m] = factor
    shape = (len(factors), m)
    return (F @ model.whitened_mean).reshape(shape), (F @ model.whitened_covariance @ F.T).reshape(shape * 2)


@by_kernel
def test_deletion_preserves_the_marginal_of_the_retained_in_every_state(kernel):
    gp = fed(SparseOnlineGP(kernel, 60, novelty=0.0, jitter=1e-10), *stream(3, 40))
    for index in (0, 17, 37, 5, 35):
        mean, spread = unwhitened(gp.model())
        kept = np.delete(np.arange(len(gp)), index)
        retained = gp.basis[kept]
        gp.delete(index)
        after_mean, after_spread = unwhitened(gp.model())
        np.testing.assert_array_equal(gp.basis, retained)
        np.testing.assert_allclose(after_mean, mean[:, kept], atol=1e-8)
        np.testing.assert_allclose(after_spread, spread[:, kept][:, :, :, kept], atol=1e-8)
        for factor, fresh in zip(gp.model().factors, prior_factors(gp.basis, kernel, 1e-10), strict=True):
            # A factor is unique but for the signs of its columns.
            np.testing.assert_allclose(factor * np.sign(np.diag(factor)), fresh, atol=1e-7)


@by_kernel
def test_absorbing_is_projecting_one_after_the_other_in_any_order(kernel):
    x, y, pauses = stream(4, 30)
    gp = fed(SparseOnlineGP(kernel, 30, novelty=0.0), x, y, pauses)
    rng = np.random.default_rng(5)
    places, values, noise = rng.uniform(0, 200, (300, 2)), rng.normal(size=300), rng.uniform(0.01, 1, 300)
    one, updates = copy.deepcopy(gp), gp.updates
    for i in rng.permutation(300):
        one.project(places[i], values[i], noise[i])
    gp.absorb(places, values, noise)
    assert gp.updates == one.updates == updates + 300
    for later in (0.0, 30.0):
        a, b = gp.model().advanced(later), one.model().advanced(later)
        np.testing.assert_allclose(a.predict(POINTS).mean, b.predict(POINTS).mean, atol=1e-9)
        np.testing.assert_allclose(a.covariance(POINTS), b.covariance(POINTS), atol=1e-9)


@by_kernel
def test_what_goes_is_what_changes_the_nowcast_least_where_it_is(kernel):
    """By its definition: delete each in turn, and see by how much the mean at its place changes."""
    x, y, pauses = stream(6, 26)
    gp = SparseOnlineGP(kernel, 25, novelty=0.0, jitter=1e-10)
    fed(gp, x[:25], y[:25], pauses[:25])
    gp.advance(pauses[25])
    roomy = copy.deepcopy(gp)
    roomy.resize(26)
    outcome = gp.update(x[25], y[25])
    assert roomy.update(x[25], y[25]) is Update.ADDED
    changes = []
    for index in range(26):
        without = copy.deepcopy(roomy)
        without.delete(index)
        place = roomy.basis[index : index + 1]
        changes.append(abs((without.predict(place).mean - roomy.predict(place).mean)[0]))
    worst = int(np.argmin(changes))
    assert outcome is (Update.PROJECTED if worst == 25 else Update.REPLACED)
    np.testing.assert_array_equal(gp.basis, np.delete(roomy.basis, worst, axis=0))


@by_kernel
def test_the_importances_stay_right_through_many_replacements(kernel):
    x, y, pauses = stream(7, 500)
    gp = fed(SparseOnlineGP(kernel, 20), x, y, pauses)
    assert gp.replacements > 20
    for mine, factor in zip(gp._state._precisions, gp.model().factors, strict=True):
        np.testing.assert_allclose(mine[:-1], np.diag(np.linalg.inv(factor @ factor.T)), rtol=1e-6)


@by_kernel
def test_shrinking_drops_the_least_important_and_growing_allows_more(kernel):
    x, y, pauses = stream(8, 60)
    gp = fed(SparseOnlineGP(kernel, 30), x[:50], y[:50], pauses[:50])
    by_hand = copy.deepcopy(gp)
    gp.resize(20)
    assert gp.capacity == len(gp) == 20
    while len(by_hand) > 20:
        scores = []
        for index in range(len(by_hand)):
            without, place = copy.deepcopy(by_hand), by_hand.basis[index : index + 1]
            without.delete(index)
            scores.append(abs((without.predict(place).mean - by_hand.predict(place).mean)[0]))
        by_hand.delete(int(np.argmin(scores)))
    np.testing.assert_array_equal(gp.basis, by_hand.basis)
    np.testing.assert_allclose(gp.predict(POINTS).mean, by_hand.predict(POINTS).mean, atol=1e-9)
    gp.resize(25)
    fed(gp, x[50:], y[50:], pauses[50:])
    assert len(gp) == 25
    with pytest.raises(ValueError, match="capacity"):
        gp.resize(0)


def test_what_is_still_stays_and_what_moves_is_forgotten():
    kernel = KERNELS["static + ou"]
    gp = fed(SparseOnlineGP(kernel, 60), *stream(9, 50))
    gp.advance(1e6)
    prediction = gp.predict(gp.basis)
    # What is left to know is the still part; the moving one is back at its prior.
    assert prediction.variance.min() > 0.7
    assert prediction.variance.max() < 2.7
    assert np.abs(prediction.mean).max() > 0.1
    moving = fed(SparseOnlineGP(KERNELS["matern motion"], 60), *stream(9, 50))
    moving.advance(1e5)
    assert np.allclose(moving.predict(POINTS).variance, 2.0)
    assert np.allclose(moving.predict(POINTS).mean, 0.0)


@by_kernel
def test_many_small_pauses_are_one_long_one(kernel):
    gp = fed(SparseOnlineGP(kernel, 20), *stream(10, 60))
    long_way = copy.deepcopy(gp)
    gp.advance(40.0)
    for _ in range(400):
        long_way.advance(0.1)
    np.testing.assert_allclose(gp.predict(POINTS).mean, long_way.predict(POINTS).mean, atol=1e-11)
    np.testing.assert_allclose(gp.covariance(POINTS), long_way.covariance(POINTS), atol=1e-11)


def test_no_time_and_nothing_that_moves_leave_every_bit_alone():
    for kernel, pause in ((KERNELS["long + short"], 1e9), (KERNELS["everything"], 0.0)):
        gp = fed(SparseOnlineGP(kernel, 20), *stream(11, 60))
        before = gp.model()
        gp.advance(pause)
        np.testing.assert_array_equal(gp.model().whitened_covariance, before.whitened_covariance)
        np.testing.assert_array_equal(gp.model().whitened_mean, before.whitened_mean)


def test_views_of_a_textbook_are_refused_where_there_is_no_such_textbook():
    for name in ("matern motion", "static + ou"):
        gp = fed(SparseOnlineGP(KERNELS[name], 20), *stream(12, 10))
        for view in ("alpha", "C", "Q"):
            with pytest.raises(ValueError, match="one state"):
                getattr(gp, view)
    assert fed(SparseOnlineGP(KERNELS["long + short"], 20), *stream(12, 10)).alpha.shape == (10,)


@by_kernel
def test_a_chosen_basis_explains_the_places_as_the_filter_reckons(kernel):
    x = stream(13, 120)[0]
    chosen = select_basis(x, kernel, 100, 0.3)
    assert 5 < len(chosen) < 100
    assert len(set(chosen)) == len(chosen)
    gp = SparseOnlineGP(kernel, 120, novelty=0.3)
    gp.start_basis(x[chosen], np.zeros(len(chosen)), np.ones(len(chosen)))
    for point in np.delete(x, chosen, axis=0):
        assert gp.update(point, 0.0) is Update.PROJECTED
    less = SparseOnlineGP(kernel, 120, novelty=0.3)
    less.start_basis(x[chosen[:-1]], np.zeros(len(chosen) - 1), np.ones(len(chosen) - 1))
    assert less.update(x[chosen[-1]], 0.0) is Update.ADDED


def test_places_that_coincide_are_chosen_once():
    x = np.repeat(stream(14, 5)[0], 4, axis=0)
    for kernel in KERNELS.values():
        assert len(select_basis(x, kernel, 20, 0.0)) == 5


@pytest.mark.parametrize("dt", [-1.0, math.nan, math.inf])
def test_time_runs_forwards_for_the_frozen_too(dt):
    gp = fed(SparseOnlineGP(KERNELS["everything"], 5), *stream(15, 5))
    with pytest.raises(ValueError, match="dt_s"):
        gp.model().advanced(dt)
