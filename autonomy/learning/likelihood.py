"""How well a kernel explains readings: leave-one-out and marginal likelihood, with analytic gradients.

Gradients are with respect to *logarithms*, in this order: for every component its variance, its length-scales
(one per axis) and, if it moves, its time-scale; last the noise variance. `log_parameters` gives the values so
ordered.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.blas import dsymv, dsyr, dsyr2, dsyrk
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs, dtpttr, dtrttp

from autonomy.learning.kernel import Hyperparameters, Kernel, as_kernel
from autonomy.learning.numbers import FloatArray, as_points, as_vector
from autonomy.learning.pairs import PackedCovariance, Pairs

MINIMUM_POINTS = 20

_LOG_2PI = math.log(2.0 * math.pi)


def loo_log_likelihood(
    x: ArrayLike,
    y: ArrayLike,
    kernel: Kernel | Hyperparameters,
    noise_scale: ArrayLike | None = None,
    times_s: ArrayLike | None = None,
) -> tuple[float, FloatArray]:
    """Leave-one-out log predictive probability of `y` (n,) at `x` (n, d) and `times_s` (n,), and its gradient.

    Sundararajan & Keerthi 2001; Rasmussen & Williams 2006, eqs. 5.10–5.13. The prior mean is zero.
    Reading i has the noise variance σn²·noise_scale[i]; for a mean of n_i readings that scale is 1/n_i.
    Without times all readings are of one moment. Raises ValueError for bad input,
    numpy.linalg.LinAlgError if the covariance is singular to rounding.
    """
    return Readings.of(x, y, noise_scale, times_s).loo(kernel)


def log_marginal_likelihood(
    x: ArrayLike,
    y: ArrayLike,
    kernel: Kernel | Hyperparameters,
    noise_scale: ArrayLike | None = None,
    times_s: ArrayLike | None = None,
) -> tuple[float, FloatArray]:
    """Log marginal likelihood of `y` (n,) at `x` (n, d) and `times_s` (n,), zero prior mean, and its gradient.

    Rasmussen & Williams 2006, eqs. 5.8–5.9. Arguments and errors as for `loo_log_likelihood`.
    """
    return Readings.of(x, y, noise_scale, times_s).marginal(kernel)


def log_parameters(kernel: Kernel) -> FloatArray:
    """The logarithms of all that a gradient is with respect to, in its order."""
    values: list[float] = []
    for component in kernel.components:
        values += (component.variance, *component.space.lengthscales_m)
        if not math.isinf(component.time.timescale_s):
            values.append(component.time.timescale_s)
    logs: FloatArray = np.log([*values, kernel.noise_variance])
    return logs


@dataclass(frozen=True)
class Readings:
    """The readings of one fit; the objectives as functions of the kernel.

    `x` (n, d) metres, `y` (n,) sensor units less `fixed_mean`, `noise_scale` (n,), `times_s` (n,) or None.
    """

    x: FloatArray
    y: FloatArray
    noise_scale: FloatArray
    times_s: FloatArray | None
    unknown_mean: bool
    fixed_mean: float

    @classmethod
    def of(
        cls,
        x: ArrayLike,
        y: ArrayLike,
        noise_scale: ArrayLike | None = None,
        times_s: ArrayLike | None = None,
        mean: Literal["gls"] | float = 0.0,
        dimensions: int = 2,
    ) -> "Readings":
        """Checked readings; `mean` is a number, or "gls" for an unknown one. ValueError for bad input."""
        points = as_points(x, dimensions, "x")
        values = as_vector(y, "y", len(points))
        scale = (
            np.ones(len(points))
            if noise_scale is None
            else as_vector(noise_scale, "noise_scale", len(points))
        )
        if (scale <= 0).any():
            raise ValueError("noise_scale must be positive")
        times = None if times_s is None else as_vector(times_s, "times_s", len(points))
        fixed = 0.0 if mean == "gls" else float(mean)
        if not math.isfinite(fixed):
            raise ValueError(f"mean must be 'gls' or a finite number, not {mean!r}")
        return cls(points, values - fixed, scale, times, mean == "gls", fixed)

    @property
    def n(self) -> int:
        """How many there are."""
        return len(self.y)

    @property
    def elapsed_s(self) -> float:
        """Time between the first and the last; 0 without times."""
        return 0.0 if self.times_s is None or not self.n else float(np.ptp(self.times_s))

    def revisits(self, distance_m: float, lag_s: float) -> int:
        """How many readings have another one nearer than `distance_m` and more than `lag_s` earlier or later."""
        pairs = self._pairs
        if pairs.lags_s is None:
            return 0
        found = (sum(pairs.squares) < distance_m**2) & (pairs.lags_s > lag_s)
        columns, rows = np.triu_indices(self.n)
        return len(np.union1d(columns[found], rows[found]))

    def unfit(self) -> str:
        """Why these readings determine nothing; empty if they may."""
        if self.n < MINIMUM_POINTS:
            return f"{self.n} points are too few for a fit: at least {MINIMUM_POINTS} are needed"
        if np.ptp(self.y) <= 1e-12 * float(np.abs(self.y).max()):
            return "the readings do not vary"
        if not np.ptp(self.x, axis=0).any():
            return "all readings were taken at one place"
        return ""

    @cached_property
    def standardised(self) -> tuple["Readings", float]:
        """The readings in units of their own deviation, less their mean if it is unknown; and that unit.

        Of readings that are not `unfit`.
        """
        centred = self.y - self.y.mean() if self.unknown_mean else self.y
        # In two steps: squares of huge values would overflow.
        largest = float(np.abs(centred).max())
        unit = largest * math.sqrt(float(np.mean((centred / largest) ** 2)))
        return replace(self, y=centred / unit, fixed_mean=0.0), unit

    def thinned(self, maximum: int) -> "Readings":
        """At most `maximum` of them, evenly picked."""
        chosen = np.unique(np.linspace(0, self.n - 1, min(maximum, self.n)).round().astype(np.intp))
        times = None if self.times_s is None else self.times_s[chosen]
        return replace(
            self, x=self.x[chosen], y=self.y[chosen], noise_scale=self.noise_scale[chosen], times_s=times
        )

    def plain_mean(self) -> float:
        """The prior mean when there is no fit."""
        if not self.unknown_mean or not self.n:
            return self.fixed_mean
        return float(np.average(self.y, weights=1.0 / self.noise_scale))

    def prior_mean(self, kernel: Kernel | Hyperparameters) -> float:
        """The generalised-least-squares mean under `kernel`, or the fixed one."""
        if not self.unknown_mean:
            return self.fixed_mean
        factor = self._factor(PackedCovariance(self._pairs, as_kernel(kernel)))
        weights = dpotrs(factor, np.ones(self.n), lower=1)[0]
        # A length-scale beyond the survey can put the mean anywhere; one outside all readings helps nobody.
        return float(np.clip(weights @ self.y / weights.sum(), self.y.min(), self.y.max()))

    def loo(self, kernel: Kernel | Hyperparameters) -> tuple[float, FloatArray]:
        """Leave-one-out log predictive probability and its gradient; an unknown mean is left out with it."""
        prior = PackedCovariance(self._pairs, as_kernel(kernel))
        alpha, P, _ = self._solve(prior)
        precision = np.diagonal(P).copy()
        value = 0.5 * float((np.log(precision) - alpha**2 / precision).sum()) - 0.5 * self.n * _LOG_2PI
        g = 0.5 / precision + 0.5 * (alpha / precision) ** 2
        shifted = dsymv(1.0, P, alpha / precision, lower=1)
        P += np.tril(P, -1).T
        P *= np.sqrt(g)
        M = dsyrk(-1.0, P, lower=1)
        M = dsyr2(0.5, shifted, alpha, a=M, lower=1, overwrite_a=1)
        return value, self._gradient(prior, M)

    def marginal(self, kernel: Kernel | Hyperparameters) -> tuple[float, FloatArray]:
        """Log marginal likelihood (restricted, if the mean is unknown) and its gradient."""
        prior = PackedCovariance(self._pairs, as_kernel(kernel))
        alpha, P, log_determinant = self._solve(prior)
        degrees = self.n - 1 if self.unknown_mean else self.n
        value = -0.5 * float(self.y @ alpha) - 0.5 * log_determinant - 0.5 * degrees * _LOG_2PI
        # The sign turned, so that P need not be copied.
        M = dsyr(-1.0, alpha, a=P, lower=1, overwrite_a=1)
        return value, -0.5 * self._gradient(prior, M)

    @cached_property
    def _pairs(self) -> Pairs:
        return Pairs(self.x, self.times_s)

    def _factor(self, prior: PackedCovariance) -> FloatArray:
        noisy, _ = dtpttr(self.n, prior.packed, uplo="L")
        noisy.ravel(order="K")[:: self.n + 1] += prior.kernel.noise_variance * self.noise_scale
        factor, info = dpotrf(noisy, lower=1, overwrite_a=1)
        if info != 0:
            raise np.linalg.LinAlgError("the covariance of the readings is singular to rounding")
        result: FloatArray = factor
        return result

    def _solve(self, prior: PackedCovariance) -> tuple[FloatArray, FloatArray, float]:
        """α = P y, the lower triangle of P and the log-determinant, where P is the inverse of the noisy covariance.

        An unknown mean is projected out: P = K⁻¹ − K⁻¹1(1ᵀK⁻¹1)⁻¹1ᵀK⁻¹. dP = −P dK P holds just as it does for
        the inverse, so both objectives keep their formulas.
        """
        factor = self._factor(prior)
        log_determinant = 2.0 * float(np.log(np.diagonal(factor)).sum())
        solved = dpotrs(factor, np.column_stack((self.y, np.ones(self.n))), lower=1)[0]
        alpha, weights = solved[:, 0], solved[:, 1]
        P, info = dpotri(factor, lower=1, overwrite_c=1)
        if info != 0:
            raise np.linalg.LinAlgError("the covariance of the readings is singular to rounding")
        P = np.asfortranarray(P)
        if self.unknown_mean:
            total = float(weights.sum())
            alpha = alpha - weights * (float(weights @ self.y) / total)
            P = dsyr(-1.0 / total, weights, a=P, lower=1, overwrite_a=1)
            log_determinant += math.log(total)
        return alpha, P, log_determinant

    def _gradient(self, prior: PackedCovariance, M: FloatArray) -> FloatArray:
        """Σ M∘dK for every log parameter; of M the lower triangle is used."""
        noise = prior.kernel.noise_variance * float(np.diagonal(M) @ self.noise_scale)
        weights, _ = dtrttp(M, uplo="L")
        weights *= 2.0
        weights[self._pairs.diagonal] *= 0.5
        return np.array([*prior.gradient(weights), noise])
