"""Truths that move, in local metres and seconds, and the tracks on which they are read.

Each truth is a function of place for the moment at which it stands; `advance` lets time pass. All have variance
1 (a Gaussian process: in expectation), so that errors are shares of the field's standard deviation.
"""

import math
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.synthetic import moving_patch

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


class CoastalSea:
    """The simulator's moving sea in local metres, about its own mean, in units of its own standard deviation."""

    def __init__(self, seed: int) -> None:
        self._sea = moving_patch(seed)
        self._time_s = 0.0
        bounds = self._sea.bounds
        self.span_m = max(bounds.size_m)
        self._south_west = np.array([bounds.south, bounds.west])
        self._degrees = np.array([bounds.north - bounds.south, bounds.east - bounds.west]) / self.span_m
        self.water_m = self._water(300.0)
        still = self._raw(self.water_m)
        self._mean, self._deviation = float(still.mean()), float(still.std())

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` ≥ 0 pass."""
        self._time_s += dt_s

    def value(self, points: FloatArray) -> FloatArray:
        """The field now at `points` (n, 2): shape (n,); NaN on land."""
        return (self._raw(points) - self._mean) / self._deviation

    def is_clear(self, start_m: FloatArray, goal_m: FloatArray) -> bool:
        """Whether the straight way between two places is water, looked at every 100 m."""
        steps = max(2, math.ceil(float(np.linalg.norm(goal_m - start_m)) / 100.0))
        way = start_m + np.linspace(0.0, 1.0, steps)[:, None] * (goal_m - start_m)
        return bool(np.isfinite(self._raw(way)).all())

    def _raw(self, points: FloatArray) -> FloatArray:
        lat, lon = (self._south_west + points[:, ::-1] * self._degrees).T
        return self._sea.value(lat, lon, self._time_s)

    def _water(self, spacing_m: float) -> FloatArray:
        lattice = square(self.span_m, spacing_m)
        return lattice[np.isfinite(self._raw(lattice))]


def square(span_m: float, spacing_m: float) -> FloatArray:
    """The middles of cells of a square, (n, 2)."""
    axis = np.arange(0.5 * spacing_m, span_m, spacing_m)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


class Patrol:
    """A boat that sails from one random waypoint of a square to the next, for ever; round land by other waypoints."""

    def __init__(
        self,
        rng: np.random.Generator,
        span_m: float,
        is_clear: Callable[[FloatArray, FloatArray], bool] = lambda start_m, goal_m: True,
    ) -> None:
        self._rng, self._span_m, self._is_clear = rng, span_m, is_clear
        self._position_m = self._next(None)
        self._goal_m = self._next(self._position_m)

    def step(self, distance_m: float) -> FloatArray:
        """Sail `distance_m` further; the place reached, shape (2,)."""
        while (left_m := float(np.linalg.norm(self._goal_m - self._position_m))) < distance_m:
            self._position_m, distance_m = self._goal_m, distance_m - left_m
            self._goal_m = self._next(self._position_m)
        self._position_m = self._position_m + (self._goal_m - self._position_m) * (distance_m / left_m)
        return self._position_m

    def _next(self, start_m: FloatArray | None) -> FloatArray:
        while True:
            goal_m = self._rng.uniform(0.0, self._span_m, 2)
            if self._is_clear(goal_m if start_m is None else start_m, goal_m):
                return goal_m
