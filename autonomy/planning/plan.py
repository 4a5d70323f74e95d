"""A plan: where to go next, and why."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray, path_length_m


@dataclass(frozen=True, eq=False)
class Plan:
    """A route over water through chosen sampling spots.

    Attributes:
        route_m: shape (k, 2), local metres: every corner of the route in sailing order, the start excluded.
        is_spot: shape (k,), bool: which corners are sampling spots (the others only round the land).
        start_m: shape (2,), where the route begins.
        mutual_information: true I(P) of the spots in nats, given what is already known.
        planner: name of the planner that made it.
        reason: why a plan was made now, for a person.
        unreachable_sites: candidates that no way over water leads to from the start.
    """

    start_m: FloatArray
    route_m: FloatArray
    is_spot: NDArray[np.bool_]
    mutual_information: float
    planner: str
    reason: str
    unreachable_sites: int = 0

    @property
    def spots_m(self) -> FloatArray:
        """The sampling spots in sailing order, shape (n, 2)."""
        spots: FloatArray = self.route_m[np.asarray(self.is_spot, dtype=bool)]
        return spots

    @property
    def length_m(self) -> float:
        """Length of the whole route from its start."""
        return path_length_m([self.start_m, *self.route_m])
