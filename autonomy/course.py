"""The vessel's course: what is left of the plan it sails, where a new one begins, how the two are joined.

A plan takes time to make and to bring on board, and the vessel sails on meanwhile. So a new plan begins at the
departure: where the vessel will be by then, as far along its present route as the last plans took. What it sails until
there is frozen, and what comes after is the remainder, which the new plan replaces if it is worth it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from autonomy.config import Configuration
from autonomy.dispatch import Dispatched
from autonomy.effects import Level
from autonomy.exploration import Trigger
from autonomy.geometry import FloatArray, advance_along
from autonomy.helm import Helm
from autonomy.planning.passage import Unreachable
from autonomy.planning.plan import Plan
from autonomy.reporting import Reporter
from autonomy.seaway import Seaway, is_free_of_land

LEG = "leg"
"""The planner of a plan that is nothing but the leg being sailed."""

LEG_WATCH_S = 0.2
"""How often the leg being sailed is held against the land; a check takes microseconds."""

LEG_ALARM_S = 30.0
"""Pause between two alarms about land before the vessel that can't be sailed round."""

START_WATCH_S = 1.0
"""How often the way to the first waypoint of a mission that waits for its start is held against the land."""

START_MOVED_M = 50.0
"""A boat this far from where that mission was made to begin may need another; one on its trailer does not."""

STRETCH_LEAD_S = 120.0
"""The next stretch of a long route is sent when the present one is sailed to its end in this time."""

STRETCH_LEAD_ITEMS = 2
"""Or when no more waypoints than this are left of it."""

STRETCH_RETRY_S = 30.0
"""Pause before a stretch that did not come on board is sent again."""

_FIRST_PLANNING_S = 1.0
_FIRST_UPLOAD_S = 0.3
_LONGEST_UPLOAD_S = 30.0

_FOR_GAIN = frozenset({Trigger.NOVELTY, Trigger.OUTGROWN, Trigger.MAXIMUM_INTERVAL, Trigger.SAILED})
"""Reasons to plan anew that leave the present plan as good as it was: only a better one is worth a change of course."""


@dataclass(frozen=True, eq=False)
class Departure:
    """Where a new plan begins, and what it would replace.

    Attributes:
        start_m: shape (2,).
        remainder_m: shape (k, 2), corners of the present plan that come after it, the way home apart.
        remainder_is_spot: shape (k,).
        mission: what is sailed until then; None if it is none of ours.
        row: the corner of its plan that the start lies before.
    """

    start_m: FloatArray
    remainder_m: FloatArray
    remainder_is_spot: NDArray[np.bool_]
    mission: Dispatched | None
    row: int


@dataclass(frozen=True)
class Alarm:
    """What the operator must hear of the way ahead, in few words."""

    text: str
    is_critical: bool


class Course:
    """See the module's description. It looks at helm, seaway and reporter, which belong to the core."""

    def __init__(self, configuration: Configuration, helm: Helm, seaway: Seaway, reporter: Reporter) -> None:
        self._minimum_gain = configuration.planning.minimum_gain
        self._helm = helm
        self._headway = helm.headway
        self._seaway = seaway
        self._reporter = reporter
        self._planning_s: dict[bool, float] = {}
        self._upload_s = _FIRST_UPLOAD_S
        self._offered: tuple[float, Plan] | None = None
        self._departure: Departure | None = None
        self._begun_at_m = 0.0
        self._longest_m = 0.0
        self._leg_watch_due = 0.0
        self._stretch_due = 0.0
        self._start_watch_due = 0.0
        self.trouble: str | None = None
        """What lies before the vessel, for health; None if nothing does."""

    def begin(self, *, reestimates: bool) -> Departure:
        """A plan is going to be made now, after a re-estimate or without: where it begins.

        Raises:
            RuntimeError: the vessel's position is not known yet.
        """
        guess_s = max(self._planning_s.values(), default=_FIRST_PLANNING_S)
        delay_s = self._planning_s.get(reestimates, guess_s) + self._upload_s
        self._departure = self._departure_after(self._headway.reach_m(delay_s))
        self._begun_at_m = self._headway.distance_m
        return self._departure

    def took(self, duration_s: float, *, reestimated: bool) -> None:
        """The plan is ready, so many seconds of protocol time after `begin`."""
        usual_s = self._planning_s.get(reestimated, duration_s)
        self._planning_s[reestimated] = usual_s + 0.5 * (duration_s - usual_s)

    @property
    def sailed_share(self) -> float:
        """What was sailed since the last plan was begun, as a share of the longest plan so far."""
        return (self._headway.distance_m - self._begun_at_m) / self._longest_m if self._longest_m else 0.0

    def keeps(self, plan: Plan, trigger: Trigger) -> bool:
        """Whether the present plan is as good as the new one but for a small gain; says so."""
        before, after, departure = plan.objective_before, plan.objective_after, self._departure
        if before is None or after is None or trigger not in _FOR_GAIN or departure is None:
            return False
        if not self._is_sailed(departure) or not len(departure.remainder_m) or self._headway.path_finished:
            return False
        gain = (before - after) / abs(before) if before else float(before > after)
        if gain >= self._minimum_gain or not self._seaway.is_open(departure.remainder_m):
            return False
        gained = f"{100.0 * max(0.0, gain):.1f} %"
        self._reporter.log(Level.INFO, f"the course is kept ({plan.reason}): a new plan would gain {gained}")
        return True

    def joined(self, plan: Plan) -> Plan:
        """The plan from where the vessel is now, the frozen part before it.

        Raises:
            Unreachable: there is no way over water to the plan's first corner.
        """
        here_m, kept_m, is_spot = self._headway.position_m, *self._frozen()
        if here_m is not None and len(kept_m):
            route_m = np.vstack([kept_m, plan.start_m, plan.route_m])
            marks = np.concatenate([is_spot, [False], plan.is_spot])
            if self._seaway.is_open(route_m, ends_home=plan.home_corners > 0):
                plan = replace(plan, start_m=here_m, route_m=route_m, is_spot=marks)
        return self._seaway.joined(plan, here_m)

    def offer(self, now: float, plan: Plan) -> None:
        """Make this plan the next to bring on board."""
        self._offered = (now, plan)
        self._longest_m = max(self._longest_m, plan.length_m)
        self._helm.offer(plan)

    def leg(self, reason: str) -> Plan | None:
        """The leg being sailed alone, to be sailed in place of the plan; None if nothing comes after it anyway."""
        rest = self._rest()
        if rest is None or self._headway.path_finished or len(rest.route_m) < 2:
            return None
        return replace(
            rest,
            route_m=rest.route_m[:1],
            is_spot=rest.is_spot[:1],
            home_corners=0,
            planner=LEG,
            reason=reason,
            # What the whole plan promised is not what this promises.
            mutual_information=math.nan,
            objective_before=None,
            objective_after=None,
            expected_rmse=None,
            rejected=(),
        )

    def watch(self, now: float) -> Alarm | None:
        """A mission is sailed from wherever the vessel is when it takes it up: see that no land lies in between.

        The leg from where it is to the waypoint that the autopilot names is none of the plan's when a mission is begun
        anew, or taken up again elsewhere. Returns what to tell the operator of it, when it is not clear.

        And a long one is sent in stretches: see that the next comes in time.
        """
        self._time_upload(now)
        if not self._headway.sailing_ours:
            self.trouble = None
        if not self._headway.sailing_ours or self._helm.dispatch.busy or now < self._leg_watch_due:
            return None
        self._leg_watch_due = now + LEG_WATCH_S
        rest, route_m = self._rest(), self._headway.remaining_route_m()
        if rest is None or len(route_m) < 2:
            self.trouble = None
            return None
        is_last = len(route_m) == 2 and rest.home_corners > 0
        if self._seaway.may_sail(route_m[0], route_m[1], home=is_last):
            self.trouble = None
            if now >= self._stretch_due and self._stretch_ends():
                self._stretch_due = now + STRETCH_RETRY_S
                self._reporter.log(Level.INFO, f"the next stretch: {len(rest.route_m)} corners are left")
                self.offer(now, rest)
            return None
        is_free = is_free_of_land(route_m[0], route_m[1], self._seaway.water)
        return self._go_round(now, self._without_closed(rest), is_free=is_free)

    def begins_across_land(self, now: float) -> bool:
        """Whether the mission on board, which waits for its start, begins across land from where the boat has gone."""
        active, here_m = self._helm.dispatch.active, self._headway.position_m
        if active is None or here_m is None or now < self._start_watch_due:
            return False
        self._start_watch_due = now + START_WATCH_S
        moved_m = float(np.hypot(*(here_m - active.plan.start_m)))
        return moved_m > START_MOVED_M and not is_free_of_land(
            here_m, active.plan.route_m[0], self._seaway.water
        )

    def _go_round(self, now: float, rest: Plan, *, is_free: bool) -> Alarm | None:
        """Bring the rest of the plan on board with another way to its first corner.

        Where the leg is free of land only the water there is closed, after a stall perhaps: that is no danger.
        """
        if not len(rest.route_m):
            return None  # another plan is being made
        try:
            self.offer(now, self._seaway.joined(rest, self._headway.position_m))
        except Unreachable as error:
            self._leg_watch_due = now + LEG_ALARM_S
            text = f"land lies before the vessel, and there is no way round: {error}"
            self._reporter.log(Level.ERROR, text)
            alarm = Alarm("LAND ahead, no way round it", is_critical=True)
        else:
            text = "land lies before the vessel: the mission goes round it"
            self._reporter.log(Level.WARNING, text)
            alarm = Alarm("land ahead, goes round it", is_critical=False)
        if is_free:
            return None
        self.trouble = text
        return alarm

    def _departure_after(self, reach_m: float) -> Departure:
        """After sailing on for so many metres."""
        route_m = self._headway.remaining_route_m()
        if self._headway.path_finished or len(route_m) < 2:
            rest = None if self._headway.path_finished else self._rest()
            corners_m = np.empty((0, 2)) if rest is None else rest.route_m[: rest.survey_corners]
            spots = np.empty(0, dtype=bool) if rest is None else rest.is_spot[: rest.survey_corners]
            return self._within_water(Departure(route_m[0], corners_m, spots, None, 0))
        mission = self._helm.dispatch.active
        assert mission is not None
        legs = np.diff(route_m, axis=0)
        ends_m = np.cumsum(np.hypot(legs[:, 0], legs[:, 1]))
        row = len(mission.plan.route_m) - len(legs) + int(np.searchsorted(ends_m, reach_m))
        start_m, survey = advance_along(route_m, reach_m), slice(row, mission.plan.survey_corners)
        remainder_m, is_spot = mission.plan.route_m[survey], mission.plan.is_spot[survey]
        return self._within_water(Departure(start_m, remainder_m, is_spot, mission, row))

    def _within_water(self, departure: Departure) -> Departure:
        """Without corners in water that has been closed since they were planned."""
        if not len(departure.remainder_m):
            return departure
        stays = self._seaway.water.is_navigable(departure.remainder_m)
        return replace(
            departure,
            remainder_m=departure.remainder_m[stays],
            remainder_is_spot=np.asarray(departure.remainder_is_spot, dtype=bool)[stays],
        )

    def _without_closed(self, rest: Plan) -> Plan:
        """A plan without corners of the survey in water that has been closed since it was made."""
        stays = self._seaway.water.is_navigable(rest.route_m)
        stays[rest.survey_corners :] = True
        return replace(rest, route_m=rest.route_m[stays], is_spot=np.asarray(rest.is_spot, dtype=bool)[stays])

    def _is_sailed(self, departure: Departure) -> bool:
        """Whether the vessel still sails what it sailed when the plan was begun."""
        mission = departure.mission
        return mission is not None and mission is self._helm.dispatch.active and self._headway.sailing_ours

    def _frozen(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Corners of the frozen part that still lie before the vessel, and which are spots.

        One that it will have passed before the new plan is on board is none of them: it would be sailed back to.
        """
        departure = self._departure
        if departure is None or departure.mission is None or not self._is_sailed(departure):
            return np.empty((0, 2)), np.empty(0, dtype=bool)
        plan = departure.mission.plan
        route_m = self._headway.remaining_route_m()
        first = len(plan.route_m) - len(route_m) + 1
        legs = np.diff(route_m, axis=0)
        passed_m = self._headway.reach_m(self._upload_s) + self._headway.acceptance_radius_m
        first += int(np.searchsorted(np.cumsum(np.hypot(legs[:, 0], legs[:, 1])), passed_m))
        rows = slice(first, max(first, departure.row))
        return plan.route_m[rows], np.asarray(plan.is_spot[rows], dtype=bool)

    def _rest(self) -> Plan | None:
        """What is left of the active plan, from the corner on that the vessel makes for; None if there is none."""
        active, here_m = self._helm.dispatch.active, self._headway.position_m
        if active is None or here_m is None:
            return None
        row = self._headway.next_row
        return replace(
            active.plan, start_m=here_m, route_m=active.plan.route_m[row:], is_spot=active.plan.is_spot[row:]
        )

    def _stretch_ends(self) -> bool:
        """Whether the mission on board ends before its plan does, and soon."""
        active = self._helm.dispatch.active
        if active is None or active.is_whole:
            return False
        left = len(active.items) - self._headway.next_row
        corners_m = self._headway.remaining_route_m()[: left + 1]
        left_m = float(np.hypot(*np.diff(corners_m, axis=0).T).sum())
        return left <= STRETCH_LEAD_ITEMS or left_m <= STRETCH_LEAD_S * self._headway.pace_mps

    def _time_upload(self, now: float) -> None:
        """How long it takes to bring a plan on board."""
        active = self._helm.dispatch.active
        if self._offered is None or active is None or active.plan is not self._offered[1]:
            return
        took_s = min(_LONGEST_UPLOAD_S, now - self._offered[0])
        self._upload_s += 0.5 * (took_s - self._upload_s)
        self._offered = None
