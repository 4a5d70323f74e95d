"""How fast the vessel sails its missions."""

import math

MEMORY_S = 120.0
"""Model time over which the speed is averaged: a few legs, so that corners count for what they cost."""


class Pace:
    """The mean speed over ground of the last minutes under way; `usual_mps` until there were any."""

    def __init__(self, usual_mps: float) -> None:
        self._usual_mps = usual_mps
        self._mean_mps = 0.0
        self._known_s = 0.0
        self._time_s: float | None = None

    @property
    def speed_mps(self) -> float:
        """The usual speed counts for ten seconds, so that the first ones do not make the mean."""
        return (10.0 * self._usual_mps + self._known_s * self._mean_mps) / (10.0 + self._known_s)

    def rest(self) -> None:
        """The vessel is not under way."""
        self._time_s = None

    def follow(self, time_s: float, speed_mps: float | None) -> None:
        """Under way at this model time and speed over ground; None, or a clock that went back, tell nothing."""
        elapsed_s = 0.0 if self._time_s is None else time_s - self._time_s
        self._time_s = time_s
        if speed_mps is None or not math.isfinite(speed_mps) or not 0.0 < elapsed_s < MEMORY_S:
            return
        self._known_s = min(MEMORY_S, self._known_s + elapsed_s)
        self._mean_mps += elapsed_s / self._known_s * (speed_mps - self._mean_mps)
