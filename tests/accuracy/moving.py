"""Truths that move, in local metres and seconds, and the tracks on which they are read.

Each truth is a function of place for the moment at which it stands; `advance` lets time pass. All have variance
1 (a Gaussian process: in expectation), so that errors are shares of the field's standard deviation.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class MovingTruth(Protocol):
    """A field of variance 1 that changes while time passes."""

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` ≥ 0 pass."""

    def value(self, points: FloatArray) -> FloatArray:
        """The field now at `points` (n, 2), metres: shape (n,)."""


class SmoothDraw:
    """A draw from a Gaussian process with the SE kernel on the square [0, span]², or a little beyond.

    f(x) = k(x, G) K_GG^(-1/2) z on a lattice G of spacing l/2 with a margin of 3 l: at that spacing the variance which
    the lattice cannot express is below 1e-3. The kernel is a product over the axes, and so is its root.
    """

    def __init__(self, rng: np.random.Generator, span_m: float, lengthscale_m: float) -> None:
        self._lengthscale_m = lengthscale_m
        self._nodes = np.arange(-3.0 * lengthscale_m, span_m + 3.0 * lengthscale_m, 0.5 * lengthscale_m)
        self._root = np.linalg.cholesky(self._factor(self._nodes) + 1e-9 * np.eye(len(self._nodes)))
        self.weights = self.draw(rng)

    def draw(self, rng: np.random.Generator) -> FloatArray:
        """Fresh standard normal weights, shape (nodes, nodes)."""
        return rng.standard_normal((len(self._nodes), len(self._nodes)))

    def value(self, points: FloatArray) -> FloatArray:
        """The draw at `points` (n, 2): shape (n,)."""
        rows = [np.linalg.solve(self._root, self._factor(points[:, axis]).T) for axis in (0, 1)]
        return np.einsum("in,ij,jn->n", rows[0], self.weights, rows[1], optimize=True)

    def _factor(self, coordinates: FloatArray) -> FloatArray:
        difference = np.subtract.outer(coordinates, self._nodes) / self._lengthscale_m
        return np.asarray(np.exp(-0.5 * difference * difference))


class OrnsteinUhlenbeckField:
    """SE in space times exp(-|t|/τ) in time, sampled exactly: every weight of the draw is a stationary OU process."""

    def __init__(
        self, rng: np.random.Generator, span_m: float, lengthscale_m: float, timescale_s: float
    ) -> None:
        self._rng = rng
        self._draw = SmoothDraw(rng, span_m, lengthscale_m)
        self._timescale_s = timescale_s

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` ≥ 0 pass; with an infinite τ nothing changes."""
        kept = math.exp(-dt_s / self._timescale_s)
        fresh = math.sqrt(-math.expm1(-2.0 * dt_s / self._timescale_s))
        self._draw.weights = kept * self._draw.weights + fresh * self._draw.draw(self._rng)

    def value(self, points: FloatArray) -> FloatArray:
        """The field now at `points` (n, 2): shape (n,)."""
        return self._draw.value(points)


class Rotation:
    """A smooth draw that turns like a disc about the middle of the square once in `period_s`."""

    def __init__(
        self, rng: np.random.Generator, span_m: float, lengthscale_m: float, period_s: float
    ) -> None:
        # The corners of the square sweep a circle, so the draw covers a square about that.
        self._reach_m = span_m / math.sqrt(2.0)
        self._draw = SmoothDraw(rng, 2.0 * self._reach_m, lengthscale_m)
        self._centre_m = span_m / 2.0
        self._rate_per_s = 2.0 * math.pi / period_s
        self._angle = 0.0

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` ≥ 0 pass."""
        self._angle += self._rate_per_s * dt_s

    def value(self, points: FloatArray) -> FloatArray:
        """The field now at `points` (n, 2): shape (n,)."""
        x, y = (points - self._centre_m).T
        cos, sin = math.cos(self._angle), math.sin(self._angle)
        return self._draw.value(np.stack([cos * x + sin * y, cos * y - sin * x], axis=1) + self._reach_m)


class Eddies:
    """Round bumps of either sign, each circling about a place of its own, one turn in about `period_s`.

    Their amplitude makes the variance over the square and over all draws 1; nothing in this field stands still,
    and nothing of it is a Gaussian process.
    """

    def __init__(
        self, rng: np.random.Generator, span_m: float, radius_m: float, period_s: float, count: int = 40
    ) -> None:
        margin_m = 2.0 * radius_m
        self._places_m = rng.uniform(-margin_m, span_m + margin_m, (count, 2))
        self._radius_m = radius_m * rng.uniform(0.8, 1.25, count)
        self._orbit_m = radius_m * rng.uniform(0.8, 2.0, count)
        self._rate_per_s = (
            rng.choice([-1.0, 1.0], count) * 2.0 * math.pi / (period_s * rng.uniform(0.8, 1.25, count))
        )
        self._phase = rng.uniform(0.0, 2.0 * math.pi, count)
        # A bump of radius r and amplitude 1 contributes π r² / (area in which the bumps lie) to the variance.
        share = math.pi * (self._radius_m**2).sum() / (span_m + 2.0 * margin_m) ** 2
        self._amplitude = rng.choice([-1.0, 1.0], count) / math.sqrt(share)

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` ≥ 0 pass."""
        self._phase = self._phase + self._rate_per_s * dt_s

    def value(self, points: FloatArray) -> FloatArray:
        """The field now at `points` (n, 2): shape (n,)."""
        orbit = self._orbit_m[:, None] * np.stack([np.cos(self._phase), np.sin(self._phase)], axis=1)
        offset = points[:, None, :] - (self._places_m + orbit)
        squared = (offset * offset).sum(axis=-1) / self._radius_m**2
        return np.asarray(np.exp(-0.5 * squared) @ self._amplitude)


@dataclass
class Patrol:
    """A boat that sails from one random waypoint of a square to the next, for ever."""

    rng: np.random.Generator
    span_m: float
    position_m: FloatArray
    goal_m: FloatArray

    @classmethod
    def over(cls, rng: np.random.Generator, span_m: float) -> "Patrol":
        """From a random place of the square [0, span]²."""
        return cls(rng, span_m, rng.uniform(0.0, span_m, 2), rng.uniform(0.0, span_m, 2))

    def step(self, distance_m: float) -> FloatArray:
        """Sail `distance_m` further; the place reached, shape (2,)."""
        while (left_m := float(np.linalg.norm(self.goal_m - self.position_m))) < distance_m:
            self.position_m, distance_m = self.goal_m, distance_m - left_m
            self.goal_m = self.rng.uniform(0.0, self.span_m, 2)
        self.position_m = self.position_m + (self.goal_m - self.position_m) * (distance_m / left_m)
        return self.position_m
