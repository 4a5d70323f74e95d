"""The fit that finds the parameters of one structure that explain readings best: priors, guards, optimisers.

Slow: for the worker. It works on standardised values and on logarithms; gradient ascent on the raw parameters
fails nearly always.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from autonomy.learning.caution import posterior_variance
from autonomy.learning.kernel import Hyperparameters, Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.numbers import FloatArray, positive, positive_variance
from autonomy.learning.structures import Priors, Scales, Structure

Objective = Literal["loo", "marginal"]
Optimiser = Literal["lbfgs", "gradient_ascent"]
# A step of gradient ascent changes no parameter, which is a logarithm or a logit, by more than this.
_LONGEST_STEP = 1.0
# L-BFGS ends when an iteration gains less than this share of the objective: a ten-thousandth of a nat at the most.
_NEGLIGIBLE_GAIN = 1e-7
# With so few readings a second start costs little; how many times shorter its length-scales are, and by how many
# nats that summit, far from the priors' medians, has to be higher: without, one of 40 short tracks had a length-scale
# 10.3 times off.
_FEW_POINTS = 100
_SHORTER = 5.0
_SECOND_SUMMIT = 2.0
# Of the central differences from which the Hessian is made.
_STEP = 0.02


@dataclass(frozen=True)
class Method:
    """How a fit goes about it. The paper: LOO, gradient ascent with a learning rate (on logarithms), no priors.

    ValueError for names that do not exist and numbers out of range.
    """

    objective: Objective = "marginal"
    optimiser: Optimiser = "lbfgs"
    priors: bool = True
    iterations: int = 100
    learning_rate: float = 0.01

    def __post_init__(self) -> None:
        if self.objective not in ("loo", "marginal"):
            raise ValueError(f"objective must be 'loo' or 'marginal', not {self.objective!r}")
        if self.optimiser not in ("lbfgs", "gradient_ascent"):
            raise ValueError(f"optimiser must be 'lbfgs' or 'gradient_ascent', not {self.optimiser!r}")
        if self.iterations < 1:
            raise ValueError(f"iterations must be at least 1, not {self.iterations!r}")
        positive("learning_rate", self.learning_rate)


@dataclass(frozen=True)
class Fit:
    """What a fit found. If there could be none, `kept_start` is true and `message` says why.

    `log_likelihood` is the objective at `kernel`, in nats; `score` adds the log priors (zero at their medians).
    """

    structure: str
    kernel: Kernel
    prior_mean: float
    log_likelihood: float
    score: float
    iterations: int
    converged: bool
    message: str
    kept_start: bool = False

    @property
    def hyperparameters(self) -> Hyperparameters:
        """The kernel as `Hyperparameters`; ValueError unless it is one squared-exponential component."""
        return self.kernel.hyperparameters


def fit(
    readings: Readings,
    structure: Structure,
    span_m: float,
    start: Kernel | None = None,
    method: Method | None = None,
) -> Fit:
    """The kernel of `structure` that explains `readings` best, from `start` or the priors' medians if better.

    `span_m` is the width of the survey, to which the priors of the length-scales are scaled; the others are scaled to
    the readings. An unknown mean is profiled out of the objective (exactly, so the gradient stays exact) and returned
    as the generalised-least-squares estimate, held within the readings' range. Gradient ascent begins at `start` if
    given and cannot diverge: a step that lowers the objective is taken back and the learning rate halved, and no
    step is longer than one. The result is equivariant under y + c and y·s. Never returns NaN and never raises for
    degenerate readings: see `Fit`. ValueError for a structure that moves and readings without times.
    """
    method = method or Method()
    if structure.moves and readings.times_s is None:
        raise ValueError(f"{structure.name} moves: it needs readings with times")
    reason = readings.unfit()
    if not reason and structure.moves and readings.elapsed_s <= 0:
        reason = "all readings were taken at one time"
    if reason:
        return _kept(readings, structure, span_m, start, reason)
    if start is None and method.priors and readings.n > _FEW_POINTS:
        # The climb from afar is made on a part of the readings, where a step costs a tenth.
        start = fit(readings.thinned(_FEW_POINTS), structure, span_m, None, method).kernel
    standard, unit = readings.standardised
    target = _Target(standard, structure, span_m, method)
    climb = _lbfgs if method.optimiser == "lbfgs" else _gradient_ascent
    climbs = [
        climb(target, theta, method)
        for theta in target.starts(None if start is None else start.scaled(unit**-2, unit**-2))
        if math.isfinite(target(theta)[0])
    ]
    if not climbs:
        return _kept(readings, structure, span_m, start, "the objective is not finite at the start")
    best, count, converged, message = climbs[0]
    if len(climbs) > 1 and target(climbs[1][0])[0] > target(best)[0] + _SECOND_SUMMIT:
        best, count, converged, message = climbs[1]
    kernel = structure.kernel(best)
    # The density of the values in sensor units; a restricted likelihood is one of n − 1 contrasts.
    restricted = readings.unknown_mean and method.objective == "marginal"
    jacobian = (readings.n - restricted) * math.log(unit)
    return Fit(
        structure=structure.name,
        kernel=kernel.scaled(unit**2, unit**2),
        prior_mean=_restored_mean(readings, standard, unit, kernel),
        log_likelihood=target.likelihood(best)[0] - jacobian,
        score=target(best)[0] - jacobian,
        iterations=count,
        converged=converged,
        message=message,
    )


def doubt(readings: Readings, structure: Structure, span_m: float, found: Kernel, method: Method) -> float:
    """How uncertain the readings leave the logarithm of the signal variance: its posterior variance (Laplace).

    `found` is the kernel of a fit to these readings. 0 without priors: there is no posterior then.
    """
    if not method.priors:
        return 0.0
    standard, unit = readings.standardised
    target = _Target(standard, structure, span_m, method)
    theta = structure.parameters(found.scaled(unit**-2, unit**-2), standard.elapsed_s)
    steps = _STEP * np.eye(len(theta))
    precision = np.array([target(theta - step)[1] - target(theta + step)[1] for step in steps]) / (2 * _STEP)
    # The prior of the variance comes from these readings: it adds no knowledge.
    precision[0, 0] -= target.deviations[0] ** -2
    return posterior_variance(precision, 2.0 * float(target.deviations.max()))


def _restored_mean(readings: Readings, standard: Readings, unit: float, kernel: Kernel) -> float:
    if not readings.unknown_mean:
        return readings.fixed_mean
    return float(readings.y.mean()) + unit * standard.prior_mean(kernel)


def _kept(readings: Readings, structure: Structure, span_m: float, start: Kernel | None, reason: str) -> Fit:
    if start is None:
        variance = positive_variance(readings.y) if readings.n else 1.0
        start = structure.median(Scales(span_m, variance, readings.elapsed_s or 1.0))
    mean = readings.plain_mean()
    return Fit(structure.name, start, mean, -math.inf, -math.inf, 0, False, reason, kept_start=True)


class _Target:
    """What the optimiser climbs: objective plus log prior, as a function of a structure's parameters."""

    def __init__(self, problem: Readings, structure: Structure, span_m: float, method: Method) -> None:
        self._objective: Callable[[Kernel], tuple[float, FloatArray]] = (
            problem.loo if method.objective == "loo" else problem.marginal
        )
        self._structure = structure
        self._elapsed_s, self._points = problem.elapsed_s, problem.n
        self._medians = structure.priors(Scales(span_m, 1.0, self._elapsed_s))
        self._priors: Priors | None = self._medians if method.priors else None
        extent = float(np.ptp(problem.x, axis=0).max())
        self.bounds = structure.bounds(Scales(extent, 1.0, self._elapsed_s))

    def starts(self, start: Kernel | None) -> list[FloatArray]:
        """Where to begin: at the start, or the priors' medians if those explain the readings better.

        With priors and few readings also at length-scales much shorter than their medians: the evidence often has a
        second summit, and the lower one takes a rough field for noise.
        """
        median = self._within(self._medians.median)
        first = median if start is None else self._within(self._structure.parameters(start, self._elapsed_s))
        if self._priors is None:
            return [first]
        if self(median)[0] > self(first)[0]:
            first = median
        if self._points > _FEW_POINTS:
            return [first]
        return [first, self._within(self._structure.shortened(self._medians.median, _SHORTER))]

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of the priors."""
        return self._medians.deviation

    def _within(self, theta: FloatArray) -> FloatArray:
        result: FloatArray = np.clip(theta, self.bounds[:, 0], self.bounds[:, 1])
        return result

    def likelihood(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """The objective without the priors."""
        value, gradient = self._objective(self._structure.kernel(theta))
        return value, self._structure.chain(theta, gradient)

    def __call__(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Value and gradient; minus infinity where the covariance is singular."""
        try:
            value, gradient = self.likelihood(theta)
        except np.linalg.LinAlgError:
            return -math.inf, np.zeros_like(theta)
        if self._priors is not None:
            density, slope = self._priors.log_density(theta)
            value, gradient = value + density, gradient + slope
        if not (math.isfinite(value) and np.isfinite(gradient).all()):
            return -math.inf, np.zeros_like(theta)
        return value, gradient


_Climbed = tuple[FloatArray, int, bool, str]


def _lbfgs(target: _Target, theta: FloatArray, method: Method) -> _Climbed:
    best_value, best = -math.inf, theta

    def descend(point: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best_value, best
        value, gradient = target(point)
        if value > best_value:
            best_value, best = value, point.copy()
        # L-BFGS cannot digest infinities: a wall that is higher than anything seen makes its line search
        # step back.
        return (1e100, gradient) if value == -math.inf else (-value, -gradient)

    options = {"maxiter": method.iterations, "ftol": _NEGLIGIBLE_GAIN}
    # Only the worker fits: without it the service starts a tenth of a second sooner.
    from scipy.optimize import minimize

    result = minimize(descend, theta, jac=True, method="L-BFGS-B", bounds=target.bounds, options=options)
    return best, int(result.nit), bool(result.success), str(result.message)


def _gradient_ascent(target: _Target, theta: FloatArray, method: Method) -> _Climbed:
    rate = method.learning_rate
    value, gradient = target(theta)
    for count in range(method.iterations):
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
    return theta, method.iterations, False, "the iterations are used up"
