"""The compiled arithmetic against scipy's: the same posterior, whatever signs the rotations choose."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.learning import arithmetic, plain

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
    np.testing.assert_allclose(state, expected, rtol=0, atol=1e-13)
    assert np.array_equal(state[:-1], state[:-1].T)


def test_what_does_not_fit_is_refused():
    state, factors = make(4, (0, 1), 0)
    other, p = np.zeros_like(state, order="F"), np.zeros(9)
    for call in (
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
    for call in (
        lambda: _compiled.whiten(None, p),
        lambda: _compiled.remove(state, other, factors, ("a", 1), 0),
        lambda: _compiled.remove(state, other, 3, (0, 1), 0),
    ):
        with pytest.raises(TypeError):
            call()
