"""Sparse Online Gaussian Process in whitened form: bounded memory, O(m²) a reading, stable on any track.

The recursions of Csató & Opper (2002) on alpha, C, Q blow up when samples lie a metre apart under
length-scales of hundreds. Here the state is v in f_B = prior_mean + L v, v ~ N(μ, S), L Lᵀ = K_BB +
jitter·σf²·I: the prior of v is standard normal, S stays between 0 and I, and every step below is a rank-one
downdate or a rotation.

With a = L⁻¹k(B, x) and γ = k(x, x) − aᵀa a reading y of the field at x obeys, given v, y ~ N(prior_mean +
aᵀv, γ + σn²). Conditioning v on that is the *reduced* update (ŝ = Ck + ê in the paper's letters). It equals
adding x to the basis, updating, and deleting it again: the FITC family, in which the stream on a frozen
basis is batch FITC.
"""

import math
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.linalg.blas import dgemv, dger, dtrsv
from scipy.linalg.lapack import dtrtri

from autonomy.learning.basis import prior_factor
from autonomy.learning.field_model import FieldModel, Prediction
from autonomy.learning.kernel import FloatArray, Hyperparameters, as_points, as_vector, covariance
from autonomy.learning.removal import Scratch, remove


class Update(Enum):
    """What became of a reading's place: in the basis, there instead of another, or only projected on it."""

    ADDED = "added"
    REPLACED = "replaced"
    PROJECTED = "projected"


class SparseOnlineGP:
    """Sparse Online Gaussian Process with at most `capacity` basis vectors.

    `novelty` and `jitter` are relative to the signal variance: a reading is novel if the basis leaves more
    than novelty·σf² of its place's variance unexplained. Picklable. Bad input raises ValueError and changes
    nothing.
    """

    def __init__(
        self,
        hyperparameters: Hyperparameters,
        capacity: int,
        novelty: float = 1e-3,
        jitter: float = 1e-8,
        prior_mean: float = 0.0,
    ) -> None:
        if int(capacity) != capacity or capacity < 1:
            raise ValueError(
                f"capacity must be a whole number of basis vectors, at least 1, not {capacity!r}"
            )
        if not 0 <= novelty < 1:
            raise ValueError(f"novelty is a share of the signal variance in [0, 1), not {novelty!r}")
        if not 0 < jitter <= 1e-2:
            raise ValueError(f"jitter is a share of the signal variance in (0, 0.01], not {jitter!r}")
        if not math.isfinite(prior_mean):
            raise ValueError(f"prior_mean must be finite, not {prior_mean!r}")
        self.hyperparameters = hyperparameters
        self.capacity = int(capacity)
        self.novelty = float(novelty)
        self.jitter = float(jitter)
        self.prior_mean = float(prior_mean)
        self.updates = 0
        self.replacements = 0
        self._inverse_scales = 1.0 / np.array(hyperparameters.lengthscales_m)[:, None]
        self._set_basis(
            np.zeros((0, hyperparameters.dimensions)), np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64)
        )
        self._L = np.zeros((0, 0), order="F")
        self._mu = np.zeros(0)
        self._S = np.zeros((0, 0), order="F")
        self._q_diagonal = np.zeros(0)
        self._scratch = Scratch()

    def __len__(self) -> int:
        return len(self._basis)

    @property
    def basis(self) -> FloatArray:
        """Basis vectors (m, d), metres, oldest first."""
        return self._basis.copy()

    @property
    def basis_readings(self) -> FloatArray:
        """The reading (m,) that each basis vector was added with, in sensor units (not centred)."""
        return self._readings.copy()

    @property
    def basis_counts(self) -> FloatArray:
        """How many readings (m,) each of `basis_readings` is the mean of: its noise is σn²/count."""
        return self._counts.copy()

    @property
    def basis_births(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """The value of `updates` (m,) when each basis vector was added."""
        return self._births.copy()

    @property
    def alpha(self) -> FloatArray:
        """alpha (m,): the mean of the field is prior_mean + k(x, B) alpha."""
        return self._back(self._mu)

    @property
    def Q(self) -> FloatArray:
        """(K_BB + jitter·σf²·I)⁻¹ (m, m)."""
        inverse = self._inverse_factor()
        result: FloatArray = inverse.T @ inverse
        return result

    @property
    def C(self) -> FloatArray:
        """C (m, m): the covariance of the field is k(x, x') + k(x, B) C k(B, x'). Negative semi-definite."""
        inverse = self._inverse_factor()
        result: FloatArray = inverse.T @ (self._S - np.eye(len(self))) @ inverse
        return result

    def update(self, x: ArrayLike, y: float, noise_variance: float | None = None) -> Update:
        """Learn the reading `y` at `x` (d,) metres; O(m²).

        `noise_variance` replaces the model's own for this reading (an average of n readings has σn²/n).
        Raises ValueError, with the state untouched, for NaN, infinities and wrong shapes.
        """
        point, value, noise = self._checked(x, y, noise_variance)
        a, p, r, s, gamma = self._innovation(point, value, noise)
        signal = self.hyperparameters.signal_variance
        self.updates += 1
        if gamma <= (self.novelty + self.jitter) * signal:
            self._condition(p, r, s)
            return Update.PROJECTED
        e = self._back(a)
        if len(self) < self.capacity:
            self._append(point, value, noise, a, e, gamma)
            self._condition(np.append(p, math.sqrt(gamma)), r, s)
            return Update.ADDED
        worst = self._least_important(p, e, gamma, r / s)
        if worst is None:
            self._condition(p, r, s)
            return Update.PROJECTED
        L, state = self._grown(a, p, gamma, r, s)
        self._join(point, value, noise, e, gamma)
        self._leave(worst, L, state)
        self.replacements += 1
        if self.replacements % self.capacity == 0:
            # Against the slow drift of a running difference; once in m replacements this is still O(m²)
            # each.
            self._q_diagonal = np.square(self._inverse_factor()).sum(axis=0)
        return Update.REPLACED

    def project(self, x: ArrayLike, y: float, noise_variance: float | None = None) -> None:
        """Learn a reading by a reduced update, however novel its place is: the basis stays."""
        _, p, r, s, _ = self._innovation(*self._checked(x, y, noise_variance))
        self.updates += 1
        self._condition(p, r, s)

    def delete(self, index: int) -> None:
        """Drop one basis vector; the marginal of the others stays what it is. O(m²), by Givens rotations."""
        m = len(self)
        if not 0 <= index < m:
            raise ValueError(f"there is no basis vector {index}: the basis holds {m}")
        L, state = self._scratch.matrix("L", m, m), self._scratch.matrix("state", m + 1, m)
        L[...] = self._L
        state[:m] = self._S
        state[m] = self._mu
        self._leave(index, L, state)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds of model time pass: the field forgets, exp(−dt/τ) of it remains.

        Exact for the kernel k(x, x')·exp(−|t − t'|/τ). Raises ValueError for negative or non-finite times.
        """
        if not (math.isfinite(dt_s) and dt_s >= 0):
            raise ValueError(f"dt_s must be finite and not negative, not {dt_s!r}")
        if dt_s == 0 or self.hyperparameters.timescale_s == math.inf or not len(self):
            return
        kept = math.exp(-dt_s / self.hyperparameters.timescale_s)
        self._mu *= kept
        self._S *= kept * kept
        self._S.ravel(order="K")[:: len(self) + 1] += 1.0 - kept * kept

    def absorb(self, points: ArrayLike, values: ArrayLike, noise_variances: ArrayLike) -> None:
        """Condition on many readings at once without touching the basis: batch FITC, O(N m²).

        `points` (N, d), `values` (N,), `noise_variances` (N,). Equals the reduced updates in any order.
        """
        points = as_points(points, self.hyperparameters.dimensions)
        residual = as_vector(values, "values", len(points)) - self.prior_mean
        noise = as_vector(noise_variances, "noise_variances", len(points))
        if (noise <= 0).any():
            raise ValueError("noise_variances must be positive")
        if not len(self) or not len(points):
            return
        signal = self.hyperparameters.signal_variance
        A = solve_triangular(self._L, covariance(self._basis, points, self.hyperparameters), lower=True)
        gamma = np.maximum(signal - np.einsum("ij,ij->j", A, A), 0.0) + self.jitter * signal
        scaled = A / np.sqrt(noise + gamma)
        residual = (residual - self._mu @ A) / np.sqrt(noise + gamma)
        # S⁻¹ + AAᵀ through a root of S: S may be singular to rounding, I + Rᵀ AAᵀ R never is.
        root = _root(self._S)
        seen = root.T @ scaled
        information = np.eye(len(self)) + seen @ seen.T
        factor = np.linalg.cholesky(information)
        posterior_root = solve_triangular(factor, root.T, lower=True)
        self._S = np.asfortranarray(posterior_root.T @ posterior_root)
        self._mu = self._mu + self._S @ (scaled @ residual)
        self.updates += len(points)

    def start_basis(self, points: ArrayLike, readings: ArrayLike, counts: ArrayLike) -> None:
        """Give an empty model its basis: `points` (m, d) with their `readings` (m,), which are not learnt.

        Each of `readings` is the mean of that many of `counts` (m,).
        """
        if len(self):
            raise ValueError(f"the model already has {len(self)} basis vectors")
        points = as_points(points, self.hyperparameters.dimensions)
        readings = as_vector(readings, "readings", len(points))
        counts = as_vector(counts, "counts", len(points))
        if (counts <= 0).any():
            raise ValueError("counts must be positive")
        m = len(points)
        if m > self.capacity:
            raise ValueError(f"{m} basis vectors exceed the capacity of {self.capacity}")
        if m == 0:
            return
        self._L = prior_factor(points, self.hyperparameters, self.jitter)
        self._set_basis(points.copy(), readings.copy(), counts.copy(), np.zeros(m, dtype=np.int64))
        self._mu = np.zeros(m)
        self._S = np.asfortranarray(np.eye(m))
        self._q_diagonal = np.square(self._inverse_factor()).sum(axis=0)

    def predict(self, points: ArrayLike) -> Prediction:
        """Mean and variance (N,) of the latent field at `points` (N, d)."""
        return self.model().predict(points)

    def predict_grid(self, x_axis: ArrayLike, y_axis: ArrayLike) -> Prediction:
        """Mean and variance of the latent field on a grid: (len(y_axis), len(x_axis)), x east, y north."""
        return self.model().predict_grid(x_axis, y_axis)

    def covariance(self, points: ArrayLike) -> FloatArray:
        """Posterior covariance (N, N) of the latent field between `points` (N, d)."""
        return self.model().covariance(points)

    def model(self) -> FieldModel:
        """A frozen copy of the posterior."""
        return FieldModel(
            self.hyperparameters,
            self.prior_mean,
            self.jitter,
            self._basis.copy(),
            self._L.copy(order="F"),
            self._mu.copy(),
            self._S.copy(order="F"),
        )

    def _checked(
        self, x: ArrayLike, y: float, noise_variance: float | None
    ) -> tuple[FloatArray, float, float]:
        point = np.asarray(x, dtype=np.float64) if not isinstance(x, np.ndarray) else x.astype(np.float64)
        if point.shape != (self.hyperparameters.dimensions,):
            raise ValueError(f"x must have shape ({self.hyperparameters.dimensions},), not {point.shape}")
        if not all(map(math.isfinite, point.tolist())):
            raise ValueError(f"x must be finite, not {point.tolist()}")
        value = float(y)
        if not math.isfinite(value):
            raise ValueError(f"y must be finite, not {y!r}")
        noise = self.hyperparameters.noise_variance if noise_variance is None else float(noise_variance)
        if not (math.isfinite(noise) and noise > 0):
            raise ValueError(f"noise_variance must be positive and finite, not {noise_variance!r}")
        return point, value, noise

    def _innovation(
        self, point: FloatArray, value: float, noise: float
    ) -> tuple[FloatArray, FloatArray, float, float, float]:
        """a = L⁻¹k(B, x); p = S a; the innovation r, its variance s; γ, what the basis leaves unexplained."""
        signal = self.hyperparameters.signal_variance
        a = self._whiten(point)
        # The jitter is part of a basis vector's prior variance: with it here too, a reduced update is
        # exactly what adding and deleting would have been.
        gamma = max(signal - float(a @ a), 0.0) + self.jitter * signal
        p = self._spread(a)
        r = value - self.prior_mean - float(a @ self._mu)
        return a, p, r, noise + gamma + float(a @ p), gamma

    def _set_basis(
        self,
        basis: FloatArray,
        readings: FloatArray,
        counts: FloatArray,
        births: np.ndarray[tuple[int], np.dtype[np.int64]],
    ) -> None:
        self._basis, self._readings, self._counts, self._births = basis, readings, counts, births
        self._scaled = np.ascontiguousarray(basis.T) * self._inverse_scales

    def _whiten(self, point: FloatArray) -> FloatArray:
        """a = L⁻¹k(B, x)."""
        if not len(self):
            return np.zeros(0)
        difference = self._scaled - point[:, None] * self._inverse_scales
        k = np.exp(-0.5 * np.einsum("ij,ij->j", difference, difference))
        k *= self.hyperparameters.signal_variance
        a: FloatArray = dtrsv(self._L, k, lower=1, overwrite_x=1)
        return a

    def _spread(self, a: FloatArray) -> FloatArray:
        """S a."""
        if not len(self):
            return np.zeros(0)
        p: FloatArray = dgemv(1.0, self._S, a)
        return p

    def _back(self, a: FloatArray) -> FloatArray:
        """L⁻ᵀa."""
        if not len(self):
            return np.zeros(0)
        e: FloatArray = dtrsv(self._L, a, lower=1, trans=1)
        return e

    def _inverse_factor(self) -> FloatArray:
        """L⁻¹."""
        if not len(self):
            return np.zeros((0, 0))
        inverse, _ = dtrtri(self._L, lower=1)
        result: FloatArray = np.tril(inverse)
        return result

    def _condition(self, p: FloatArray, r: float, s: float) -> None:
        """Condition v on a reading with innovation r of variance s; p is the covariance of v with it."""
        self._mu += p * (r / s)
        w = p * (1.0 / math.sqrt(s))
        # The same vector twice keeps S symmetric to the last bit.
        self._S = dger(-1.0, w, w, a=self._S, overwrite_x=0, overwrite_y=0, overwrite_a=1)

    def _append(
        self, point: FloatArray, value: float, noise: float, a: FloatArray, e: FloatArray, gamma: float
    ) -> None:
        """Extend the basis by `point`: v gets one more coordinate, a priori independent of the others."""
        m = len(self)
        L = np.zeros((m + 1, m + 1), order="F")
        L[:m, :m] = self._L
        L[m, :m] = a
        L[m, m] = math.sqrt(gamma)
        S = np.zeros((m + 1, m + 1), order="F")
        S[:m, :m] = self._S
        S[m, m] = 1.0
        self._L, self._S, self._mu = L, S, np.append(self._mu, 0.0)
        self._join(point, value, noise, e, gamma)

    def _grown(
        self, a: FloatArray, p: FloatArray, gamma: float, r: float, s: float
    ) -> tuple[FloatArray, FloatArray]:
        """What `_append` and `_condition` would make of L, and of S with μ below it, in scratch memory."""
        m = len(self)
        L, state = self._scratch.matrix("L", m + 1, m + 1), self._scratch.matrix("state", m + 2, m + 1)
        L[:m, :m] = self._L
        L[m, :m] = a
        L[:m, m] = 0.0
        L[m, m] = math.sqrt(gamma)
        state[:m, :m] = self._S
        state[m, :m] = state[:m, m] = 0.0
        state[m, m] = 1.0
        state[m + 1, :m] = self._mu
        state[m + 1, m] = 0.0
        w = np.append(p, L[m, m]) * (1.0 / math.sqrt(s))
        below = np.append(w, -r / math.sqrt(s))
        return L, dger(-1.0, below, w, a=state, overwrite_x=0, overwrite_y=0, overwrite_a=1)

    def _join(self, point: FloatArray, value: float, noise: float, e: FloatArray, gamma: float) -> None:
        """Put `point` last in the list of basis vectors and in diag Q."""
        self._q_diagonal = np.append(self._q_diagonal + e * e / gamma, 1.0 / gamma)
        self._set_basis(
            np.vstack([self._basis, point]),
            np.append(self._readings, value),
            np.append(self._counts, self.hyperparameters.noise_variance / noise),
            np.append(self._births, self.updates),
        )

    def _leave(self, index: int, L: FloatArray, state: FloatArray) -> None:
        """Take basis vector `index` out of the list, diag Q, and L and `state` (S, μ below it), used up."""
        m = len(self)
        unit = np.zeros(m)
        unit[index] = 1.0
        column: FloatArray = dtrsv(L, dtrsv(L, unit, lower=1, overwrite_x=1), lower=1, trans=1)
        keep = np.arange(m) != index
        floor = 1.0 / (self.hyperparameters.signal_variance * (1.0 + self.jitter))
        self._q_diagonal = np.maximum(self._q_diagonal - column**2 / column[index], floor)[keep]
        self._set_basis(self._basis[keep], self._readings[keep], self._counts[keep], self._births[keep])
        if len(self._L) != m - 1:
            self._L, self._S = np.empty((m - 1, m - 1), order="F"), np.empty((m - 1, m - 1), order="F")
        self._mu = remove(L, state, index, self._scratch, self._L, self._S) if m > 1 else np.zeros(0)

    def _least_important(self, p: FloatArray, e: FloatArray, gamma: float, q: float) -> int | None:
        """The basis vector with the lowest score |alpha_i|/Q_ii after learning; None if the new one has it.

        The score is the change of the mean at x_i when i is deleted (Csató & Opper 2002).
        """
        alpha = self._back(self._mu + p * q) - e * q
        scores = np.abs(alpha) / (self._q_diagonal + e * e / gamma)
        worst = int(scores.argmin())
        return None if abs(q) * gamma <= scores[worst] else worst


def _root(S: FloatArray) -> FloatArray:
    """R (m, m) with R Rᵀ = S, for S positive semi-definite up to rounding."""
    values, vectors = np.linalg.eigh(S)
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root
