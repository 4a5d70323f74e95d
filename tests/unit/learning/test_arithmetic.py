"""The compiled arithmetic against scipy's: the same posterior, whatever signs the rotations choose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.learning import arithmetic, plain
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.members import Members
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck

if not arithmetic.COMPILED:
    pytest.skip("no compiler was there when the package was installed", allow_module_level=True)

from autonomy.learning import _compiled


def make(n, blocks, seed):
    """A state (D + 1, D) and the factors of its groups."""
    rng = np.random.default_rng(seed)
    D = n * len(blocks)
    root = rng.normal(size=(D, D))
    state = np.asfortranarray(np.vstack([root @ root.T / (4 * D), rng.normal(size=D)]))
    factors = []
    for _ in range(max(blocks) + 1):
        root = rng.normal(size=(n, n))
        factors.append(np.asfortranarray(np.linalg.cholesky(root @ root.T / n + 1e-4 * np.eye(n))))
    return state, factors


def in_places(state, factors, blocks):
    """Mean and covariance of the field and its other states at the basis vectors: free of the choice of signs."""
    n = len(factors[0])
    L = np.zeros((n * len(blocks), n * len(blocks)))
    for b, group in enumerate(blocks):
        L[b * n : (b + 1) * n, b * n : (b + 1) * n] = factors[group]
    return L @ state[-1], L @ state[:-1] @ L.T


@given(
    n=st.integers(2, 12),
    blocks=st.sampled_from([(0,), (0, 1), (0, 1, 1), (0, 0)]),
    seed=st.integers(0, 2**32 - 1),
    data=st.data(),
)
def test_a_removal_leaves_what_scipy_leaves(n, blocks, seed, data):
    index = data.draw(st.integers(0, n - 1))
    results = []
    for module in (plain, _compiled):
        state, factors = make(n, blocks, seed)
        other = np.asfortranarray(np.full_like(state, np.nan))
        module.remove(state, other, factors, blocks, index)
        results.append((other, factors))
    (expected, plain_factors), (found, factors) = results
    for mine, theirs in zip(factors, plain_factors, strict=True):
        assert np.array_equal(mine, np.tril(mine))
        np.testing.assert_allclose(mine @ mine.T, theirs @ theirs.T, rtol=0, atol=1e-12)
        assert mine[-1].tolist() == [0.0] * (n - 1) + [1.0]
    for mine, theirs in zip(
        in_places(found, factors, blocks), in_places(expected, plain_factors, blocks), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-10)


@given(n=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
def test_whitening_and_conditioning_are_scipys(n, seed):
    state, (factor,) = make(n, (0,), seed)
    rng = np.random.default_rng(seed + 1)
    k, p = rng.normal(size=n), rng.normal(size=n + 1)
    expected_k, expected_p, expected = k.copy(), p.copy(), state.copy(order="F")
    plain.whiten(factor, expected_k)
    plain.condition(expected, expected_p, 0.3, 2.5)
    _compiled.whiten(factor, k)
    _compiled.condition(state, p, 0.3, 2.5)
    np.testing.assert_allclose(k, expected_k, rtol=1e-9, atol=1e-9)
    plain.unwhiten(factor, expected_k)
    _compiled.unwhiten(factor, k)
    np.testing.assert_allclose(k, expected_k, rtol=1e-8, atol=1e-8 * np.abs(expected_k).max())
    np.testing.assert_allclose(state, expected, rtol=0, atol=1e-13)
    assert np.array_equal(state[:-1], state[:-1].T)


@given(n=st.integers(1, 30), seed=st.integers(0, 2**32 - 1), data=st.data())
def test_the_precisions_without_one(n, seed, data):
    """Both against the diagonal of the inverse of what is left."""
    index = data.draw(st.integers(0, n - 1))
    _, (factor,) = make(n, (0,), seed)
    K = factor @ factor.T
    left = np.delete(np.delete(K, index, axis=0), index, axis=1)
    truth = np.append(np.diagonal(np.linalg.inv(left)), 0.0)
    for module in (plain, _compiled):
        precision = np.diagonal(np.linalg.inv(K)).copy()
        module.drop_precision(factor, precision, index, 1e-9)
        np.testing.assert_allclose(precision, truth, rtol=1e-6)


@given(m=st.integers(0, 20), seed=st.integers(0, 2**32 - 1))
def test_covariances_are_the_kernels(m, seed):
    """Two groups, the second of two components, against the components' own covariance."""
    rng = np.random.default_rng(seed)
    groups = Kernel(
        (
            Component(2.0, SquaredExponential((300.0, 500.0))),
            Component(0.5, Matern32((90.0, 70.0)), OrnsteinUhlenbeck(60.0)),
            Component(0.7, SquaredExponential((40.0, 45.0)), OrnsteinUhlenbeck(60.0)),
        ),
        0.01,
    ).groups
    members = Members(groups, 2)
    points, here = rng.uniform(-1e3, 1e3, (m, 2)), rng.uniform(-1e3, 1e3, 2)
    for point in points:
        members.append(point, 0.0, 1.0, 0)
    parts = [np.full(m + 1, np.nan) for _ in groups]
    members.covariances(here, parts)
    for part, group in zip(parts, groups, strict=True):
        np.testing.assert_allclose(
            part[:m], group.covariance(points, here[None])[:, 0], rtol=1e-12, atol=1e-300
        )


def test_what_does_not_fit_is_refused():
    state, factors = make(4, (0, 1), 0)
    other, p = np.zeros_like(state, order="F"), np.zeros(9)
    table, recipe = np.zeros((7, 5)), np.asfortranarray([[0.0], [0.0], [1.0]])
    here, parts = np.zeros(2), [np.zeros(6)]
    for call in (
        lambda: _compiled.drop_precision(factors[0], np.zeros(4), 4, 0.0),
        lambda: _compiled.drop_precision(factors[0], np.zeros(3), 0, 0.0),
        lambda: _compiled.covariances(table, 6, here, recipe, parts),
        lambda: _compiled.covariances(table, -1, here, recipe, parts),
        lambda: _compiled.covariances(table, 5, here, recipe[:2], parts),
        lambda: _compiled.covariances(table, 5, here, recipe, [np.zeros(4)]),
        lambda: _compiled.covariances(table, 5, here, recipe + 2.0, parts * 3),
        lambda: _compiled.whiten(factors[0], np.zeros(3)),
        lambda: _compiled.whiten(factors[0][:, :3], np.zeros(4)),
        lambda: _compiled.whiten(factors[0], np.zeros((4, 1))),
        lambda: _compiled.whiten(factors[0], np.zeros(4, dtype=np.float32)),
        lambda: _compiled.condition(state, p[:-1], 0.0, 1.0),
        lambda: _compiled.condition(state[:-1], p, 0.0, 1.0),
        lambda: _compiled.remove(state, other, factors, (0, 1), 4),
        lambda: _compiled.remove(state, other, factors, (0, 1), -1),
        lambda: _compiled.remove(state, other, factors, (0, 2), 0),
        lambda: _compiled.remove(state, other, factors, (0, -1), 0),
        lambda: _compiled.remove(state, other, factors[:1], (0, 1), 0),
        lambda: _compiled.remove(state, other, factors, (0,), 0),
        lambda: _compiled.remove(state, other, factors, (), 0),
        lambda: _compiled.remove(state, other, [], (0, 1), 0),
        lambda: _compiled.remove(state, other[:, :4], factors, (0, 1), 0),
        lambda: _compiled.remove(np.ascontiguousarray(state), other, factors, (0, 1), 0),
    ):
        with pytest.raises((ValueError, BufferError)):
            call()
    with pytest.raises(IndexError):
        _compiled.covariances(table, 5, here, recipe, [])
    for call in (
        lambda: _compiled.whiten(None, p),
        lambda: _compiled.remove(state, other, factors, ("a", 1), 0),
        lambda: _compiled.remove(state, other, 3, (0, 1), 0),
    ):
        with pytest.raises(TypeError):
            call()
