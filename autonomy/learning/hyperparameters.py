"""The fit that finds good hyperparameters: priors, guards, optimisers. Slow: for the worker.

It works on the logarithms of signal variance, length-scales and noise variance, in this order; gradient
ascent on the raw parameters fails nearly always. `timescale_s` takes no part.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize

from autonomy.learning.kernel import FloatArray, Hyperparameters
from autonomy.learning.likelihood import Readings, log_marginal_likelihood, loo_log_likelihood

__all__ = ["Fit", "Priors", "fit", "log_marginal_likelihood", "loo_log_likelihood"]

Objective = Literal["loo", "marginal"]
Optimiser = Literal["lbfgs", "gradient_ascent"]
# A step of gradient ascent changes no parameter by more than this factor's logarithm.
_LONGEST_STEP = 1.0


@dataclass(frozen=True)
class Priors:
    """Independent log-normal priors: medians, and standard deviations of the logarithms. Weak, and enough."""

    signal_variance: float
    lengthscale_m: float
    noise_variance: float
    signal_deviation: float = 1.0
    lengthscale_deviation: float = 0.7
    noise_deviation: float = 1.5

    @classmethod
    def scaled(cls, span_m: float, variance: float) -> "Priors":
        """Priors for a survey `span_m` across whose readings have this `variance`."""
        if not (math.isfinite(span_m) and span_m > 0):
            raise ValueError(f"span_m must be positive and finite, not {span_m!r}")
        if not (math.isfinite(variance) and variance > 0):
            raise ValueError(f"variance must be positive and finite, not {variance!r}")
        return cls(variance, span_m / 6.0, 0.01 * variance)

    def medians(self, dimensions: int, timescale_s: float = math.inf) -> Hyperparameters:
        """The hyperparameters to begin with."""
        scales = (self.lengthscale_m,) * dimensions
        return Hyperparameters(self.signal_variance, self.noise_variance, scales, timescale_s)

    def log_density(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log density (up to a constant) at `theta` = logs of (σf², l…, σn²), and its gradient."""
        scales = len(theta) - 2
        median = [self.signal_variance, *[self.lengthscale_m] * scales, self.noise_variance]
        sd = np.array([self.signal_deviation, *[self.lengthscale_deviation] * scales, self.noise_deviation])
        z = (theta - np.log(median)) / sd
        return -0.5 * float(z @ z), -z / sd


@dataclass(frozen=True)
class Fit:
    """What a fit found. If there could be none, `kept_start` is true and `message` says why."""

    hyperparameters: Hyperparameters
    prior_mean: float
    log_likelihood: float
    iterations: int
    converged: bool
    message: str
    kept_start: bool = False


def fit(
    x: ArrayLike,
    y: ArrayLike,
    start: Hyperparameters,
    objective: Objective = "loo",
    priors: Priors | None = None,
    optimiser: Optimiser = "lbfgs",
    learning_rate: float = 0.01,
    iterations: int = 100,
    isotropic: bool = False,
    noise_scale: ArrayLike | None = None,
    mean: Literal["gls"] | float = "gls",
) -> Fit:
    """Hyperparameters that explain `y` (n,) at `x` (n, d), from `start` (or the priors' medians if better).

    `mean="gls"` treats the prior mean as unknown: it is profiled out of the objective (exactly, so the
    gradient stays exact) and returned as the generalised-least-squares estimate, held within the readings'
    range; a number fixes it. `isotropic` ties the length-scales. `gradient_ascent` works on logarithms; a
    step that lowers the objective is taken back and the learning rate halved, and no step is longer than
    one, so it cannot diverge. Parameters stay within bounds scaled to the readings' variance and extent.
    Never returns NaN and never raises for degenerate readings: see `Fit`. ValueError for bad input.
    """
    if objective not in ("loo", "marginal"):
        raise ValueError(f"objective must be 'loo' or 'marginal', not {objective!r}")
    if optimiser not in ("lbfgs", "gradient_ascent"):
        raise ValueError(f"optimiser must be 'lbfgs' or 'gradient_ascent', not {optimiser!r}")
    problem = Readings.of(x, y, noise_scale, None, mean, start.dimensions)
    reason = problem.unfit()
    if reason:
        return Fit(start, problem.plain_mean(), -math.inf, 0, False, reason, kept_start=True)
    target = _Target(problem, objective, priors, isotropic)
    theta = target.begin(start)
    if not math.isfinite(target(theta)[0]):
        reason = "the objective is not finite at the start"
        return Fit(start, problem.plain_mean(), -math.inf, 0, False, reason, kept_start=True)
    if optimiser == "lbfgs":
        best, count, converged, message = _lbfgs(target, theta, iterations)
    else:
        best, count, converged, message = _gradient_ascent(target, theta, learning_rate, iterations)
    found = replace(target.unpack(best), timescale_s=start.timescale_s)
    return Fit(found, problem.prior_mean(found), target.likelihood(best)[0], count, converged, message)


class _Target:
    """What the optimiser climbs: objective plus log prior, as a function of the (tied) log parameters."""

    def __init__(
        self, problem: Readings, objective: Objective, priors: Priors | None, isotropic: bool
    ) -> None:
        self._dimensions = problem.x.shape[1]
        self._tie = isotropic and self._dimensions > 1
        self._objective: Callable[[Hyperparameters], tuple[float, FloatArray]] = (
            problem.loo if objective == "loo" else problem.marginal
        )
        self._priors = priors
        self.bounds = self._bounds(problem)

    def _bounds(self, problem: Readings) -> FloatArray:
        """Where a parameter still means something; the noise floor keeps the covariance well conditioned."""
        variance = float(problem.y.var()) if problem.unknown_mean else float(np.mean(problem.y**2))
        span = float(np.ptp(problem.x, axis=0).max())
        scales = 1 if self._tie else self._dimensions
        rows = [(1e-3 * variance, 1e3 * variance), *[(1e-3 * span, 1e2 * span)] * scales]
        rows.append((1e-6 * variance, 1e1 * variance))
        bounds: FloatArray = np.log(np.array(rows))
        return bounds

    def begin(self, start: Hyperparameters) -> FloatArray:
        """The start, or the priors' medians if those explain the readings better."""
        first = self.pack(start)
        if self._priors is None:
            return first
        second = self.pack(self._priors.medians(self._dimensions))
        return first if self(first)[0] >= self(second)[0] else second

    def pack(self, h: Hyperparameters) -> FloatArray:
        scales = np.log(h.lengthscales_m)
        if self._tie:
            scales = scales.mean(keepdims=True)
        theta = np.concatenate([[math.log(h.signal_variance)], scales, [math.log(h.noise_variance)]])
        packed: FloatArray = np.clip(theta, self.bounds[:, 0], self.bounds[:, 1])
        return packed

    def unpack(self, theta: FloatArray) -> Hyperparameters:
        values = np.exp(theta).tolist()
        scales = values[1:-1] * (self._dimensions if self._tie else 1)
        return Hyperparameters(values[0], values[-1], tuple(scales))

    def likelihood(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """The objective without the priors."""
        value, gradient = self._objective(self.unpack(theta))
        if self._tie:
            gradient = np.array([gradient[0], gradient[1:-1].sum(), gradient[-1]])
        return value, gradient

    def __call__(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Value and gradient; minus infinity where the covariance is singular."""
        try:
            value, gradient = self.likelihood(theta)
        except np.linalg.LinAlgError:
            return -math.inf, np.zeros_like(theta)
        if self._priors is not None:
            tied = self._priors.log_density(theta)
            value, gradient = value + tied[0], gradient + tied[1]
        if not (math.isfinite(value) and np.isfinite(gradient).all()):
            return -math.inf, np.zeros_like(theta)
        return value, gradient


def _lbfgs(target: _Target, theta: FloatArray, iterations: int) -> tuple[FloatArray, int, bool, str]:
    best_value, best = -math.inf, theta

    def descend(point: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best_value, best
        value, gradient = target(point)
        if value > best_value:
            best_value, best = value, point.copy()
        # L-BFGS cannot digest infinities: a wall that is higher than anything seen makes its line search
        # step back.
        return (1e100, gradient) if value == -math.inf else (-value, -gradient)

    result = minimize(
        descend, theta, jac=True, method="L-BFGS-B", bounds=target.bounds, options={"maxiter": iterations}
    )
    return best, int(result.nit), bool(result.success), str(result.message)


def _gradient_ascent(
    target: _Target, theta: FloatArray, learning_rate: float, iterations: int
) -> tuple[FloatArray, int, bool, str]:
    if not (math.isfinite(learning_rate) and learning_rate > 0):
        raise ValueError(f"learning_rate must be positive and finite, not {learning_rate!r}")
    rate = learning_rate
    value, gradient = target(theta)
    for count in range(iterations):
        step = rate * gradient
        step *= min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), 1e-300))
        trial = np.clip(theta + step, target.bounds[:, 0], target.bounds[:, 1])
        if float(np.abs(trial - theta).max()) < 1e-6:
            return theta, count, True, "the steps have become negligible"
        trial_value, trial_gradient = target(trial)
        if trial_value >= value:
            theta, value, gradient = trial, trial_value, trial_gradient
        else:
            rate *= 0.5
    return theta, iterations, False, "the iterations are used up"
