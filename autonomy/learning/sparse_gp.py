"""Sparse Online Gaussian Process in whitened form: bounded memory, O(m²) a reading, stable on any track.

The recursions of Csató & Opper (2002) on alpha, C, Q blow up when samples lie a metre apart under
length-scales of hundreds. Here the state is z in f_g(B) = L_g z_{g,0}, z ~ N(μ, S), for each group g of the
kernel's components that move alike, L_g L_gᵀ = K_g,BB + jitter·σ_g²·I, all on one shared basis B: the prior of
z is standard normal, S stays between 0 and I, and every step below is a rank-one downdate or a rotation.

With a_g = L_g⁻¹k_g(B, x) and γ = Σ_g (σ_g² − |a_g|²) a reading y of the field at x obeys, given z,
y ~ N(prior_mean + Σ_g a_gᵀz_{g,0}, γ + σn²). Conditioning z on that is the *reduced* update (ŝ = Ck + ê in the
paper's letters). It equals adding x to the basis, updating, and deleting it again: the FITC family, in which
the stream on a frozen basis is batch FITC (Snelson & Ghahramani 2006; Quiñonero-Candela & Rasmussen 2005).
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular

from autonomy.learning import arithmetic, invariants
from autonomy.learning.field_model import FieldModel, Prediction
from autonomy.learning.kernel import Hyperparameters, Kernel, as_kernel
from autonomy.learning.members import IntArray, Members
from autonomy.learning.numbers import FloatArray, as_points, as_vector
from autonomy.learning.state import WhitenedState

# Updates between looks at the variances of the state, and between looks at all of it (or D, if that is more): O(D³),
# so O(D²) an update; measured 1 ms at D = 300 and 12 ms at 600, once in 600 updates of about 0.9 ms.
_GLANCE_EVERY, _CHECK_EVERY = 8, 256


class Update(Enum):
    """What became of a reading's place: in the basis, there instead of another, or only projected on it."""

    ADDED = "added"
    REPLACED = "replaced"
    PROJECTED = "projected"


@dataclass(frozen=True)
class Residual:
    """By how much a reading differed from what was predicted before it was learnt, and the variance of that."""

    innovation: float
    variance: float


class SparseOnlineGP:
    """Sparse Online Gaussian Process with at most `capacity` basis vectors.

    `novelty` and `jitter` are relative to the signal variance: a reading is novel if the basis leaves more
    than novelty·σf² of its place's variance unexplained. Picklable. Bad input raises ValueError and changes
    nothing.
    """

    def __init__(
        self,
        kernel: Kernel | Hyperparameters,
        capacity: int,
        novelty: float = 1e-3,
        jitter: float = 1e-8,
        prior_mean: float = 0.0,
    ) -> None:
        if not 0 <= novelty < 1:
            raise ValueError(f"novelty is a share of the signal variance in [0, 1), not {novelty!r}")
        if not 0 < jitter <= 1e-2:
            raise ValueError(f"jitter is a share of the signal variance in (0, 0.01], not {jitter!r}")
        if not math.isfinite(prior_mean):
            raise ValueError(f"prior_mean must be finite, not {prior_mean!r}")
        self.kernel = as_kernel(kernel)
        self._capacity = _whole(capacity)
        self.novelty = float(novelty)
        self.jitter = float(jitter)
        self.prior_mean = float(prior_mean)
        self.updates = 0
        self.replacements = 0
        self._signal = self.kernel.signal_variance
        self._members = Members(self.kernel.groups, self.kernel.dimensions)
        self._state = WhitenedState(self.kernel, self.jitter)
        self._residual: tuple[float, float] | None = None
        self._fault: str | None = None
        self._check_at = _CHECK_EVERY

    def __len__(self) -> int:
        return len(self._members)

    @property
    def capacity(self) -> int:
        """How many basis vectors there may be; `resize` changes it."""
        return self._capacity

    @property
    def basis(self) -> FloatArray:
        """Basis vectors (m, d), metres, oldest first."""
        return self._members.points

    @property
    def basis_readings(self) -> FloatArray:
        """The reading (m,) that each basis vector was added with, as it was learnt (not centred)."""
        return self._members.readings

    @property
    def basis_counts(self) -> FloatArray:
        """How many readings (m,) each of `basis_readings` is the mean of: its noise is σn²/count."""
        return self._members.counts

    @property
    def basis_births(self) -> IntArray:
        """The value of `updates` (m,) when each basis vector was added."""
        return self._members.births

    @property
    def residual(self) -> Residual | None:
        """How the last reading that was learnt alone differed from its prediction; None before there is one."""
        return None if self._residual is None else Residual(*self._residual)

    @property
    def alpha(self) -> FloatArray:
        """alpha (m,): the mean of the field is prior_mean + k(x, B) alpha. ValueError unless one-state."""
        factor, mean, _ = self._textbook()
        result: FloatArray = solve_triangular(factor, mean, trans="T", lower=True)
        return result

    @property
    def Q(self) -> FloatArray:
        """(K_BB + jitter·σf²·I)⁻¹ (m, m). ValueError unless one-state."""
        factor, _, _ = self._textbook()
        inverse = solve_triangular(factor, np.eye(len(self)), lower=True)
        result: FloatArray = inverse.T @ inverse
        return result

    @property
    def C(self) -> FloatArray:
        """C (m, m): the covariance of the field is k(x, x') + k(x, B) C k(B, x'). Negative semi-definite.

        ValueError unless one-state.
        """
        factor, _, S = self._textbook()
        inverse = solve_triangular(factor, np.eye(len(self)), lower=True)
        result: FloatArray = inverse.T @ (S - np.eye(len(self))) @ inverse
        return result

    def update(self, x: ArrayLike, y: float, noise_variance: float | None = None) -> Update:
        """Learn the reading `y` at `x` (d,) metres; O(m²).

        `noise_variance` replaces the model's own for this reading (an average of n readings has σn²/n).
        Raises ValueError, with the state untouched, for NaN, infinities and wrong shapes.
        """
        point, value, noise = self._checked(x, y, noise_variance)
        p, gammas, r, s = self._innovation(point, value, noise)
        if self._fault is not None or sum(gammas) <= (self.novelty + self.jitter) * self._signal:
            self._condition(p, r, s)
            return Update.PROJECTED
        state, members, m = self._state, self._members, len(self)
        state.take_spare(gammas, p)
        self._condition(p, r, s)
        birth = (point, value, self.kernel.noise_variance / noise, self.updates)
        if m < self._capacity:
            state.resize(1)
            members.append(*birth)
            return Update.ADDED
        worst = int(state.scores(m + 1).argmin())
        if worst == m:
            state.give_spare_back()
            return Update.PROJECTED
        state.remove(worst)
        members.replace(worst, *birth)
        self.replacements += 1
        return Update.REPLACED

    def project(self, x: ArrayLike, y: float, noise_variance: float | None = None) -> None:
        """Learn a reading by a reduced update, however novel its place is: the basis stays."""
        p, _, r, s = self._innovation(*self._checked(x, y, noise_variance))
        self._condition(p, r, s)

    def delete(self, index: int) -> None:
        """Drop one basis vector; the marginal of the others stays what it is. O(m²), by Givens rotations."""
        if not 0 <= index < len(self):
            raise ValueError(f"there is no basis vector {index}: the basis holds {len(self)}")
        self._state.remove(index)
        self._state.resize(-1)
        self._members.remove(index)

    def resize(self, capacity: int) -> None:
        """Allow more basis vectors, or fewer: then the least important are deleted one by one."""
        self._capacity = _whole(capacity)
        while len(self) > self._capacity:
            self.delete(int(self._state.scores(len(self)).argmin()))

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` seconds of model time pass: what moves is forgotten as its temporal kernel says.

        Exact. Free for what does not move. Raises ValueError for negative or non-finite times.
        """
        self._state.advance(dt_s)

    def absorb(self, points: ArrayLike, values: ArrayLike, noise_variances: ArrayLike) -> None:
        """Condition on many readings of one moment without touching the basis: batch FITC, O(N m²).

        `points` (N, d), `values` (N,), `noise_variances` (N,). Equals the reduced updates in any order.
        """
        points = as_points(points, self.kernel.dimensions)
        residuals = as_vector(values, "values", len(points)) - self.prior_mean
        noise = as_vector(noise_variances, "noise_variances", len(points))
        if (noise <= 0).any():
            raise ValueError("noise_variances must be positive")
        if not len(self) or self._fault is not None:
            return
        try:
            self._state.absorb(self._members, points, residuals, noise)
        except np.linalg.LinAlgError as error:
            self._found(f"the covariance of {len(points)} readings was not positive definite: {error}")
        self.updates += len(points)
        if self.updates >= self._check_at:
            self.check()

    def start_basis(self, points: ArrayLike, readings: ArrayLike, counts: ArrayLike) -> None:
        """Give an empty model its basis: `points` (m, d) with their `readings` (m,), which are not learnt.

        Each of `readings` is the mean of that many of `counts` (m,).
        """
        if len(self):
            raise ValueError(f"the model already has {len(self)} basis vectors")
        points = as_points(points, self.kernel.dimensions)
        readings = as_vector(readings, "readings", len(points))
        counts = as_vector(counts, "counts", len(points))
        if (counts <= 0).any():
            raise ValueError("counts must be positive")
        if len(points) > self._capacity:
            raise ValueError(f"{len(points)} basis vectors exceed the capacity of {self._capacity}")
        self._state.start(points)
        for column in zip(points, readings, counts, strict=True):
            self._members.append(*column, birth=0)

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
        return self._state.model(self._members, self.prior_mean)

    def fault(self) -> str | None:
        """Which invariant of the state broke, if ever one did: then nothing more is learnt, and the model has to be
        made anew.

        Every update looks at what it uses, the innovation and its variance; every eighth at the variances of
        the state; one in a few hundred at all of it, as `check` does.
        """
        return self._fault

    def check(self) -> str | None:
        """Look at the whole state now, O(m³); returns `fault`."""
        self._check_at = self.updates + max(_CHECK_EVERY, self._state.matrix.shape[1])
        self._found(invariants.broken(self._state.matrix))
        return self._fault

    def _checked(
        self, x: ArrayLike, y: float, noise_variance: float | None
    ) -> tuple[FloatArray, float, float]:
        point = np.asarray(x, dtype=np.float64)
        if point.shape != (self.kernel.dimensions,):
            raise ValueError(f"x must have shape ({self.kernel.dimensions},), not {point.shape}")
        if not all(map(math.isfinite, point.tolist())):
            raise ValueError(f"x must be finite, not {point.tolist()}")
        value = float(y)
        if not math.isfinite(value):
            raise ValueError(f"y must be finite, not {y!r}")
        noise = self.kernel.noise_variance if noise_variance is None else float(noise_variance)
        if not (math.isfinite(noise) and noise > 0):
            raise ValueError(f"noise_variance must be positive and finite, not {noise_variance!r}")
        return point, value, noise

    def _innovation(
        self, point: FloatArray, value: float, noise: float
    ) -> tuple[FloatArray, list[float], float, float]:
        """The covariance p of the state with the reading, the γ_g, the innovation r and its variance s."""
        a, gammas = self._state.whiten(self._members, point)
        p = arithmetic.spread(self._state.matrix, a)
        spread = arithmetic.product(a, p)
        r = value - self.prior_mean - float(p[-1])
        s = noise + sum(gammas) + spread
        self.updates += 1
        found = invariants.broken_prediction(r, spread, s, self._signal)
        if found is None and self.updates % _GLANCE_EVERY == 0:
            found = invariants.broken_variances(self._state.diagonal)
        self._found(found)
        self._residual = None if found else (r, s)
        if self.updates >= self._check_at:
            self.check()
        return p, gammas, r, s

    def _found(self, fault: str | None) -> None:
        """The first fault is the one that is told: the others follow from it."""
        if fault is not None and self._fault is None:
            self._fault = fault

    def _condition(self, p: FloatArray, r: float, s: float) -> None:
        if self._fault is None:
            arithmetic.condition(self._state.matrix, p, r, s)

    def _textbook(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """L, μ and S, if there is one of each."""
        if self.kernel.states != 1:
            raise ValueError("alpha, C and Q exist for a kernel with one state only: see model() for others")
        model = self.model()
        return model.factors[0], model.whitened_mean, model.whitened_covariance


def _whole(capacity: int) -> int:
    if int(capacity) != capacity or capacity < 1:
        raise ValueError(f"capacity must be a whole number of basis vectors, at least 1, not {capacity!r}")
    return int(capacity)
