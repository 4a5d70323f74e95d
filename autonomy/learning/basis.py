"""Which places carry the field, and the factor of their prior covariance."""

import math

import numpy as np

from autonomy.learning.kernel import FloatArray, Hyperparameters, covariance


def prior_factor(basis: FloatArray, h: Hyperparameters, jitter: float) -> FloatArray:
    """L (m, m), lower triangular, with L Lᵀ = K_BB + jitter·σf²·I. Raises LinAlgError if that is singular."""
    K = covariance(basis, basis, h)
    K.ravel()[:: len(basis) + 1] += jitter * h.signal_variance
    return np.asfortranarray(np.linalg.cholesky(K))


def select_basis(points: FloatArray, h: Hyperparameters, capacity: int, novelty: float) -> list[int]:
    """Indices of at most `capacity` of `points` (N, d) by pivoted Cholesky, the worst explained first.

    Stops when no point has more than novelty·σf² of its variance left.
    """
    remaining = np.full(len(points), h.signal_variance)
    rows = np.zeros((min(capacity, len(points)), len(points)))
    chosen: list[int] = []
    for step in range(len(rows)):
        pivot = int(remaining.argmax())
        if remaining[pivot] <= max(novelty, 1e-12) * h.signal_variance:
            break
        row = covariance(points[pivot : pivot + 1], points, h)[0] - rows[:step, pivot] @ rows[:step]
        rows[step] = row / math.sqrt(remaining[pivot])
        remaining -= rows[step] ** 2
        remaining[pivot] = 0.0
        chosen.append(pivot)
    return chosen
