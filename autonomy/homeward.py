"""Keeps the way home affordable: cuts plans to the budget, and turns the vessel homeward when it is time.

Theory of operation. The way home from anywhere leads over water, and is priced leg by leg with what has been learnt
of speed and consumption, with and against the current. With m for `budget.home_margin`, and u for what may still be
spent:

    a plan is cut    at the last point from where the way home, (m + 0.03) times, stays within u; the way home follows
    a leg is begun   only if afterwards m times the way home is within u; else the rest of the plan is cut anew
    low              (m + 1) / 2 times the way home from here is not within u: home at once, and no more plans
    critical         the way home from here is not within u: it eats the reserve

A vessel that turns home with much more left than it needs (its guess was wrong) gets another plan.

People ashore may send it home as well, with a budget or without.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from autonomy.budget import Budget, Reading, Stage
from autonomy.config import Configuration
from autonomy.geometry import FloatArray, path_length_m
from autonomy.notes import Note
from autonomy.planning.passage import Unreachable, passage_of
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.seaway import is_free_of_land

NAME = "home"
"""The planner of the plans that are nothing but the way home."""

CUT_MARGIN = 0.03
"""Plans are cut with so much more margin than legs are begun with, or the least noise would cut them anew."""

DETOUR = 1.02
"""A boat sails somewhat more than the legs of its plan."""

HALVINGS = 8
"""Of the leg on which a plan is cut."""

LOOK_AHEAD_S = 30.0
"""The next leg is checked when the one being sailed ends in this model time: another mission must get on board."""

CHECK_S = 2.0
"""Model time between two looks at the way home."""

NEAR, NEAR_M = 0.1, 30.0
"""Share of the way home, or metres, that the vessel may move on before the way is sought anew."""

ENOUGH_ROOM = 0.04
"""Share of the scarcest limit that, spare on the way home, is worth another plan."""


SHORTEST_M = 20.0
"""A piece of a leg shorter than this is not worth a waypoint."""


@dataclass(frozen=True, eq=False)
class Sailing:
    """The mission being sailed: `route_m`, shape (k, 2), from the vessel along what is left of `plan`.

    Of a damaged one nobody knows how much of a plan is on board, nor of which.
    """

    plan: Plan
    route_m: FloatArray
    is_finished: bool
    is_damaged: bool = False

    @property
    def corners(self) -> int:
        """How many of the corners ahead belong to the survey, not to the way home."""
        return max(0, len(self.route_m) - 1 - self.plan.home_corners)

    @property
    def is_homeward(self) -> bool:
        """Whether nothing but the way home is left of it."""
        return self.plan.home_corners > 0 and self.corners == 0


class Homeward:
    """See the module's description. It decides; the core brings its plans on board."""

    def __init__(self, configuration: Configuration, survey: SurveyArea) -> None:
        section = configuration.budget
        self._section = section
        self._shortest_m = max(SHORTEST_M, 2.0 * (configuration.mavlink.acceptance_radius_m or 0.0))
        self._fixed_m = None if section.home is None else survey.frame.to_local(*section.home)
        self._told_m: FloatArray | None = None
        self._begun_m: FloatArray | None = None
        self._due_s = 0.0
        self._checked: tuple[float, float] | None = None
        self._way: FloatArray | None = None
        self._turned_m = 0.0
        self._ended: Plan | None = None
        self._disarmed = False
        self._order = ""
        self._said: set[str] = set()
        self._notes: list[Note] = []
        self.budget = Budget(section)
        self.stage = Stage.FINE
        self.reason = ""
        """Why the vessel goes home, and no more plans are made; empty while it need not."""
        self.has_room = False
        """Whether the vessel is on its way home with so much left that another plan is worth making."""
        self.is_returning = False
        """Whether nothing but the way home is being sailed."""
        self.may_be_sent_home = False
        """Whether the autopilot may bring it home by itself: it is critical, and the straight way is free."""
        self.is_finished = False
        """Whether the survey has ended at home."""

    @property
    def is_limited(self) -> bool:
        """Whether there is any budget to mind."""
        return self.budget.is_limited

    @property
    def is_minded(self) -> bool:
        """Whether the way home matters at all: there is a budget, or the vessel was sent home."""
        return self.is_limited or bool(self._order)

    @property
    def is_sent(self) -> bool:
        """Whether the vessel goes home for no other reason than that it was sent."""
        return bool(self._order) and self.reason == self._order

    @property
    def knows_home(self) -> bool:
        """Whether there is any place to go home to."""
        return any(home is not None for home in (self._fixed_m, self._told_m, self._begun_m))

    def take_notes(self) -> list[Note]:
        """What happened since the last call, for the log."""
        notes, self._notes = self._notes, []
        return notes

    def begins_at(self, point_m: FloatArray) -> None:
        """Without a budget nothing is counted, but where the survey began, shape (2,), is kept."""
        if self._begun_m is None and not self.is_limited:
            self._begun_m = point_m

    def send(self, reason: str) -> None:
        """Home at once, for a reason of somebody ashore; no more plans."""
        self._order, self._due_s = reason, 0.0
        self.reason, self.is_returning = self.reason or reason, True

    def call_off(self) -> None:
        """Whoever sent the vessel home does not want it any more; the budget may."""
        if self.reason == self._order:
            self.reason, self.is_returning = "", False
        self._order = ""

    def told_home(self, home_m: FloatArray | None) -> None:
        """Where the autopilot's home is, shape (2,)."""
        self._told_m = home_m

    def follow(self, reading: Reading, *, armed: bool, commanded: bool) -> None:
        """Take in what the vehicle tells: the counting begins when the survey does, `commanded` and armed.

        After a survey has ended at home, and the boat was disarmed, another one begins with a budget of its own.
        """
        self.budget.follow(reading)
        self._disarmed = self._disarmed or (self.is_finished and not armed)
        if not (armed and commanded):
            return
        if self.is_finished and self._disarmed:
            self.is_finished = self._disarmed = self.has_room = self.is_returning = self.may_be_sent_home = (
                False
            )
            self.stage, self.reason, self._order, self._begun_m = Stage.FINE, "", "", None
        if self._begun_m is None:
            self._begun_m = reading.point_m
            self.budget.begin()
            if self.is_limited:
                self._note(
                    f"the budget: {self.budget.said() or 'the charge of the battery'}, the way home included"
                )

    def home_m(self, here_m: FloatArray) -> FloatArray:
        """Where home is for a vessel at a point, shape (2,): configured, told by the autopilot, or where it began."""
        for home in (self._fixed_m, self._told_m, self._begun_m):
            if home is not None:
                return home
        return here_m

    def way(self, here_m: FloatArray, water: SurveyArea) -> FloatArray:
        """The way home over water from a point, shape (k, 2), both ends included.

        A home that no way over water leads to (on a slip, say) is taken for the nearest place that one leads to.

        Raises:
            Unreachable: no water at all can be reached from there.
        """
        passage, home = passage_of(water), self.home_m(here_m)
        if not water.is_navigable(np.stack([here_m, home])).any() and is_free_of_land(here_m, home, water):
            return np.stack([here_m, home])  # both in a harbour, say, outside the survey's area
        try:
            return passage.path(here_m, home)
        except Unreachable:
            centres = passage.raster.centres_m
            centres = centres[passage.reachable(here_m, centres)]
            if not len(centres):
                raise
        self._note_once(
            "no way over water leads home: the survey ends at the nearest place that one leads to"
        )
        return passage.path(here_m, centres[np.argmin(np.hypot(*(centres - home).T))])

    def plan(self, here_m: FloatArray, water: SurveyArea, reason: str) -> Plan:
        """The way home from a point as a plan. Raises Unreachable."""
        corners = self.way(here_m, water)[1:]
        is_spot = np.zeros(len(corners), dtype=bool)
        return Plan(here_m, corners, is_spot, 0.0, NAME, reason, home_corners=len(corners))

    def fitted(self, plan: Plan, here_m: FloatArray | None, water: SurveyArea) -> Plan:
        """The plan, sailed from a point, as far as the budget allows; the way home follows where it is cut.

        Raises:
            Unreachable: there is no way home.
        """
        if not self.is_limited:
            return plan
        here_m = plan.start_m if here_m is None else here_m
        corners = np.concatenate([here_m.reshape(1, 2), plan.route_m[: plan.survey_corners]])
        spent = np.cumsum(np.concatenate([np.zeros((1, 3)), self.budget.costs(corners)]), axis=0)
        k = next((k for k in range(1, len(corners)) if not self._pays(spent[k], corners[k], water)), None)
        if k is None:
            return plan
        cut = self._cut(plan, corners, spent, k, water)
        if not cut.survey_corners and not self.reason:
            self.reason = "what may still be spent is not enough for another leg"
        return cut

    def watch(self, time_s: float, sailing: Sailing, water: SurveyArea, speed_mps: float) -> Plan | None:
        """A plan to bring on board instead of the mission being sailed, if the budget asks for one.

        Raises:
            Unreachable: there is no way home.
        """
        if self.is_finished or not (self._order or (self.is_limited and self.budget.has_begun)):
            return None
        if sailing.plan is self._ended:
            return None  # of the survey before this one
        if sailing.is_damaged:
            return self.plan(sailing.route_m[0], water, self.reason) if self.reason else None
        if sailing.is_finished and sailing.plan.home_corners:
            self.is_finished, self.has_room, self._ended = True, False, sailing.plan
            self.reason = self.reason or "the budget is sailed"
            left = f"{self.budget.said() or 'the battery'} left beside the reserve"
            self._note(f"home: {left}" if self.is_limited else "home")
            return None
        if time_s < self._due_s:
            return None
        self._due_s = time_s + CHECK_S
        here_m = sailing.route_m[0]
        way = self._judged(here_m, water)
        was_returning, self.is_returning = self.is_returning, sailing.is_homeward or bool(self.reason)
        self.may_be_sent_home = (
            self.stage is Stage.CRITICAL and self._fixed_m is None and is_free_of_land(here_m, way[-1], water)
        )
        if self.reason:
            return None if sailing.is_homeward else self.plan(here_m, water, self.reason)
        if sailing.is_homeward and not was_returning:
            self._turned_m = path_length_m(way)
        self.has_room = sailing.is_homeward and self._room(way) > ENOUGH_ROOM
        return self._next_leg(sailing, water, speed_mps)

    def bounds(
        self, here_m: FloatArray | None, start_m: FloatArray, water: SurveyArea
    ) -> tuple[float | None, FloatArray | None]:
        """For a planner: metres that may be sailed from a plan's start on, and where it must be able to end, (2,).

        None and None where there is no limit by the metre, or no way home.
        """
        metres = self.budget.metres()
        if not math.isfinite(metres):
            return None, None
        try:
            way = self.way(start_m, water)
        except Unreachable as error:
            self.cannot(str(error))
            return metres, None
        ahead_m = 0.0 if here_m is None else float(np.hypot(*(start_m - here_m)))
        margin_m = (self._section.home_margin + CUT_MARGIN - 1.0) * path_length_m(way)
        return max(0.0, (metres - ahead_m - margin_m) / DETOUR), way[-1]

    def give_up(self) -> None:
        """The path is sailed, and no planner knows another: what is left is for the way home."""
        if self.is_limited and self.budget.has_begun:
            self.reason = self.reason or "no plan could be made for what may still be spent"

    def cannot(self, problem: str) -> None:
        """There is no way home: said once."""
        self._note_once(f"the way home is not known: {problem}")

    def _judged(self, here_m: FloatArray, water: SurveyArea) -> FloatArray:
        """The way home from where the vessel is, having judged how urgent it is.

        While nothing changes, it leads by way of where it was last sought, which is hardly longer as long as that is
        near: to seek it takes some milliseconds.
        """
        if self._way is not None:
            back_m = float(np.hypot(*(self._way[0] - here_m)))
            way = np.vstack([here_m, self._way])
            is_near = back_m <= max(NEAR_M, NEAR * path_length_m(self._way))
            if is_near and self.budget.stage(way)[0] <= self.stage:
                return way
        self._way = self.way(here_m, water)
        stage, why = self.budget.stage(self._way)
        if stage > self.stage:
            self.stage, self.has_room = stage, False
            self.reason = f"{stage.name.lower()}: {why}"
            self._note(f"the boat goes home: {self.reason}", is_warning=True)
        return self._way

    def _room(self, way: FloatArray) -> float:
        """Share of the scarcest limit that a vessel on its way home has to spare.

        The margin of the part that it has sailed since it turned home is none: it was there to be left over.
        """
        margin = self._section.home_margin + CUT_MARGIN - 1.0
        return self.budget.room(way, 1.0 + margin * self._turned_m / max(path_length_m(way), 1.0))

    def _next_leg(self, sailing: Sailing, water: SurveyArea, speed_mps: float) -> Plan | None:
        """Before a leg is begun: whether the way home from its end could be paid; the plan that is cut if not."""
        if sailing.corners < 2:
            return None
        ahead = sailing.route_m[:3]
        here, corner = ahead[0], ahead[1]
        near_m = max(LOOK_AHEAD_S * speed_mps, self._shortest_m)
        checked = (float(corner[0]), float(corner[1]))
        if float(np.hypot(*(corner - here))) > near_m or checked == self._checked:
            return None
        self._checked = checked
        if self._pays(self.budget.cost(ahead), ahead[2], water, self._section.home_margin):
            return None
        plan, kept = sailing.plan, len(sailing.route_m) - 1
        rest = replace(plan, start_m=here, route_m=plan.route_m[-kept:], is_spot=plan.is_spot[-kept:])
        return self.fitted(rest, here, water)

    def _pays(
        self, spent: FloatArray, point_m: FloatArray, water: SurveyArea, margin: float | None = None
    ) -> bool:
        """Whether the way home from a point can be paid after so much has been spent."""
        margin = self._section.home_margin + CUT_MARGIN if margin is None else margin
        return self.budget.affords(DETOUR * spent + margin * self.budget.cost(self.way(point_m, water)))

    def _cut(self, plan: Plan, corners: FloatArray, spent: FloatArray, k: int, water: SurveyArea) -> Plan:
        """The plan up to the last point of its k-th leg from where the way home can be paid, and the way home."""
        a, b = corners[k - 1], corners[k]
        low, high = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            point = a + middle * (b - a)
            cost = spent[k - 1] + middle * (spent[k] - spent[k - 1])
            low, high = (middle, high) if self._pays(cost, point, water) else (low, middle)
        kept, is_spot = corners[1:k], plan.is_spot[: k - 1]
        if low * float(np.hypot(*(b - a))) >= self._shortest_m:
            kept, is_spot = np.vstack([kept, a + low * (b - a)]), np.append(is_spot, False)
        way = self.way(kept[-1] if len(kept) else corners[0], water)[1:]
        return replace(
            plan,
            route_m=np.concatenate([kept, way]),
            is_spot=np.concatenate([is_spot, np.zeros(len(way), dtype=bool)]),
            home_corners=len(way),
            # What the whole plan promised is not what is left of it promises.
            mutual_information=math.nan,
            objective_after=None,
            expected_rmse=None,
        )

    def _note(self, text: str, *, is_warning: bool = False) -> None:
        self._notes.append(Note(text, is_warning))

    def _note_once(self, text: str) -> None:
        if text not in self._said:
            self._said.add(text)
            self._note(text, is_warning=True)
