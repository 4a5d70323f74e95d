"""How well hyperparameters explain readings: leave-one-out and marginal likelihood, with analytic gradients.

Gradients are with respect to *logarithms*, in the order signal variance, length-scales, noise variance;
`timescale_s` takes no part.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dpotrf, dpotri

from autonomy.learning.kernel import FloatArray, Hyperparameters, as_points, as_vector, covariance

MINIMUM_POINTS = 20

_LOG_2PI = math.log(2.0 * math.pi)


def loo_log_likelihood(
    x: ArrayLike, y: ArrayLike, h: Hyperparameters, noise_scale: ArrayLike | None = None
) -> tuple[float, FloatArray]:
    """Leave-one-out log predictive probability of `y` (n,) at `x` (n, d), and its gradient (2 + d,).

    Sundararajan & Keerthi 2001; Rasmussen & Williams 2006, eqs. 5.10–5.13. The prior mean is zero.
    Reading i has the noise variance σn²·noise_scale[i]; for a mean of n_i readings that scale is 1/n_i.
    Raises ValueError for bad input, numpy.linalg.LinAlgError if the covariance is singular to rounding.
    """
    return Readings.of(x, y, h, noise_scale).loo(h)


def log_marginal_likelihood(
    x: ArrayLike, y: ArrayLike, h: Hyperparameters, noise_scale: ArrayLike | None = None
) -> tuple[float, FloatArray]:
    """Log marginal likelihood of `y` (n,) at `x` (n, d), zero prior mean, and its gradient (2 + d,).

    Rasmussen & Williams 2006, eqs. 5.8–5.9. Arguments and errors as for `loo_log_likelihood`.
    """
    return Readings.of(x, y, h, noise_scale).marginal(h)


@dataclass(frozen=True)
class Readings:
    """The readings of one fit; the objectives as functions of the hyperparameters."""

    x: FloatArray
    y: FloatArray
    noise_scale: FloatArray
    unknown_mean: bool
    fixed_mean: float

    @classmethod
    def of(
        cls,
        x: ArrayLike,
        y: ArrayLike,
        h: Hyperparameters,
        noise_scale: ArrayLike | None,
        mean: Literal["gls"] | float = 0.0,
    ) -> "Readings":
        """Checked readings; `mean` is a number, or "gls" for an unknown one. ValueError for bad input."""
        points = as_points(x, h.dimensions, "x")
        values = as_vector(y, "y", len(points))
        scale = (
            np.ones(len(points))
            if noise_scale is None
            else as_vector(noise_scale, "noise_scale", len(points))
        )
        if (scale <= 0).any():
            raise ValueError("noise_scale must be positive")
        fixed = 0.0 if mean == "gls" else float(mean)
        if not math.isfinite(fixed):
            raise ValueError(f"mean must be 'gls' or a finite number, not {mean!r}")
        return cls(points, values - fixed, scale, mean == "gls", fixed)

    @property
    def n(self) -> int:
        """How many there are."""
        return len(self.y)

    def unfit(self) -> str:
        """Why these readings determine nothing; empty if they may."""
        if self.n < MINIMUM_POINTS:
            return f"{self.n} points are too few for a fit: at least {MINIMUM_POINTS} are needed"
        if np.ptp(self.y) <= 1e-12 * float(np.abs(self.y).max()):
            return "the readings do not vary"
        if not np.ptp(self.x, axis=0).any():
            return "all readings were taken at one place"
        return ""

    def plain_mean(self) -> float:
        """The prior mean when there is no fit."""
        if not self.unknown_mean or not self.n:
            return self.fixed_mean
        weights = 1.0 / self.noise_scale
        return float(np.average(self.y, weights=weights))

    def prior_mean(self, h: Hyperparameters) -> float:
        """The generalised-least-squares mean under `h`, or the fixed one."""
        if not self.unknown_mean:
            return self.fixed_mean
        _, inverse, _ = self._inverse(h)
        weights = inverse.sum(axis=0)
        # A length-scale beyond the survey can put the mean anywhere; one outside all readings helps nobody.
        return float(np.clip(weights @ self.y / weights.sum(), self.y.min(), self.y.max()))

    def _inverse(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float]:
        """The noise-free covariance K, (K + noise)⁻¹, and log|K + noise|."""
        K = covariance(self.x, self.x, h)
        noisy = K.copy()
        noisy.ravel()[:: self.n + 1] += h.noise_variance * self.noise_scale
        factor, info = dpotrf(noisy.T, lower=1, overwrite_a=1)
        if info == 0:
            log_determinant = 2.0 * float(np.log(np.diagonal(factor)).sum())
            inverse, info = dpotri(factor, lower=1, overwrite_c=1)
        if info != 0:
            raise np.linalg.LinAlgError("the covariance of the readings is singular to rounding")
        inverse = np.tril(inverse)
        inverse += np.tril(inverse, -1).T
        return K, inverse, log_determinant

    def _precision(self, h: Hyperparameters) -> tuple[FloatArray, FloatArray, float]:
        """As `_inverse`, with an unknown mean projected out: P = K⁻¹ − K⁻¹1(1ᵀK⁻¹1)⁻¹1ᵀK⁻¹.

        dP = −P dK P holds just as it does for the inverse, so both objectives keep their formulas.
        """
        K, P, log_determinant = self._inverse(h)
        if self.unknown_mean:
            weights = P.sum(axis=0)
            P -= np.outer(weights, weights) / weights.sum()
            log_determinant += math.log(weights.sum())
        return K, P, log_determinant

    def loo(self, h: Hyperparameters) -> tuple[float, FloatArray]:
        """Leave-one-out log predictive probability and its gradient; an unknown mean is left out with it."""
        K, P, _ = self._precision(h)
        precision = np.diagonal(P).copy()
        alpha = P @ self.y
        value = 0.5 * float((np.log(precision) - alpha**2 / precision).sum()) - 0.5 * self.n * _LOG_2PI
        g = 0.5 / precision + 0.5 * (alpha / precision) ** 2
        scaled = P * np.sqrt(g)
        M = np.outer(P @ (alpha / precision), alpha) - scaled @ scaled.T
        return value, self._gradient(h, K, M)

    def marginal(self, h: Hyperparameters) -> tuple[float, FloatArray]:
        """Log marginal likelihood (restricted, if the mean is unknown) and its gradient."""
        K, P, log_determinant = self._precision(h)
        alpha = P @ self.y
        degrees = self.n - 1 if self.unknown_mean else self.n
        value = -0.5 * float(self.y @ alpha) - 0.5 * log_determinant - 0.5 * degrees * _LOG_2PI
        return value, self._gradient(h, K, 0.5 * (np.outer(alpha, alpha) - P))

    def _gradient(self, h: Hyperparameters, K: FloatArray, M: FloatArray) -> FloatArray:
        """Σ M∘dK for every log parameter."""
        weighted = M * K
        gradient = [float(weighted.sum())]
        for axis, lengthscale in enumerate(h.lengthscales_m):
            position = self.x[:, axis] / lengthscale
            distance = np.subtract.outer(position, position)
            gradient.append(float(np.einsum("ij,ij,ij->", weighted, distance, distance)))
        gradient.append(h.noise_variance * float(np.diagonal(M) @ self.noise_scale))
        return np.array(gradient)
