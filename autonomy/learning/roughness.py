"""How rough the field is, here and there: the one thing learnt that says where tracks must be denser.

The variance of a stationary model does not depend on the values that were read. Local variability does: along the
track, second differences of the readings at one lag are squared and averaged in small cells. The logarithm of that
mean, freed of the noise's share, is read as a Gaussian process over the water whose mean falls with the distance from
the shore, for there fronts and plumes are. All lengths but the metres of positions are shares of √(water area).
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist
from scipy.special import digamma, polygamma

from autonomy.learning.numbers import FloatArray, as_points, as_vector, positive

__all__ = ["Roughness", "RoughnessReadings", "local_roughness"]

_FINEST_LAG = 0.02
_LAG_PER_LENGTH = 0.35
_LAG_WITHOUT_END = 0.05
_LONGEST_REACH = 0.2
"""Readings farther apart than this, or twice the lag if that is more, have a gap between them."""
_CELL = 0.08
_STRAIGHT = 0.95
"""A triple whose ends are nearer to each other than this share of the way between them lies on a turn."""
_EVEN = 1.5
"""How much longer than the other one half of a triple may be."""
_PAUSE_S = 3600.0
"""After so long the sea has changed: differences across it are not the place's."""

_NOISE_FLOOR = 0.25
"""Of the noise's share in the squares: less than this cannot be told from it."""
_SHORE_OFFSET = 0.03
_SHORE_SLOPE, _SHORE_SLOPE_DEVIATION = -0.6, 0.4
_LEVEL_DEVIATION = 10.0
_LENGTHSCALE = 0.2
_VARIANCE = 1.0
_SMALLEST_SQUARE = 1e-300


@dataclass(frozen=True, eq=False)
class RoughnessReadings:
    """Mean squared second differences in cells, oldest first.

    Attributes:
        points_m: shape (k, 2), means of the places they were taken at.
        squares: shape (k,), in squares of the readings' units, the noise's share included.
        noise_shares: shape (k,): that share, as a multiple of the variance of one reading's noise.
        freedom: shape (k,): how many independent differences each mean is worth.
        side_m: √(water area), the unit of lengths.
        lag_m: distance between the places of a difference.
    """

    points_m: FloatArray
    squares: FloatArray
    noise_shares: FloatArray
    freedom: FloatArray
    side_m: float
    lag_m: float

    def __len__(self) -> int:
        return len(self.squares)


@dataclass
class _Stretch:
    """Readings close together on the track, averaged: Σ x, Σ y, Σ value, how many; and where along it they began."""

    begun_m: float
    x_m: float = 0.0
    y_m: float = 0.0
    value: float = 0.0
    count: int = 0

    @property
    def point_m(self) -> tuple[float, float]:
        return self.x_m / self.count, self.y_m / self.count

    @property
    def mean(self) -> float:
        return self.value / self.count


class Roughness:
    """Collects squared second differences along the track, in the order of the readings. Picklable.

    Memory is bounded: at most `maximum_cells` cells, .08 of the side wide; the one begun first makes room.

    Args:
        side_m: √(water area) in metres, positive.
        budget_m: how far the vessel will sail in all, which chooses the lag: max(.02, .35 side/budget) of the side;
            None: no end is known.
        maximum_cells: at least 1.

    Raises:
        ValueError: side_m or budget_m is not positive and finite, or maximum_cells below 1.
    """

    def __init__(self, side_m: float, budget_m: float | None = None, maximum_cells: int = 500) -> None:
        self.side_m = positive("side_m", side_m)
        if maximum_cells < 1:
            raise ValueError(f"maximum_cells must be at least 1, not {maximum_cells}")
        self.maximum_cells = int(maximum_cells)
        lag = _LAG_WITHOUT_END
        if budget_m is not None:
            lag = max(_FINEST_LAG, _LAG_PER_LENGTH * side_m / positive("budget_m", budget_m))
        self._stretch_m = _FINEST_LAG * side_m
        self._steps = max(1, round(lag / _FINEST_LAG))
        self._reach_m = max(2.0 * lag, _LONGEST_REACH) * side_m
        self._travelled_m = 0.0
        self._last: tuple[float, float, float] | None = None
        self._track: deque[_Stretch] = deque(maxlen=2 * self._steps + 2)
        # Place -> Σ x, Σ y, Σ square, Σ noise share, how many.
        self._cells: dict[tuple[int, int], FloatArray] = {}

    def __len__(self) -> int:
        return len(self._cells)

    @property
    def lag_m(self) -> float:
        """Distance between the three places of a second difference."""
        return self._steps * self._stretch_m

    def add(self, point_m: ArrayLike, value: float, time_s: float) -> None:
        """Take in a reading at `point_m` (2,), in the units the field is Gaussian in, at model time `time_s`.

        Raises:
            ValueError: one of them is not finite.
        """
        x, y = (float(c) for c in np.asarray(point_m, dtype=float).reshape(2))
        if not all(map(math.isfinite, (x, y, value, time_s))):
            raise ValueError(f"position, value and time must be finite, not {(x, y, value, time_s)}")
        if self._last is not None:
            step_m = math.hypot(x - self._last[0], y - self._last[1])
            self._travelled_m += step_m
            if step_m > self._reach_m or not 0.0 <= time_s - self._last[2] <= _PAUSE_S:
                self._track.clear()
        self._last = (x, y, time_s)
        # Round-off must not put two readings a stretch apart into one.
        if not self._track or self._travelled_m - self._track[-1].begun_m >= self._stretch_m * (1.0 - 1e-6):
            self._difference()
            self._track.append(_Stretch(self._travelled_m))
        stretch = self._track[-1]
        stretch.x_m += x
        stretch.y_m += y
        stretch.value += value
        stretch.count += 1

    def frozen(self) -> RoughnessReadings:
        """What was collected so far."""
        sums = np.array(list(self._cells.values())).reshape(-1, 5)
        counts = np.maximum(sums[:, 4:], 1.0)
        means = sums[:, :4] / counts
        # Differences one stretch apart share readings: about one in `_steps` is new.
        freedom = np.maximum(1.0, counts[:, 0] / self._steps)
        return RoughnessReadings(
            means[:, :2].copy(), means[:, 2], means[:, 3], freedom, self.side_m, self.lag_m
        )

    def _difference(self) -> None:
        """Count the second difference that ends with the newest stretch, now that it is complete."""
        if len(self._track) <= 2 * self._steps:
            return
        early, middle, late = (self._track[-1 - k * self._steps] for k in (2, 1, 0))
        before = math.dist(early.point_m, middle.point_m)
        after = math.dist(middle.point_m, late.point_m)
        is_even = max(before, after) <= _EVEN * min(before, after)
        is_straight = math.dist(early.point_m, late.point_m) >= _STRAIGHT * (before + after)
        if not (is_even and is_straight and before + after <= 2.0 * self._reach_m):
            return
        square = (middle.mean - 0.5 * (early.mean + late.mean)) ** 2
        share = 1.0 / middle.count + 0.25 / early.count + 0.25 / late.count
        self._count(np.array([*middle.point_m, square, share, 1.0]))

    def _count(self, row: FloatArray) -> None:
        cell_m = _CELL * self.side_m
        place = math.floor(row[0] / cell_m), math.floor(row[1] / cell_m)
        if place not in self._cells:
            if len(self._cells) == self.maximum_cells:
                del self._cells[next(iter(self._cells))]
            self._cells[place] = np.zeros(5)
        self._cells[place] += row


def local_roughness(
    readings: RoughnessReadings | None,
    noise_variance: float,
    shore_at_readings: ArrayLike,
    points_m: ArrayLike,
    shore_at_points: ArrayLike,
    side_m: float,
) -> tuple[FloatArray, FloatArray]:
    """Mean and variance of the logarithm of the local roughness at points.

    The mean is b0 + b1 log(d + .03) for the distance d from the shore, b0 unknown, b1 ~ N(−.6, .4²), plus a
    Gaussian process with an exponential kernel (universal kriging with proper priors: Rasmussen & Williams 2006,
    section 2.7). A mean of ν squares has a log χ² distribution: mean ψ(ν/2) − log(ν/2), variance ψ′(ν/2).

    Args:
        readings: what was collected; None or empty: nothing, the level is then 0.
        noise_variance: of one reading, in squares of its units.
        shore_at_readings: shape (k,), distance from the shore of `readings.points_m`, shares of the side.
        points_m: shape (n, 2).
        shore_at_points: shape (n,).
        side_m: √(water area), metres.

    Returns:
        Two arrays of shape (n,).

    Raises:
        ValueError: shapes do not fit, or a number is negative or not finite.
    """
    side_m = positive("side_m", side_m)
    points = as_points(points_m, 2) / side_m
    features = _features(as_vector(shore_at_points, "shore_at_points", len(points)))
    slope = np.array([0.0, _SHORE_SLOPE])
    spread = np.array([_LEVEL_DEVIATION**2, _SHORE_SLOPE_DEVIATION**2])
    if readings is None or not len(readings):
        # The level is not known and does not matter: only differences between places do.
        return features @ slope, _VARIANCE + features[:, 1] ** 2 * spread[1]
    if not (math.isfinite(noise_variance) and noise_variance >= 0.0):
        raise ValueError(f"noise_variance must be zero or more and finite, not {noise_variance!r}")
    shore = as_vector(shore_at_readings, "shore_at_readings", len(readings))
    known, places = _features(shore), readings.points_m / side_m
    values, variances = _logarithms(readings, noise_variance)
    slope[0] = np.mean(values - known @ slope)
    factor = cho_factor(_kernel(places, places) + known * spread @ known.T + np.diag(variances), lower=True)
    cross = _kernel(points, places) + features * spread @ known.T
    mean = features @ slope + cross @ cho_solve(factor, values - known @ slope)
    variance = _VARIANCE + features**2 @ spread - np.einsum("ij,ji->i", cross, cho_solve(factor, cross.T))
    return mean, np.maximum(variance, 0.0)


def _logarithms(readings: RoughnessReadings, noise_variance: float) -> tuple[FloatArray, FloatArray]:
    """Unbiased logarithms of the squares without noise, and their variances."""
    noise = readings.noise_shares * noise_variance
    square = np.maximum(readings.squares - noise, np.maximum(_NOISE_FLOOR * noise, _SMALLEST_SQUARE))
    half = 0.5 * readings.freedom
    return np.log(square) - (digamma(half) - np.log(half)), polygamma(1, half)


def _features(shore: FloatArray) -> FloatArray:
    if np.any(shore < 0.0):
        raise ValueError("distances from the shore must not be negative")
    return np.column_stack([np.ones(len(shore)), np.log(np.minimum(shore, 1.0) + _SHORE_OFFSET)])


def _kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    kernel: FloatArray = _VARIANCE * np.exp(-cdist(a, b) / _LENGTHSCALE)
    return kernel
