"""What a learner is measured against: the exact GP of any kernel, scikit-learn's GP, and the scores."""

import warnings
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve
from sea_fields import FloatArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from autonomy.learning.kernel import Kernel

TWO_SIDED_95 = 1.959964
_CHUNK = 2000


class ExactGP:
    """The dense GP of `kernel` on all readings (Rasmussen & Williams 2006, eqs. 2.25–2.26), static or moving.

    `counts`: readings averaged in each value (noise σn²/n). `prior_mean` None: generalised least squares.
    """

    def __init__(
        self,
        kernel: Kernel,
        x: FloatArray,
        y: FloatArray,
        times_s: FloatArray | None = None,
        counts: FloatArray | None = None,
        prior_mean: float | None = None,
    ) -> None:
        self.kernel, self._x, self._times_s = kernel, x, times_s
        noise = kernel.noise_variance / (np.ones(len(y)) if counts is None else counts)
        lag_s = None if times_s is None else np.abs(np.subtract.outer(times_s, times_s))
        self._factor = cho_factor(kernel.covariance(x, x, lag_s) + np.diag(noise), lower=True)
        ones = cho_solve(self._factor, np.ones(len(y)))
        self.prior_mean = float(ones @ y / ones.sum()) if prior_mean is None else prior_mean
        self._alpha = cho_solve(self._factor, y - self.prior_mean)

    def predict(self, points: FloatArray, time_s: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Mean and variance of the field (without noise) at `points` (n, d), each (n,)."""
        variances = [
            self.kernel.signal_variance - np.einsum("ij,ji->i", cross, cho_solve(self._factor, cross.T))
            for cross in self._cross(points, time_s)
        ]
        return self.mean(points, time_s), np.concatenate(variances).clip(0.0)

    def mean(self, points: FloatArray, time_s: float = 0.0) -> FloatArray:
        """Mean of the field at `points` (n, d), (n,): a fraction of the price of both."""
        return np.concatenate(
            [self.prior_mean + cross @ self._alpha for cross in self._cross(points, time_s)]
        )

    def _cross(self, points: FloatArray, time_s: float) -> Iterator[FloatArray]:
        """Covariances of points, chunk by chunk, with the readings."""
        for start in range(0, len(points), _CHUNK):
            part = points[start : start + _CHUNK]
            lag_s = None if self._times_s is None else np.tile(np.abs(self._times_s - time_s), (len(part), 1))
            yield self.kernel.covariance(part, self._x, lag_s)


def scikit_learn_mean(x: FloatArray, y: FloatArray, points: FloatArray, restarts: int = 2) -> FloatArray:
    """The baseline: SE-ARD plus white noise, hyperparameters by maximum likelihood, values normalised."""
    span = float(np.ptp(x, axis=0).max())
    kernel = ConstantKernel(1.0, (1e-3, 1e3)) * RBF([0.2, 0.2], (1e-2, 1e2)) + WhiteKernel(1e-2, (1e-6, 1e1))
    gp = GaussianProcessRegressor(
        kernel, alpha=1e-10, n_restarts_optimizer=restarts, normalize_y=True, random_state=0
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a scale at its bound, which is an answer too
        gp.fit(x / span, y)
    return np.concatenate([gp.predict(points[i : i + _CHUNK] / span) for i in range(0, len(points), _CHUNK)])


def rmse(estimate: FloatArray, truth: FloatArray) -> float:
    return float(np.sqrt(np.mean((estimate - truth) ** 2)))


def inside_95(mean: FloatArray, variance: ArrayLike, values: FloatArray) -> float:
    """The share of `values` inside the 95 % interval; `variance` of a reading: the field's plus the noise's."""
    return float(np.mean(np.abs(values - mean) <= TWO_SIDED_95 * np.sqrt(variance)))


def negative_log_density(mean: FloatArray, variance: FloatArray, values: FloatArray) -> float:
    """Mean negative log predictive density of `values`, nats."""
    return float(np.mean(0.5 * np.log(2 * np.pi * variance) + 0.5 * (values - mean) ** 2 / variance))


def geometric_mean(ratios: ArrayLike) -> tuple[float, float]:
    """Geometric mean of `ratios` and the standard error of its logarithm."""
    logs = np.log(np.asarray(ratios, dtype=float))
    return float(np.exp(logs.mean())), float(logs.std(ddof=1) / np.sqrt(len(logs)))
