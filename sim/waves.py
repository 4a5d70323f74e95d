"""Patterns that swing: what made-up seas are driven by. Known at any time, the same for the same generator."""

import math
from dataclasses import dataclass

import numpy as np

from sim.field_grid import FloatArray


@dataclass(frozen=True)
class Swings:
    """Σ_j patterns_j · (mean_j + swing_j · cos(rate_j · t + phase_j)): patterns (n, rows, columns), the others (n,)."""

    patterns: FloatArray
    mean: FloatArray
    swing: FloatArray
    rate_per_s: FloatArray
    phase: FloatArray

    def weights(self, time_s: float) -> FloatArray:
        """The patterns' shares at an instant, shape (n,)."""
        return np.asarray(self.mean + self.swing * np.cos(self.rate_per_s * time_s + self.phase))

    def at(self, time_s: float) -> FloatArray:
        """The sum at an instant, shape (rows, columns)."""
        return np.asarray(np.tensordot(self.weights(time_s), self.patterns, axes=1))


@dataclass(frozen=True)
class Swarm:
    """Bumps and hollows that come and go: standard deviation, size in metres, shortest and longest period in seconds.

    They are made of `waves` plane waves in all directions, close to a Gaussian process with the
    squared-exponential kernel of length `size_m`.
    """

    deviation: float
    size_m: float
    period_s: tuple[float, float]
    waves: int

    def draw(self, shape: tuple[int, int], cell_m: float, rng: np.random.Generator) -> Swings:
        """Such waves on a lattice; a travelling wave is two standing ones a quarter of a period apart."""
        number = rng.normal(0.0, 1.0 / self.size_m, (self.waves, 2))
        period_s = rng.uniform(*self.period_s, self.waves)
        rate = rng.choice([-1.0, 1.0], self.waves) * 2.0 * math.pi / period_s
        phase = rng.uniform(0.0, 2.0 * math.pi, self.waves)
        y, x = np.indices(shape) * cell_m
        angle = number[:, 0, None, None] * x + number[:, 1, None, None] * y
        return Swings(
            patterns=np.concatenate([np.cos(angle), np.sin(angle)]),
            mean=np.zeros(2 * self.waves),
            swing=np.full(2 * self.waves, self.deviation * math.sqrt(2.0 / self.waves)),
            rate_per_s=np.concatenate([rate, rate]),
            phase=np.concatenate([phase, phase + 0.5 * math.pi]),
        )
