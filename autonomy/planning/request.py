"""What a planner is asked."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.learning.history import HistoryCells
from autonomy.learning.roughness import RoughnessReadings


def _nothing() -> FloatArray:
    return np.empty((0, 2))


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """Where to go next, given what is believed.

    Attributes:
        model: the frozen posterior.
        start_m: shape (2,), local metres: where the plan begins.
        spots: how many sampling spots are wanted.
        lattice: (nx, ny), candidate sites over the survey's bounds, east and north.
        reason: why a plan is wanted now, for a person.
        seed: of whatever a planner does at random.
        iterations: how much a planner that searches may search; None: as much as it thinks right. Never a time, so
            that equal requests get equal plans.
        remainder_m: shape (k, 2), corners of the previous plan that were not reached yet, in sailing order: a warm
            start. Empty: none.
        remainder_is_spot: shape (k,), bool, which of them are sampling spots.
        measured: cells of readings taken so far, for planners that count what is covered; None: nothing yet.
        roughness: how variable the readings were, here and there, in the model's units; None: nothing learnt.
        budget_m: metres that may still be sailed from the start, the way home included if `home_m` is given;
            None: no end.
        home_m: shape (2,), where the route must be able to end within the budget; None: it may end anywhere.
        sample_spacing_m: distance between readings along the way; 0: as dense as it matters.
        speed_mps: speed over ground, for planners that think of a moving field.
        model_version: how many readings the model knows; None: none, so that its scale is a guess.
    """

    model: FieldModel
    start_m: FloatArray
    spots: int
    lattice: tuple[int, int]
    reason: str
    seed: int = 0
    iterations: int | None = None
    remainder_m: FloatArray = field(default_factory=_nothing)
    remainder_is_spot: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool))
    measured: HistoryCells | None = None
    budget_m: float | None = None
    home_m: FloatArray | None = None
    sample_spacing_m: float = 0.0
    speed_mps: float = 1.5
    model_version: int | None = None
    roughness: RoughnessReadings | None = None
