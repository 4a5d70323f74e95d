"""A state that is damaged is found out, whatever the damage, and stays found out."""

import numpy as np
import pytest

from autonomy.learning.invariants import broken
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP, Update
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck

KERNEL = Kernel(
    (
        Component(1.0, SquaredExponential((100.0, 100.0))),
        Component(0.5, SquaredExponential((50.0, 50.0)), OrnsteinUhlenbeck(500.0)),
        Component(0.5, SquaredExponential((70.0, 70.0)), MaternMotion(500.0)),
    ),
    0.01,
)


@pytest.fixture
def gp():
    gp = SparseOnlineGP(KERNEL, 20)
    learn(gp, 300)
    assert gp.fault() is None
    assert gp.check() is None
    return gp


def learn(gp, n, seed=0):
    rng = np.random.default_rng(seed)
    for x in rng.uniform(0, 300, (n, 2)):
        gp.advance(1.0)
        gp.update(x, rng.normal())


def matrix(gp):
    return gp._state.matrix


def not_finite_mean(gp):
    matrix(gp)[-1, 7] = np.nan


def not_finite_covariance(gp):
    matrix(gp)[3, 8] = np.inf


def negative_variance(gp):
    matrix(gp)[5, 5] = -0.5


def variance_above_the_prior(gp):
    matrix(gp)[5, 5] = 1.5


def indefinite(gp):
    # The variances stay as they are: only an eigenvalue tells.
    matrix(gp)[4, 9] = matrix(gp)[9, 4] = 1.0


def wider_than_the_prior(gp):
    matrix(gp)[:-1] += 0.1 * np.outer(np.ones(4 * 21), np.ones(4 * 21))


def skew(gp):
    matrix(gp)[4, 9] += 1e-3


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (not_finite_mean, r"mean\[7\] is nan"),
        (not_finite_covariance, r"covariance\[3, 8\] is inf"),
        (negative_variance, "negative"),
        (variance_above_the_prior, "above 1"),
        (indefinite, "negative|above 1"),
        (wider_than_the_prior, "above 1"),
        (skew, "not symmetric"),
    ],
)
def test_damage_is_told_by_a_look_at_everything_and_found_while_learning(gp, damage, complaint):
    assert broken(matrix(gp)) is None
    damage(gp)
    with pytest.raises(AssertionError, match=complaint):
        assert (gp.check() or "") == ""
    assert gp.fault() == gp.check()


@pytest.mark.parametrize(
    ("damage", "within"),
    [
        (not_finite_mean, 1),
        (not_finite_covariance, 1),
        (negative_variance, 8),
        (variance_above_the_prior, 8),
        (wider_than_the_prior, 8),
        (indefinite, 300),
        (skew, 300),
    ],
)
def test_learning_finds_it_soon_and_stops(gp, damage, within):
    damage(gp)
    for _ in range(within):
        # So far away that it tells the state nothing: a reading at hand may well heal what was damaged.
        gp.project((1e5, 1e5), 0.0)
    fault = gp.fault()
    assert fault is not None
    state, size = matrix(gp).copy(), len(gp)
    assert gp.update((1000.0, 1000.0), 3.0) is Update.PROJECTED
    gp.project((1000.0, 1000.0), 3.0)
    gp.absorb([[1000.0, 1000.0]], [3.0], [0.01])
    np.testing.assert_array_equal(matrix(gp), state)
    assert len(gp) == size
    assert gp.fault() == fault


def test_a_damaged_covariance_is_found_while_absorbing(gp):
    matrix(gp)[:-1] -= 5.0 * np.eye(4 * 21)
    gp.absorb(np.random.default_rng(1).uniform(0, 300, (200, 2)), np.zeros(200), np.full(200, 0.01))
    assert "positive definite" in gp.fault()


def test_a_reading_that_cannot_be_predicted_has_no_residual(gp):
    assert gp.residual is not None
    not_finite_mean(gp)
    gp.update((150.0, 150.0), 0.0)
    assert "innovation was nan" in gp.fault()
    assert gp.residual is None


def test_an_empty_state_is_sound():
    gp = SparseOnlineGP(KERNEL, 5)
    assert gp.check() is None
