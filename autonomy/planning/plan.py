"""A plan: where to go next, and why."""

from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray, path_length_m

NO_SPOTS = nan
"""The mutual information of the spots of a plan that has none."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A route over water through chosen sampling spots.

    Attributes:
        route_m: shape (k, 2), local metres: every corner of the route in sailing order, the start excluded.
        is_spot: shape (k,), bool: which corners are sampling spots (the others only round the land).
        start_m: shape (2,), where the route begins.
        mutual_information: true I(P) of the spots in nats, given what is already known; NaN: not known, or no spots.
        planner: name of the planner that made it.
        reason: why a plan was made now, for a person.
        unreachable_sites: candidates that no way over water leads to from the start.
        objective_before: the planner's objective, a cost (less is better), had the remainder of the previous plan
            been sailed instead; None: there was none, or the planner does not compare with it.
        objective_after: the same of this plan; None: the planner has no such objective.
        expected_rmse: root of the mean posterior variance over the water once the plan has been sailed, in the units
            that the model is Gaussian in; None: not known.
        rejected: names and objectives of the candidates that lost to this plan, the best first.
        seed: what the planner drew its random choices from; None: not recorded.
        model_version: how many readings the model knew that was planned with; None: not recorded.
        home_corners: so many corners at the route's end are the way home; 0: it ends somewhere at sea.
    """

    start_m: FloatArray
    route_m: FloatArray
    is_spot: NDArray[np.bool_]
    mutual_information: float
    planner: str
    reason: str
    unreachable_sites: int = 0
    objective_before: float | None = None
    objective_after: float | None = None
    expected_rmse: float | None = None
    rejected: tuple[tuple[str, float], ...] = ()
    seed: int | None = None
    model_version: int | None = None
    home_corners: int = 0

    @property
    def survey_corners(self) -> int:
        """How many of the route's corners are not the way home."""
        return max(0, len(self.route_m) - self.home_corners)

    @property
    def spots_m(self) -> FloatArray:
        """The sampling spots in sailing order, shape (n, 2)."""
        spots: FloatArray = self.route_m[np.asarray(self.is_spot, dtype=bool)]
        return spots

    @property
    def length_m(self) -> float:
        """Length of the whole route from its start."""
        return path_length_m([self.start_m, *self.route_m])
