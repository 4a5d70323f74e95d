"""The weighted variance that is left over the water when readings are taken, and how it changes with a few more.

J = tr(W S), S the posterior covariance of the cells. Counting readings of weight D = diag(n_c/σn²) more on a set of
cells T changes it by −tr(D (I + S_TT D)⁻¹ G_TT), G = S W S (the Woodbury identity); D may be negative: readings that
are not taken after all.
"""

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.blas import dgemm
from scipy.spatial.distance import cdist

from autonomy.geometry import FloatArray
from autonomy.planning.raster import IntArray

__all__ = ["WeightedVariance", "conditioned", "planning_covariance"]

LENGTHSCALE = 0.25
"""Of the planning kernel, as a share of √(water area)."""
NOISE = 0.01
"""Variance of one reading's noise as a share of the signal's, in planning."""


def planning_covariance(points: FloatArray) -> FloatArray:
    """The fixed Matérn-3/2 covariance of cells at `points` (N, 2), in units of √(water area): shape (N, N)."""
    u = np.sqrt(3.0) / LENGTHSCALE * cdist(points, points)
    covariance: FloatArray = (1.0 + u) * np.exp(-u)
    return covariance


def conditioned(K: FloatArray, precision: FloatArray) -> FloatArray:
    """The covariance K (N, N) given readings of precision D = diag(`precision`), (N,) ≥ 0: (K⁻¹ + D)⁻¹."""
    known = np.flatnonzero(precision > 0.0)
    if not len(known):
        return K.copy()
    root = np.sqrt(precision[known])
    gram = np.eye(len(known)) + root[:, None] * K[np.ix_(known, known)] * root
    factor = cholesky(gram, lower=True)
    half = solve_triangular(factor, root[:, None] * K[known], lower=True)
    return np.asarray(K - half.T @ half)


class WeightedVariance:
    """J and its changes, kept up to date by low-rank updates.

    Args:
        S: shape (N, N), the covariance before; taken over, not copied.
        weights: shape (N,), ≥ 0.
    """

    def __init__(self, S: FloatArray, weights: FloatArray) -> None:
        # In Fortran's order BLAS updates in place; both are symmetric.
        self._S = np.asfortranarray(S)
        self._G = np.asfortranarray(self._S @ (weights[:, None] * self._S))
        self.value = float(weights @ np.diagonal(self._S))

    def changes(self, cells: IntArray, precisions: FloatArray) -> FloatArray:
        """ΔJ of each of B sets of readings, shape (B,); nothing is changed.

        Args:
            cells: shape (B, t); a cell may come more than once.
            precisions: shape (B, t), of the readings added to (negative: taken from) each cell, n/σn²; 0 for none.
        """
        rows, columns = cells[:, :, None], cells[:, None, :]
        S, G = self._S[rows, columns], self._G[rows, columns]
        matrix = np.eye(cells.shape[1]) + S * precisions[:, None, :]
        solved = np.linalg.solve(matrix, G)
        return np.asarray(-np.einsum("bii,bi->b", solved, precisions))

    def add(self, cells: IntArray, precisions: FloatArray) -> None:
        """Count readings, shapes (t,): each cell once at most, no precision 0."""
        S, G = self._S, self._G
        S_t, G_t = S[:, cells], G[:, cells]
        inner = np.linalg.solve(np.eye(len(cells)) + precisions[:, None] * S_t[cells], np.diag(precisions))
        inner = 0.5 * (inner + inner.T)
        gain = S_t @ inner
        self.value -= float(np.sum(inner * G_t[cells]))
        bent = G_t - 0.5 * gain @ G_t[cells]
        self._S = dgemm(-1.0, gain, S_t, 1.0, S, trans_b=1, overwrite_c=1)
        self._G = dgemm(
            -1.0, np.hstack([gain, bent]), np.hstack([bent, gain]), 1.0, G, trans_b=1, overwrite_c=1
        )

    @property
    def variances(self) -> FloatArray:
        """Of the cells, shape (N,)."""
        return np.diagonal(self._S).copy()
