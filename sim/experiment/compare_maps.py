"""The map that is made ashore today of what a vessel has read: one dense Gaussian process, fitted to all of it."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from autonomy.geometry import FloatArray
from autonomy.learning.fitting import fit
from autonomy.learning.kernel import Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.prediction import Prediction
from autonomy.learning.spatial import Matern32
from autonomy.learning.structures import Part, Scales, Structure

STILL = Structure("matern32", (Part(Matern32),))
MOVING = Structure("matern32_moving", (Part(Matern32, moves=True),), penalty=3.0)
"""The same, forgotten exponentially; it has to be this many nats better, as with the learner on board."""

MOST_POINTS = 300
"""In a fit: so many readings, drawn at random, tell the hyperparameters; all of them make the map."""

_CHUNK = 1000


@dataclass(frozen=True, eq=False)
class Read:
    """What a vessel has read: `points_m` (n, 2) local metres, `values` (n,), at `times_s` (n,), each of `counts` (n,)
    readings averaged.
    """

    points_m: FloatArray
    values: FloatArray
    times_s: FloatArray
    counts: FloatArray

    @classmethod
    def nothing(cls) -> "Read":
        """Before the first reading."""
        return cls(np.empty((0, 2)), np.empty(0), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.values)


class BatchMap:
    """The exact posterior of `kernel`, given all that was `read` (Rasmussen & Williams 2006, eqs. 2.25-2.26).

    Its prior mean is the generalised-least-squares estimate. Of nothing it is the prior.
    """

    def __init__(self, kernel: Kernel, read: Read) -> None:
        self.kernel = kernel
        self._read = read
        lag_s = None if kernel.is_static else np.abs(np.subtract.outer(read.times_s, read.times_s))
        noisy = kernel.covariance(read.points_m, read.points_m, lag_s)
        noisy[np.diag_indices_from(noisy)] += kernel.noise_variance / read.counts
        self._factor = cho_factor(noisy, lower=True) if len(read) else None
        self.prior_mean = 0.0
        self._alpha = np.zeros(0)
        if self._factor is not None:
            ones = cho_solve(self._factor, np.ones(len(read)))
            # Beyond the readings a long length-scale can put it anywhere.
            lowest, highest = read.values.min(), read.values.max()
            self.prior_mean = float(np.clip(ones @ read.values / ones.sum(), lowest, highest))
            self._alpha = cho_solve(self._factor, read.values - self.prior_mean)

    @classmethod
    def fitted(cls, read: Read, span_m: float, *, may_move: bool, seed: int = 0) -> "BatchMap":
        """Under the Matérn-3/2 kernel that explains best what was read: maximum marginal likelihood.

        With the weak priors of the learner on board, and by its fit: a likelihood alone runs away on one track. If the
        field may move, the kernel also forgets, where that asks for it. With fewer readings than a fit takes it is
        that of the priors' medians.
        """
        if not len(read):
            return cls(STILL.median(Scales(span_m, 1.0)), read)
        chosen = np.sort(np.random.default_rng(seed).permutation(len(read))[:MOST_POINTS])
        readings = Readings.of(
            read.points_m[chosen],
            read.values[chosen],
            1.0 / read.counts[chosen],
            read.times_s[chosen],
            "gls",
        )
        found = fit(readings, STILL, span_m)
        if may_move and readings.elapsed_s > 0.0:
            moving = fit(readings, MOVING, span_m)
            if moving.score - MOVING.penalty > found.score:
                found = moving
        return cls(found.kernel, read)

    def predict(self, points_m: FloatArray, time_s: float) -> Prediction:
        """The field, noise-free, at `points_m` (N, 2) and one instant: mean and variance of shape (N,)."""
        parts = [
            self._part(points_m[start : start + _CHUNK], time_s) for start in range(0, len(points_m), _CHUNK)
        ]
        means, variances = zip(*parts, strict=True)
        return Prediction(np.concatenate(means), np.concatenate(variances))

    def _part(self, points_m: FloatArray, time_s: float) -> tuple[FloatArray, FloatArray]:
        signal = self.kernel.signal_variance
        if self._factor is None:
            return np.full(len(points_m), self.prior_mean), np.full(len(points_m), signal)
        cross = self._covariance(points_m, time_s)
        explained = solve_triangular(self._factor[0], cross.T, lower=True)
        variance = signal - np.einsum("ij,ij->j", explained, explained)
        return self.prior_mean + cross @ self._alpha, np.maximum(variance, 0.0)

    def covariance(self, points_m: FloatArray, time_s: float) -> FloatArray:
        """Posterior covariance of readings at `points_m` (N, 2) at one instant, noise included once: (N, N)."""
        prior = self.kernel.covariance(points_m, points_m)
        if self._factor is not None:
            explained = solve_triangular(self._factor[0], self._covariance(points_m, time_s).T, lower=True)
            prior -= explained.T @ explained
        prior[np.diag_indices_from(prior)] += self.kernel.noise_variance
        return np.asarray(0.5 * (prior + prior.T))

    def _covariance(self, points_m: FloatArray, time_s: float) -> FloatArray:
        times_s = self._read.times_s
        lag_s = None if self.kernel.is_static else np.tile(np.abs(time_s - times_s), (len(points_m), 1))
        return self.kernel.covariance(points_m, self._read.points_m, lag_s)
