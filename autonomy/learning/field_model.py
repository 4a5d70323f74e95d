"""The frozen posterior over the field: what the planner's worker, the disk and the shore get."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpstrf

from autonomy.learning.kernel import (
    FloatArray,
    Hyperparameters,
    as_points,
    as_vector,
    axis_factor,
    covariance,
)

# Columns of the kernel handled at once: 2 MB stay in the cache, which is worth more than longer GEMMs.
_CHUNK_BYTES = 2_000_000
# Eigen-directions of I − S below this carry nothing: variances change by less than 1e-12 of the signal
# variance each.
_RANK_TOLERANCE = 1e-12


@dataclass(frozen=True)
class Prediction:
    """Mean and variance of the latent field (no noise), in the sensor's units and their square.

    Variances are not clipped: rounding may leave one a millionth of σf² below 0 or above σf².
    """

    mean: FloatArray
    variance: FloatArray


@dataclass(frozen=True, eq=False)
class FieldModel:
    """A posterior in whitened form: f_B = prior_mean + L v, v ~ N(μ, S), L Lᵀ = K_BB + jitter·σf²·I.

    `basis` (m, d) metres, `factor` L (m, m) lower triangular, `whitened_mean` μ (m,), `whitened_covariance`
    S (m, m). Between basis vectors the field follows the prior's conditional p(f | f_B). m = 0 is the prior
    itself.
    """

    hyperparameters: Hyperparameters
    prior_mean: float
    jitter: float
    basis: FloatArray
    factor: FloatArray = field(repr=False)
    whitened_mean: FloatArray = field(repr=False)
    whitened_covariance: FloatArray = field(repr=False)

    def __post_init__(self) -> None:
        m = len(self.basis)
        shapes = {
            "basis": (m, self.hyperparameters.dimensions),
            "factor": (m, m),
            "whitened_mean": (m,),
            "whitened_covariance": (m, m),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise ValueError(f"{name} must have shape {shape}, not {array.shape}")
            array.flags.writeable = False

    @classmethod
    def prior(
        cls, hyperparameters: Hyperparameters, prior_mean: float = 0.0, jitter: float = 1e-8
    ) -> "FieldModel":
        """The belief before any reading."""
        d = hyperparameters.dimensions
        empty = np.zeros((0, 0))
        return cls(hyperparameters, prior_mean, jitter, np.zeros((0, d)), empty, np.zeros(0), empty.copy())

    def __len__(self) -> int:
        return len(self.basis)

    def __getstate__(self) -> dict[str, Any]:
        # What is computed on demand need not travel to the worker.
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__post_init__()

    @cached_property
    def alpha(self) -> FloatArray:
        """L⁻ᵀμ (m,): the mean of the field is prior_mean + k(x, B) alpha."""
        if not len(self):
            return np.zeros(0)
        result: FloatArray = solve_triangular(self.factor, self.whitened_mean, trans="T", lower=True)
        return result

    @cached_property
    def _reduction(self) -> FloatArray:
        """T (r, m) with TᵀT = L⁻ᵀ(I − S)L⁻¹: var f(x) = σf² − |T k(B, x)|².

        One GEMM instead of a triangular solve and a GEMM. Squares of a factor cannot go wrong the way the
        difference L⁻ᵀ(I − S)L⁻¹ itself does, whose entries are as large as 1/jitter.
        """
        m = len(self)
        if m == 0:
            return np.zeros((0, 0))
        gain = np.eye(m) - self.whitened_covariance
        packed, pivots, rank, _ = dpstrf(gain, tol=_RANK_TOLERANCE, lower=1)
        root = np.empty((m, rank))
        root[pivots - 1] = np.tril(packed)[:, :rank]
        reduction = solve_triangular(self.factor, root, trans="T", lower=True).T
        return np.ascontiguousarray(reduction)

    def predict(self, points: ArrayLike) -> Prediction:
        """Mean and variance of the field at `points` (N, d), each (N,). ValueError for bad shapes or NaN."""
        points = as_points(points, self.hyperparameters.dimensions)
        mean = np.full(len(points), self.prior_mean)
        variance = np.full(len(points), self.hyperparameters.signal_variance)
        if len(self):
            for start in range(0, len(points), self._chunk):
                part = slice(start, start + self._chunk)
                k = covariance(self.basis, points[part], self.hyperparameters)
                mean[part] += self.alpha @ k
                variance[part] -= _column_squares(self._reduction @ k)
        return Prediction(mean, variance)

    def predict_grid(self, x_axis: ArrayLike, y_axis: ArrayLike) -> Prediction:
        """Mean and variance on a grid of metres east and north: shape (len(y_axis), len(x_axis)).

        Two axes only. The kernel separates on a grid, so this costs no exponential per cell.
        """
        h = self.hyperparameters
        if h.dimensions != 2:
            raise ValueError(f"predict_grid needs two axes, but the model has {h.dimensions}")
        x_axis, y_axis = as_vector(x_axis, "x_axis"), as_vector(y_axis, "y_axis")
        nx, ny = len(x_axis), len(y_axis)
        mean = np.full((ny, nx), self.prior_mean)
        variance = np.full((ny, nx), h.signal_variance)
        if len(self) and nx and ny:
            east = axis_factor(self.basis[:, 0], x_axis, h.lengthscales_m[0])
            north = h.signal_variance * axis_factor(self.basis[:, 1], y_axis, h.lengthscales_m[1])
            mean += (north * self.alpha[:, None]).T @ east
            rows, columns = max(1, self._chunk // nx), min(nx, self._chunk)
            for top in range(0, ny, rows):
                for left in range(0, nx, columns):
                    block = (slice(top, top + rows), slice(left, left + columns))
                    k = north[:, block[0], None] * east[:, None, block[1]]
                    squares = _column_squares(self._reduction @ k.reshape(len(self), -1))
                    variance[block] -= squares.reshape(k.shape[1:])
        return Prediction(mean, variance)

    def covariance(self, points: ArrayLike) -> FloatArray:
        """Posterior covariance (N, N) of the latent field between `points` (N, d)."""
        points = as_points(points, self.hyperparameters.dimensions)
        prior = covariance(points, points, self.hyperparameters)
        if not len(self):
            return prior
        reduced = self._reduction @ covariance(self.basis, points, self.hyperparameters)
        prior -= reduced.T @ reduced
        return prior

    @property
    def _chunk(self) -> int:
        return max(64, _CHUNK_BYTES // (8 * max(1, len(self))))


def _column_squares(matrix: FloatArray) -> FloatArray:
    squares: FloatArray = np.einsum("ij,ij->j", matrix, matrix)
    return squares
