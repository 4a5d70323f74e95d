"""The weighted variance of readings against dense algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.planning.weighted_variance import WeightedVariance, conditioned, planning_covariance


def water(seed, n=60):
    rng = np.random.default_rng(seed)
    return rng, planning_covariance(rng.random((n, 2))), rng.random(n)


def literal(K, precision):
    """(K⁻¹ + D)⁻¹ without dividing by K, which is nearly singular: K (I + D K)⁻¹."""
    return K @ np.linalg.inv(np.eye(len(K)) + precision[:, None] * K)


@pytest.mark.parametrize("known", [0, 1, 30, 60])
def test_conditioning_is_that_of_a_dense_gp(known):
    rng, K, _ = water(1)
    precision = np.zeros(60)
    precision[:known] = rng.uniform(1.0, 300.0, known)
    np.testing.assert_allclose(conditioned(K, precision), literal(K, precision), atol=1e-10)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 12))
def test_a_change_is_the_difference_of_two_dense_ones(seed, size):
    rng, K, weights = water(seed)
    before = rng.uniform(0.0, 200.0, 60) * (rng.random(60) < 0.5)
    objective = WeightedVariance(conditioned(K, before), weights)
    cells = rng.integers(0, 60, (1, size))  # some more than once
    precisions = rng.uniform(-1.0, 1.0, (1, size))
    precisions = np.where(precisions > 0, 200.0 * precisions, precisions * before[cells] / size)
    after = before + np.bincount(cells[0], precisions[0], 60)
    truth = float(weights @ np.diagonal(literal(K, after) - literal(K, before)))
    assert objective.changes(cells, precisions)[0] == pytest.approx(truth, rel=1e-6, abs=1e-9)


def test_updates_do_not_drift_from_a_fresh_start():
    # A search makes some hundred changes, many of which take readings away again.
    rng, K, weights = water(3)
    precision = np.zeros(60)
    objective = WeightedVariance(K.copy(), weights)
    for _ in range(300):
        cells = np.sort(rng.choice(60, 8, replace=False))
        change = np.where(rng.random(8) < 0.5, rng.uniform(20.0, 200.0, 8), -precision[cells])
        cells, change = cells[change != 0.0], change[change != 0.0]
        objective.add(cells, change)
        precision[cells] += change
    S = literal(K, precision)
    assert objective.value == pytest.approx(float(weights @ np.diagonal(S)), rel=1e-6)
    np.testing.assert_allclose(objective.variances, np.diagonal(S), atol=1e-7)
