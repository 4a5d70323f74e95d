"""Where the vessel is, and how far it has sailed."""

import math

import numpy as np

from autonomy.geometry import FloatArray

FASTEST_MPS = 50.0
"""No vessel of ours sails faster; a position that would need it is a glitch."""

JITTER_M = 20.0
"""What two positions may differ by without any time between them."""

PERSISTENT_S = 5.0
PERSISTENT_FIXES = 3


class Track:
    """Follows positions, and leaves out those where no vessel can be.

    A jump that persists, for three positions and five seconds of model time, is believed after all: then it was
    the position before that was wrong, or the vessel was carried. It is no distance sailed in either case.
    """

    def __init__(self) -> None:
        self.position_m: FloatArray | None = None
        self.distance_m = 0.0
        self._time_s = 0.0
        self._jump: tuple[float, float, FloatArray] | None = None  # its first and last time, its last place
        self._fixes = 0

    def follow(self, time_s: float, point_m: FloatArray) -> None:
        """Take in that the vessel is said to be at a point, shape (2,), at a model time."""
        if self.position_m is None:
            self._settle(time_s, point_m)
        elif _is_reachable(time_s - self._time_s, self.position_m, point_m):
            self.distance_m += _distance_m(self.position_m, point_m)
            self._settle(time_s, point_m)
        elif self._persists(time_s, point_m):
            self._settle(time_s, point_m)

    def _settle(self, time_s: float, point_m: FloatArray) -> None:
        self.position_m, self._time_s, self._jump = point_m, time_s, None

    def _persists(self, time_s: float, point_m: FloatArray) -> bool:
        if self._jump is None or not _is_reachable(time_s - self._jump[1], self._jump[2], point_m):
            self._jump, self._fixes = (time_s, time_s, point_m), 1
            return False
        began_s = self._jump[0]
        self._jump = (began_s, time_s, point_m)
        self._fixes += 1
        return self._fixes >= PERSISTENT_FIXES and time_s - began_s >= PERSISTENT_S


def _distance_m(a: FloatArray, b: FloatArray) -> float:
    return math.hypot(*np.subtract(a, b))


def _is_reachable(duration_s: float, a: FloatArray, b: FloatArray) -> bool:
    return _distance_m(a, b) <= FASTEST_MPS * max(0.0, duration_s) + JITTER_M
