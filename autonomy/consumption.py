"""What a metre over ground costs, learned under way: in seconds, and in joules of the battery."""

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray

GUESS_SD = 0.5
"""Standard deviation of a guess at the cost of a metre, relative to it."""

DIRECTION_SD = 0.2
"""Of what the water adds one way and takes off the other, relative to the guess, before anything is known of it."""

LEAST_SPREAD = 0.05
"""Of windows, relative to their mean: nothing is steadier at sea."""

ALIKE = 4.0
"""Neighbouring windows resemble each other: n of them say no more than n / 4 would on their own."""

_HUBER_K = 1.5
_ROUNDS = 12


class MetreCost:
    """Cost of a metre over ground as a + b·u, u being the unit vector of the way made good.

    Theory of operation. In a current c, a boat of speed v through the water makes good about v + c·u, so that a metre
    costs about (1 - c·u / v) times as much as in still water; a boat that keeps its speed over ground pays for the same
    in power. Either way the first harmonic is nearly all of it. A window of length L over ground and displacement Δ
    costs a·L + b·Δ however crooked it was. Each begins and ends where the meter has just moved, so that one which
    counts in percent is as exact as one that counts in hectojoules, only more seldom.

    a and b are the mean of a Gaussian posterior (Bishop 2006, section 3.3): priors as above; windows with Huber's
    weights (Huber 1964, k = 1.5), about the scale of the median absolute deviation.
    """

    WINDOW_M = 100.0
    KEPT = 120
    RECENT = 10

    def __init__(self, guess: float | None) -> None:
        """Start from a guess at the cost of a metre; None: it costs nothing until something has been measured."""
        self._guess = guess
        self._windows: deque[tuple[float, float, float]] = deque(maxlen=self.KEPT)
        self._begun: float | None = None
        self._metered: float | None = None
        self._sailed_m = 0.0
        self._moved_m = np.zeros(2)
        self._posterior: tuple[FloatArray, FloatArray, float] | None = None

    def pause(self) -> None:
        """What comes next is no part of a window: the boat is not sailing."""
        self._begun = self._metered = None

    def follow(self, metered: float, sailed_m: float, moved_m: ArrayLike) -> None:
        """Take in what the meter shows, and the way sailed since the last call: its length and displacement (2,)."""
        self._sailed_m += sailed_m
        self._moved_m = self._moved_m + np.asarray(moved_m, dtype=float)
        has_ticked = self._metered is not None and metered > self._metered
        self._metered = metered
        if not has_ticked:
            return
        if self._begun is not None and self._sailed_m < self.WINDOW_M:
            return
        if self._begun is not None:
            east, north = self._moved_m / self._sailed_m
            self._windows.append(((metered - self._begun) / self._sailed_m, float(east), float(north)))
            self._posterior = None
        self._begun, self._sailed_m, self._moved_m = metered, 0.0, np.zeros(2)

    @property
    def mean(self) -> float:
        """Of a metre in any direction."""
        return float(self._fitted()[0][0])

    @property
    def spread(self) -> float:
        """Robust standard deviation of windows about their mean; 0 before the first."""
        return self._fitted()[2]

    @property
    def excess(self) -> float:
        """By how much a metre of the last `RECENT` windows has cost more than it should have by all of them; or 0."""
        if not self._windows:
            return 0.0
        recent = np.array(self._windows)[-self.RECENT :]
        expected = np.column_stack([np.ones(len(recent)), recent[:, 1:]]) @ self._fitted()[0]
        return max(0.0, float(np.mean(recent[:, 0] - expected)))

    def along(self, directions: ArrayLike, deviations: float = 0.0) -> FloatArray:
        """Cost of a metre in unit directions, shape (n, 2), plus so many standard deviations of it; shape (n,)."""
        towards = np.asarray(directions, dtype=float).reshape(-1, 2)
        design = np.column_stack([np.ones(len(towards)), towards])
        mean, covariance, _ = self._fitted()
        deviation = np.sqrt(np.einsum("ni,ij,nj->n", design, covariance, design).clip(0.0))
        # Where a strong current helps, the harmonic would end below nothing.
        cost: FloatArray = np.maximum(design @ mean, 0.2 * mean[0]) + deviations * deviation
        return cost

    def _fitted(self) -> tuple[FloatArray, FloatArray, float]:
        if self._posterior is None:
            self._posterior = self._fit()
        return self._posterior

    def _fit(self) -> tuple[FloatArray, FloatArray, float]:
        if not self._windows and self._guess is None:
            return np.zeros(3), np.zeros((3, 3)), 0.0
        windows = np.array(self._windows).reshape(-1, 3)
        cost, design = windows[:, 0], np.column_stack([np.ones(len(windows)), windows[:, 1:]])
        guess = float(np.median(cost)) if self._guess is None else self._guess
        prior = np.array([guess, 0.0, 0.0])
        precision = np.diag((np.array([GUESS_SD, DIRECTION_SD, DIRECTION_SD]) * guess) ** -2.0)
        mean: FloatArray = np.array([np.median(cost), 0.0, 0.0]) if len(cost) else prior
        covariance, spread = np.asarray(np.linalg.inv(precision), dtype=float), 0.0
        for _ in range(_ROUNDS if len(cost) else 0):
            residual = np.abs(cost - design @ mean)
            spread = max(1.4826 * float(np.median(residual)), LEAST_SPREAD * abs(float(mean[0])))
            weights = 1.0 / np.maximum(1.0, residual / (_HUBER_K * spread)) / (ALIKE * spread**2)
            covariance = np.linalg.inv(precision + design.T @ (weights[:, None] * design))
            mean = covariance @ (precision @ prior + design.T @ (weights * cost))
        return mean, covariance, spread


class Meter:
    """Energy drawn since the first reading, in joules, from what the autopilot tells of its battery.

    It tells, best first: BATTERY_STATUS.energy_consumed; current_consumed, times the voltage of the moment; the share
    that is left, times the capacity. A counter that goes back started again from zero, with the autopilot.
    """

    def __init__(self, capacity_j: float | None) -> None:
        self._capacity_j = capacity_j
        self._source = ""
        self._last = 0.0
        self.drawn_j: float | None = None

    def follow(
        self, consumed_j: float | None, drawn_c: float | None, voltage_v: float | None, share: float | None
    ) -> None:
        """Take in a report: joules and coulombs drawn, volts, and the share that is left; None is unknown."""
        if consumed_j is not None:
            self._count("energy", consumed_j, 1.0)
        elif drawn_c is not None and voltage_v is not None:
            self._count("charge", drawn_c, voltage_v)
        elif share is not None and self._capacity_j is not None:
            # A gauge that swings between two percent has counted the higher one once.
            drawn = (1.0 - share) * self._capacity_j
            self._count("share", max(drawn, self._last) if self._source == "share" else drawn, 1.0)

    @property
    def is_coarse(self) -> bool:
        """Whether it counts in percent."""
        return self._source == "share"

    def _count(self, source: str, raw: float, joules: float) -> None:
        before = self._last if source == self._source else raw
        increment = raw - before if raw >= before else raw
        self._source, self._last = source, raw
        self.drawn_j = (self.drawn_j or 0.0) + increment * joules
