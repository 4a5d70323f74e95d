"""The water that may be sailed now: the survey's, less what the autopilot's fence closes and what was given up."""

from dataclasses import replace

import numpy as np
import shapely

from autonomy.config import Configuration
from autonomy.geometry import FloatArray
from autonomy.mavlink.fence import Zone
from autonomy.mavlink.safeguards import Safeguards
from autonomy.planning.passage import passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.restrictions import UNRESTRICTED, Region, Restrictions, restricted
from autonomy.planning.survey import SurveyArea, SurveyError
from autonomy.stall import GivenUp

LEAST_GIVEN_UP_M = 25.0
"""About a waypoint that the boat stalled before, at least."""


def is_free_of_land(here_m: FloatArray, there_m: FloatArray, water: SurveyArea) -> bool:
    """Whether a straight leg touches neither land nor keep-out, wherever it lies."""
    return not shapely.intersects(water.obstacles, shapely.linestrings([here_m, there_m]))


class Seaway:
    """Where the vessel may be sent, and the ways there; see the module's description."""

    def __init__(self, configuration: Configuration, survey: SurveyArea) -> None:
        self._survey = survey
        self._margin_m = configuration.authority.fence_margin_m
        self._given_up = GivenUp(configuration.exploration.give_up_s, LEAST_GIVEN_UP_M)
        self.restrictions = UNRESTRICTED
        self.problem: str | None = None
        """Why nothing can be planned in this water."""
        # Built now, not when a way is first needed: it takes a second, and then the vessel is at sea.
        passage_of(survey)

    @property
    def water(self) -> SurveyArea:
        """The survey, with the water that is left of it; what was left before, if nothing would be."""
        return self._survey if self.problem else restricted(self._survey, self.restrictions)

    def enclose(self, safeguards: Safeguards) -> bool:
        """Keep inside this fence from now on; returns whether it is another one than before."""
        inside = tuple(tuple(map(self._region, group)) for group in safeguards.inclusions)
        outside = tuple(map(self._region, safeguards.exclusions))
        before = self.restrictions
        return self._restrict(
            replace(
                before, inside=inside, outside=outside, margin_m=self._margin_m if inside or outside else 0.0
            )
        )

    def give_up(self, time_s: float, point_m: FloatArray, waypoint_m: FloatArray) -> float:
        """The boat stalled at a point on its way to a waypoint; returns for how long its water is given up."""
        return self._given_up.add(time_s, point_m, waypoint_m)

    def refresh(self, time_s: float) -> None:
        """Take up again what has been given up for long enough at a model time."""
        self._restrict(replace(self.restrictions, given_up=self._given_up.regions(time_s)))

    def joined(self, plan: Plan, here_m: FloatArray | None) -> Plan:
        """The plan from where the vessel is now: it may have left the plan's start, and land may lie between.

        Raises:
            Unreachable: there is no way over water to the plan's first corner.
        """
        if here_m is None or self._is_free(here_m, plan.route_m[0]):
            return plan
        way = passage_of(self.water).path(here_m, plan.route_m[0])[1:-1]
        is_spot = np.concatenate([np.zeros(len(way), dtype=bool), plan.is_spot])
        return replace(plan, start_m=here_m, route_m=np.vstack([way, plan.route_m]), is_spot=is_spot)

    def is_open(self, route_m: FloatArray, *, ends_home: bool = False) -> bool:
        """Whether a route, shape (n, 2), keeps to the water that is left; only home may lie outside the survey."""
        water = self.water
        if ends_home and len(route_m):
            last_leg = route_m[-2:]
            route_m = route_m[:-1]
            if len(last_leg) == 2 and not self.may_sail(last_leg[0], last_leg[1], home=True):
                return False
        if len(route_m) < 2:
            return bool(water.is_navigable(route_m).all())
        return bool(water.legs_are_clear(route_m[:-1], route_m[1:]).all())

    def may_sail(self, here_m: FloatArray, corner_m: FloatArray, *, home: bool = False) -> bool:
        """Whether no land lies before the vessel on its way to a corner; only home may lie outside the survey."""
        if home:
            return is_free_of_land(here_m, corner_m, self.water)
        return self.water.approach_is_clear(here_m, corner_m)

    def _is_free(self, here: FloatArray, corner: FloatArray) -> bool:
        """Whether the vessel may sail straight to a corner; from within the stand-off only land can forbid it."""
        if self.water.is_navigable(here)[0]:
            return self.water.leg_is_clear(here, corner)
        return self.water.approach_is_clear(here, corner)

    def _restrict(self, restrictions: Restrictions) -> bool:
        if restrictions == self.restrictions:
            return False
        self.restrictions, self.problem = restrictions, None
        try:
            restricted(self._survey, restrictions)
        except SurveyError as error:
            self.problem = str(error)
        return True

    def _region(self, zone: Zone) -> Region:
        corners = self._survey.frame.to_local(*np.transpose(zone.corners_deg)).reshape(-1, 2)
        return Region(tuple((float(x), float(y)) for x, y in corners), zone.radius_m)
