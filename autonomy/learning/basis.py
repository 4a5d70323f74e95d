"""Which places carry the field, and the factors of their prior covariance."""

import math

import numpy as np

from autonomy.learning.kernel import Group, Kernel
from autonomy.learning.numbers import FloatArray


def prior_factor(basis: FloatArray, group: Group, jitter: float) -> FloatArray:
    """L (m, m), lower triangular, with L Lᵀ = K_BB + jitter·σ²·I for one group of components.

    In column order. Raises LinAlgError if that is singular.
    """
    K = group.covariance(basis, basis)
    K.ravel()[:: len(basis) + 1] += jitter * group.variance
    return np.asfortranarray(np.linalg.cholesky(K))


def prior_factors(basis: FloatArray, kernel: Kernel, jitter: float) -> tuple[FloatArray, ...]:
    """The factor of each group of components (see `prior_factor`)."""
    return tuple(prior_factor(basis, group, jitter) for group in kernel.groups)


def select_basis(
    points: FloatArray,
    kernel: Kernel,
    capacity: int,
    novelty: float,
    relevance: FloatArray | None = None,
) -> list[int]:
    """Indices of at most `capacity` of `points` (N, d) by pivoted Cholesky, the worst explained first.

    Fine & Scheinberg 2001, on the sum of the groups' covariances: what the chosen leave unexplained of a place is
    summed over the groups, as the filter sums it. Stops when no point has more than novelty·σf² of its variance
    left. `relevance` (groups, N), from 0 to 1: the field of a group at a point counts times this.
    """
    groups, steps = kernel.groups, min(capacity, len(points))
    weights = np.ones((len(groups), len(points))) if relevance is None else relevance
    remaining = np.array([group.variance * weight**2 for group, weight in zip(groups, weights, strict=True)])
    rows = np.zeros((len(groups), steps, len(points)))
    floor = max(novelty, 1e-12) * kernel.signal_variance
    chosen: list[int] = []
    for step in range(steps):
        total = remaining.sum(axis=0)
        pivot = int(total.argmax())
        if total[pivot] <= floor:
            break
        for left, known, group, weight in zip(remaining, rows, groups, weights, strict=True):
            if left[pivot] > 1e-12 * group.variance:
                row = weight[pivot] * weight * group.covariance(points[pivot : pivot + 1], points)[0]
                known[step] = (row - known[:step, pivot] @ known[:step]) / math.sqrt(left[pivot])
                left -= known[step] ** 2
            left[pivot] = 0.0
        chosen.append(pivot)
    return chosen
