"""Time and energy of legs in a current."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray

Current = Callable[[FloatArray], FloatArray]
"""Velocity of the water over ground at points (n, 2), local metres: (n, 2), m/s to the east and to the north."""

_MOST_PIECES = 1000


@dataclass(frozen=True)
class Sailing:
    """A vessel at a constant speed through the water, which crabs so that it stays on its leg.

    With the current's components c∥ along the leg and c⊥ across it, the speed over ground is
    √(v² − c⊥²) + c∥ (the wind triangle of navigation); where that is not above zero, or c⊥ is v or more, the
    leg cannot be sailed.

    Attributes:
        speed_mps: v, through the water.
        power_w: drawn at that speed, the electronics included; energy is time × power.
        current: constant (east, north) in m/s, or a function of place.
        step_m: a current that is a function is looked at in the middles of pieces of a leg that long or shorter.
    """

    speed_mps: float
    power_w: float = 0.0
    current: tuple[float, float] | Current = (0.0, 0.0)
    step_m: float = 200.0

    def __post_init__(self) -> None:
        if not (0.0 < self.speed_mps < np.inf and 0.0 <= self.power_w < np.inf and self.step_m > 0.0):
            raise ValueError(
                f"speed and step must be above 0 and power at least 0, not {self.speed_mps} m/s, "
                f"{self.step_m} m and {self.power_w} W"
            )

    def times_s(self, starts: ArrayLike, ends: ArrayLike) -> FloatArray:
        """Times of straight legs, from (n, 2) to (n, 2), or one of them (2,): shape (n,); inf if they can't be sailed.

        A leg of no length takes no time, also where the current could not be stemmed.
        """
        a, b = np.broadcast_arrays(
            np.asarray(starts, dtype=float).reshape(-1, 2), np.asarray(ends, dtype=float).reshape(-1, 2)
        )
        length = np.hypot(*(b - a).T)
        if not callable(self.current):
            return self._times(b - a, length, np.broadcast_to(self.current, a.shape))
        pieces = np.clip(np.ceil(length / self.step_m), 1, _MOST_PIECES).astype(np.intp)
        leg = np.repeat(np.arange(len(a)), pieces)
        number = np.arange(len(leg)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
        middle = a[leg] + ((number + 0.5) / pieces[leg])[:, None] * (b - a)[leg]
        spent = self._times((b - a)[leg], length[leg] / pieces[leg], self.current(middle))
        return np.bincount(leg, weights=spent, minlength=len(a)).astype(float)

    def _times(self, direction: FloatArray, length: FloatArray, current: FloatArray) -> FloatArray:
        run = np.hypot(*direction.T)
        unit = direction / np.where(run > 0.0, run, 1.0)[:, None]
        along = np.sum(unit * current, axis=1)
        across = unit[:, 0] * current[:, 1] - unit[:, 1] * current[:, 0]
        held = self.speed_mps**2 - across**2
        over_ground = np.sqrt(np.maximum(held, 0.0)) + along
        # NaN, a current that nobody knows, fails both comparisons.
        possible = (held > 0.0) & (over_ground > 0.0)
        times = np.where(possible, length / np.where(possible, over_ground, 1.0), np.inf)
        return np.asarray(np.where(length > 0.0, times, 0.0))

    def way_time_s(self, way_m: ArrayLike) -> float:
        """Time along a way of shape (n, 2), in its order; inf if a leg can't be sailed."""
        way = np.asarray(way_m, dtype=float).reshape(-1, 2)
        return float(np.sum(self.times_s(way[:-1], way[1:]))) if len(way) > 1 else 0.0
