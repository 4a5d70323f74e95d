"""What a planner is asked."""

from dataclasses import dataclass

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel


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
    """

    model: FieldModel
    start_m: FloatArray
    spots: int
    lattice: tuple[int, int]
    reason: str
    seed: int = 0
