"""The frozen posterior over the field: what the planner's worker, the disk and the shore get."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpstrf

from autonomy.learning import motion
from autonomy.learning.grids import GridCovariance
from autonomy.learning.kernel import Hyperparameters, Kernel, as_kernel
from autonomy.learning.numbers import FloatArray, as_points, as_vector
from autonomy.learning.prediction import Prediction
from autonomy.learning.transform import Identity, Transform

__all__ = ["FieldModel", "Prediction", "field_coordinates"]

# Entries of the covariance handled at once: 2 MB stay in the cache, which is worth more than longer GEMMs.
_CHUNK_BYTES = 2_000_000
# Columns of a map handled at once: the tables along its edges stay small on any map.
_STRIP = 1024
# Eigen-directions of I − S below this carry nothing: variances change by less than 1e-12 of the signal
# variance each.
_RANK_TOLERANCE = 1e-12


@dataclass(frozen=True, eq=False)
class FieldModel:
    """A posterior in whitened form: f_g(B) = L_g z_{g,0}, z ~ N(μ, S), for each group g of the kernel's components.

    `basis` (m, d) metres; `factors`, one L_g (m, m) for each group, lower triangular, L_g L_gᵀ = K_g,BB +
    jitter·σ_g²·I; `whitened_mean` μ (D,), `whitened_covariance` S (D, D), D = m × the kernel's states: block
    after block of m, group by group, and in a group state by state, of which the first is the field. The
    field is prior_mean + Σ_g f_g; between basis vectors it follows the prior's conditional p(f | f_B). m = 0
    is the prior itself. All this is in the latent units of `transform`, in which the field is Gaussian;
    predictions are also in the sensor's. ValueError for shapes that do not fit.
    """

    kernel: Kernel
    prior_mean: float
    jitter: float
    basis: FloatArray
    factors: tuple[FloatArray, ...] = field(repr=False)
    whitened_mean: FloatArray = field(repr=False)
    whitened_covariance: FloatArray = field(repr=False)
    transform: Transform = field(default_factory=Identity)

    def __post_init__(self) -> None:
        m, size = len(self.basis), len(self.basis) * self.kernel.states
        if len(self.factors) != len(self.kernel.groups):
            raise ValueError(
                f"factors must be {len(self.kernel.groups)}, one for each group, not {len(self.factors)}"
            )
        checked = [
            ("basis", self.basis, (m, self.kernel.dimensions)),
            ("whitened_mean", self.whitened_mean, (size,)),
            ("whitened_covariance", self.whitened_covariance, (size, size)),
            *((f"factors[{g}]", factor, (m, m)) for g, factor in enumerate(self.factors)),
        ]
        for name, array, shape in checked:
            if array.shape != shape:
                raise ValueError(f"{name} must have shape {shape}, not {array.shape}")
            array.flags.writeable = False

    @classmethod
    def prior(
        cls, kernel: Kernel | Hyperparameters, prior_mean: float = 0.0, jitter: float = 1e-8
    ) -> "FieldModel":
        """The belief before any reading."""
        kernel = as_kernel(kernel)
        factors = tuple(np.zeros((0, 0)) for _ in kernel.groups)
        nothing = (np.zeros((0, kernel.dimensions)), factors, np.zeros(0), np.zeros((0, 0)))
        return cls(kernel, prior_mean, jitter, *nothing)

    def __len__(self) -> int:
        return len(self.basis)

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__post_init__()

    def advanced(self, dt_s: float) -> "FieldModel":
        """The belief `dt_s` seconds later, nothing having been read. ValueError for negative or non-finite times."""
        state = np.empty((len(self.whitened_mean) + 1, len(self.whitened_mean)), order="F")
        state[:-1], state[-1] = self.whitened_covariance, self.whitened_mean
        motion.advance(state, self.kernel.groups, dt_s)
        return replace(
            self, whitened_mean=state[-1].copy(), whitened_covariance=np.asfortranarray(state[:-1])
        )

    @cached_property
    def _reduction(self) -> FloatArray:
        """Rows T (r, G·m) above one row w (G·m,), for k the stacked k_g(B, x): var f(x) = σf² − |T k|², mean wᵀk.

        TᵀT = F⁻ᵀ(I − S)F⁻¹ with F the block diagonal of the L_g and S the covariance of the z_{g,0}. One GEMM
        instead of a triangular solve and a GEMM. Squares of a factor cannot go wrong the way the difference
        F⁻ᵀ(I − S)F⁻¹ itself does, whose entries are as large as 1/jitter.
        """
        m, coordinates = len(self), field_coordinates(self.kernel, len(self))
        gain = np.eye(len(coordinates)) - self.whitened_covariance[np.ix_(coordinates, coordinates)]
        if not len(gain):
            return np.zeros((1, 0))
        packed, pivots, rank, _ = dpstrf(gain, tol=_RANK_TOLERANCE, lower=1)
        root = np.empty((len(gain), rank + 1))
        root[pivots - 1, :rank] = np.tril(packed)[:, :rank]
        root[:, rank] = self.whitened_mean[coordinates]
        for g, factor in enumerate(self.factors):
            part = root[g * m : (g + 1) * m]
            part[...] = solve_triangular(factor, part, trans="T", lower=True)
        return np.ascontiguousarray(root.T)

    def predict(self, points: ArrayLike) -> Prediction:
        """Mean and variance of the field at `points` (N, d), each (N,). ValueError for bad shapes or NaN."""
        points = as_points(points, self.kernel.dimensions)
        mean = np.full(len(points), self.prior_mean)
        variance = np.full(len(points), self.kernel.signal_variance)
        if len(self):
            for start in range(0, len(points), self._chunk):
                part = slice(start, start + self._chunk)
                reduced = self._reduction @ self._stacked(points[part])
                mean[part] += reduced[-1]
                variance[part] -= _column_squares(reduced[:-1])
        return Prediction(mean, variance, self.transform)

    def predict_grid(self, x_axis: ArrayLike, y_axis: ArrayLike) -> Prediction:
        """Mean and variance on a grid of metres east and north: shape (len(y_axis), len(x_axis)).

        Two axes only. Kernels that separate cost no exponential per cell.
        """
        x_axis, y_axis = self._axes(x_axis, y_axis)
        mean = np.full((len(y_axis), len(x_axis)), self.prior_mean)
        variance = np.full((len(y_axis), len(x_axis)), self.kernel.signal_variance)
        for columns, parts in self._strips(x_axis):
            for rows, k in self._bands(parts, y_axis, len(x_axis[columns])):
                reduced = self._reduction @ k
                shape = mean[rows, columns].shape
                mean[rows, columns] += reduced[-1].reshape(shape)
                variance[rows, columns] -= _column_squares(reduced[:-1]).reshape(shape)
        return Prediction(mean, variance, self.transform)

    def mean_grid(self, x_axis: ArrayLike, y_axis: ArrayLike) -> FloatArray:
        """The mean alone, as `predict_grid` has it: one small matrix product where the kernel separates.

        Under a transform the mean depends on the variance, and costs as much as both.
        """
        if not isinstance(self.transform, Identity):
            return self.predict_grid(x_axis, y_axis).mean
        x_axis, y_axis = self._axes(x_axis, y_axis)
        mean = np.full((len(y_axis), len(x_axis)), self.prior_mean)
        weights = self._reduction[-1].reshape(len(self.factors), -1)
        for columns, parts in self._strips(x_axis):
            for top in range(0, len(y_axis), _STRIP):
                rows = slice(top, top + _STRIP)
                for part, weight in zip(parts, weights, strict=True):
                    mean[rows, columns] += self._mean(part, weight, y_axis[rows], len(x_axis[columns]))
        return mean

    def known(self, points: FloatArray) -> FloatArray:
        """What the readings have told of the latent field at `points` (N, d): H (r + 1, N), r at most the state's size.

        The prior's covariance less HᵀH, its last row left out, is the posterior's; the last row is its mean less the
        prior's.
        """
        return self._reduction @ self._stacked(points)

    def covariance(self, points: ArrayLike) -> FloatArray:
        """Posterior covariance (N, N) of the latent field between `points` (N, d)."""
        points = as_points(points, self.kernel.dimensions)
        prior = self.kernel.covariance(points, points)
        if not len(self):
            return prior
        known = self.known(points)[:-1]
        prior -= known.T @ known
        return prior

    def _stacked(self, points: FloatArray) -> FloatArray:
        """k_g(B, points), group below group: (G·m, N)."""
        return np.concatenate([group.covariance(self.basis, points) for group in self.kernel.groups])

    def _axes(self, x_axis: ArrayLike, y_axis: ArrayLike) -> tuple[FloatArray, FloatArray]:
        if self.kernel.dimensions != 2:
            raise ValueError(f"a grid needs two axes, but the model has {self.kernel.dimensions}")
        return as_vector(x_axis, "x_axis"), as_vector(y_axis, "y_axis")

    def _strips(self, x_axis: FloatArray) -> Iterator[tuple[slice, list[GridCovariance]]]:
        """The map in strips of columns: which, and the covariance of each group with their cells."""
        for left in range(0, len(x_axis) if len(self) else 0, _STRIP):
            columns = slice(left, left + _STRIP)
            yield columns, [GridCovariance(g, self.basis, x_axis[columns]) for g in self.kernel.groups]

    def _bands(
        self, parts: list[GridCovariance], y_axis: FloatArray, width: int
    ) -> Iterator[tuple[slice, FloatArray]]:
        """A strip in bands of rows: which, and the stacked covariance (G·m, cells), overwritten by the next."""
        m, height = len(self), max(1, self._chunk // width)
        stacked = np.empty((len(parts), m, height * width))
        scratch = np.empty((m, height * width))
        for top in range(0, len(y_axis), height):
            rows = slice(top, min(top + height, len(y_axis)))
            cells = (rows.stop - top) * width
            if cells < stacked.shape[2]:
                stacked, scratch = np.empty((len(parts), m, cells)), np.empty((m, cells))
            for part, out in zip(parts, stacked, strict=True):
                part.fill(out.reshape(m, -1, width), y_axis[rows], scratch.reshape(m, -1, width))
            yield rows, stacked.reshape(len(parts) * m, cells)

    def _mean(self, part: GridCovariance, weights: FloatArray, y_axis: FloatArray, width: int) -> FloatArray:
        """weightsᵀ k_g on a strip's rows."""
        product = part.product(weights, y_axis)
        if product is not None:
            return product
        result = np.empty((len(y_axis), width))
        for rows, k in self._bands([part], y_axis, width):
            result[rows] = (weights @ k).reshape(-1, width)
        return result

    @property
    def _chunk(self) -> int:
        return max(64, _CHUNK_BYTES // (8 * max(1, len(self) * len(self.factors))))


def field_coordinates(kernel: Kernel, m: int) -> NDArray[np.intp]:
    """Where in a state (D,) of `m` basis vectors the field's own coordinates are, (m × groups,): see `FieldModel`."""
    blocks = np.cumsum([0, *(group.time.states for group in kernel.groups[:-1])])
    coordinates: NDArray[np.intp] = (blocks[:, None] * m + np.arange(m)).ravel()
    return coordinates


def _column_squares(matrix: FloatArray) -> FloatArray:
    squares: FloatArray = np.einsum("ij,ij->j", matrix, matrix)
    return squares
