"""A dry run with what it was made from: did it succeed, and what was spent of the budget?"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from autonomy.config import Configuration
from autonomy.planning.survey import SurveyArea
from sim.rehearsal.values import Sailed, Wishes


@dataclass(frozen=True)
class Limit:
    """One of the budget's limits: what was spent of it, and what is left for that when the reserve is kept."""

    name: str
    spent: float
    usable: float
    unit: str

    @property
    def share(self) -> float:
        """Of what may be spent."""
        return self.spent / self.usable

    def __str__(self) -> str:
        return f"{self.name} {self.spent:.1f} of {self.usable:.1f} {self.unit} ({self.share:.0%})"


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was asked, and what came of it."""

    configuration: Configuration
    survey: SurveyArea
    wishes: Wishes
    sailed: Sailed

    @property
    def succeeded(self) -> bool:
        """Whether the boat would have come back, or, without a budget, sailed as long as it should."""
        sailed = self.sailed
        if sailed.is_aground or sailed.is_drained or self.legs_over_land:
            return False
        return sailed.is_home or self.wishes.hours is not None or not self.configuration.budget.is_limited

    @property
    def limits(self) -> list[Limit]:
        """Of the budget, those that are set."""
        budget, sailed = self.configuration.budget, self.sailed
        kept = 1.0 - budget.reserve
        found = []
        if budget.distance_m is not None:
            found.append(Limit("distance", sailed.km, kept * budget.distance_m / 1e3, "km"))
        if budget.duration_s is not None:
            found.append(Limit("time", sailed.hours, kept * budget.duration_s / 3600.0, "h"))
        if budget.energy_wh is not None and sailed.energy_wh is not None:
            found.append(Limit("energy", sailed.energy_wh, kept * budget.energy_wh, "Wh"))
        return found

    @cached_property
    def legs_over_land(self) -> int:
        """Of all plans, by the field's own land, every ten metres."""
        legs = [leg for plan in self.sailed.plans for leg in pairwise([plan.start_deg, *plan.route_deg])]
        return sum(self.sailed.truth.crosses_land(*leg) for leg in legs)
