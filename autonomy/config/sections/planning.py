"""Sections about where to go next, when to decide it, and how far."""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from autonomy.config.sections.section import Conflict, Section
from autonomy.config.types import Corner, LatticeSide, Positive


class ExplorationSection(Section):
    """Algorithm 1: when to re-estimate and re-plan."""

    rho0: float = Field(
        default=0.6,
        gt=0,
        le=1,
        allow_inf_nan=False,
        description="rho above which the model is re-estimated and a new path planned; 1 is never exceeded",
    )
    rho_rule: Literal["added", "replaced"] = Field(
        default="added",
        description="share of basis vectors added since the last re-estimate, or replacements over capacity",
    )
    minimum_basis: int = Field(
        default=20,
        ge=1,
        le=1000,
        description="rho counts only from this many basis vectors on, the interval from as many basis vectors "
        "or cells of the history; both, and the end of a path, from readings of 20 places a thirtieth of the survey "
        "wide, unless this is less",
    )
    maximum_interval_s: Positive | None = Field(
        default=3600.0, description="longest model time between re-estimates; null for no limit"
    )
    outgrown_ratio: Positive | None = Field(
        default=4.0,
        description="re-estimate when the readings vary this many times more than the model's signal variance says "
        "and their history has doubled since the last re-estimate; null: never",
    )
    stall_s: Positive | None = Field(
        default=60.0,
        description="model time without getting anywhere, in AUTO under our mission, after which the boat counts as "
        "stalled and the water behind the stall is given up for a while; null: never",
    )
    stall_m: Positive = Field(default=8.0, description="moving less than this is not getting anywhere")
    give_up_s: Positive = Field(
        default=1800.0,
        description="model time for which water behind a stall is given up; doubled when the boat stalls there again",
    )
    replan_share: Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)] | None = Field(
        default=None,
        description="share of the longest path so far after which, sailed, a new one is planned without a re-estimate; "
        "null: a seventh with the planner route, which learns where the field is rough, and never with the others",
    )
    reestimate_on_path_end: bool = Field(
        default=True,
        description="whether the end of a path brings a re-estimate, or only a new path",
    )


class PlanningSection(Section):
    """The planner."""

    planner: Literal["auto", "paper", "spots", "route", "patrol", "lawnmower"] = Field(
        default="auto",
        description="how the next path is found: route within a budget, and else spots, or patrol where the field "
        "moves; spots and a tour as in the paper; better spots, those not yet visited kept; a whole route for what "
        "may be sailed; rounds for ever over a field that moves; lanes back and forth",
    )
    lattice: Annotated[tuple[LatticeSide, LatticeSide], Field(strict=False)] = Field(
        default=(12, 12),
        description="candidate sites across the area, to the east and to the north; those on land drop out",
    )
    spots: int = Field(default=20, ge=1, le=200, description="sampling spots on one path")
    hold_s: float = Field(
        default=0.0,
        ge=0,
        le=3600,
        allow_inf_nan=False,
        description="how long the boat stays at each sampling spot; autopilots may take whole seconds only",
    )
    minimum_gain: float = Field(
        default=0.02,
        ge=0,
        lt=1,
        allow_inf_nan=False,
        description="by how much a new plan must be better than what is left of the present one to change course, "
        "with planners that can tell",
        json_schema_extra={"unit": "of the planner's objective"},
    )
    iterations: Annotated[int, Field(ge=1, le=1_000_000)] | None = Field(
        default=None,
        description="how long a planner that searches may search; null: as long as it finds right",
    )
    deadline_s: Positive = Field(
        default=120.0,
        description="time after which a re-estimate or a plan is given up and the worker replaced",
    )

    def conflicts(self) -> Iterator[Conflict]:
        """Mutual information is about the spots and the rest, so there must be a rest."""
        sites = self.lattice[0] * self.lattice[1]
        if self.spots >= sites:
            what = f"must be below the {sites} sites of planning.lattice (got {self.spots})"
            yield Conflict(("spots", "lattice"), what, "planning.spots < product of planning.lattice")


class BudgetSection(Section):
    """How far, how long and on what charge the boat may sail, the way home included; see docs/budget.md."""

    distance_m: Positive | None = Field(
        default=None, description="most that may be sailed over ground; null for no limit"
    )
    duration_s: Positive | None = Field(
        default=None,
        description="longest model time from the start until the boat is home; null for no limit",
    )
    energy_wh: Positive | None = Field(
        default=None,
        description="energy of the full battery, of which what it holds at the start may be drawn; null for no limit",
        json_schema_extra={"unit": "Wh"},
    )
    consumption_j_per_m: Positive | None = Field(
        default=None,
        description="energy per metre over ground, a guess until enough has been measured; needed with "
        "energy_wh (1 Wh/km is 3.6 J/m)",
        json_schema_extra={"unit": "J/m"},
    )
    speed_mps: Positive = Field(
        default=1.5, description="speed over ground, a guess until it has been measured"
    )
    reserve: float = Field(
        default=0.1,
        ge=0,
        lt=1,
        allow_inf_nan=False,
        description="what is left of each limit when the boat is home, a reserve that no plan spends",
        json_schema_extra={"unit": "of the limit"},
    )
    home_margin: float = Field(
        default=1.2,
        ge=1,
        le=3,
        allow_inf_nan=False,
        description="no leg is begun unless the way home from its end could be paid this many times after it; with "
        "half of this margin the boat turns back (stage low), without any it is critical",
    )
    low_battery: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=None,
        description="charge at which the boat turns back wherever it is; null: none",
        json_schema_extra={"unit": "of the full charge"},
    )
    critical_battery: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] | None = Field(
        default=None,
        description="charge that is critical: the boat is to come home as fast as it can; null: none",
        json_schema_extra={"unit": "of the full charge"},
    )
    home: Corner | None = Field(
        default=None,
        description="where the survey ends; null: the autopilot's home position, or where the survey began",
        json_schema_extra={"unit": "degrees", "allowed": "[latitude, longitude], or null"},
    )

    @property
    def is_limited(self) -> bool:
        """Whether anything here can ever bring the boat home."""
        limits = (self.distance_m, self.duration_s, self.energy_wh, self.low_battery, self.critical_battery)
        return any(limit is not None for limit in limits)

    def conflicts(self) -> Iterator[Conflict]:
        """Energy must be known by the metre; what is critical is also low."""
        if self.energy_wh is not None and self.consumption_j_per_m is None:
            what = (
                "needs budget.consumption_j_per_m: nothing tells how far it goes until that has been measured"
            )
            yield Conflict(
                ("energy_wh", "consumption_j_per_m"), what, "a guess at budget.consumption_j_per_m"
            )
        low, critical = self.low_battery, self.critical_battery
        if low is not None and critical is not None and critical > low:
            what = f"must be at most budget.low_battery ({low:g}) (got {critical:g})"
            yield Conflict(
                ("critical_battery", "low_battery"), what, "budget.critical_battery <= budget.low_battery"
            )
