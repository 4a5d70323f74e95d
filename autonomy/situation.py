"""What the service is doing and why, and what of the vehicle and its probe can be relied on now."""

import math
from enum import Enum

from autonomy.effects import Level
from autonomy.helm import STALE_POSITION_S, Helm
from autonomy.homeward import Homeward
from autonomy.mavlink.authority import OnBoard
from autonomy.mavlink.authority_table import Command
from autonomy.reporting import Reporter
from autonomy.seaway import Seaway

SAY_AGAIN_S = 20.0
"""A boat that changes hands and back all the time (a failsafe that flaps) is told of in the same words no sooner."""

SILENT_SENSOR_S = 30.0
"""A survey without readings for this long is told to be one, and sails its plan to the end, and no other."""


class State(Enum):
    """What the service is doing; the value is how it is said to a person."""

    WAITING_FOR_VEHICLE = "waiting for vehicle"
    EXPLORING = "exploring"
    YIELDED = "yielded"
    RETURNING = "returning"
    FINISHED = "finished"
    OBSERVING = "observing"
    PAUSED = "paused"


class Wish(Enum):
    """What people ashore have asked for and what lasts; the value is how it is said to a person."""

    PAUSE = "paused from ashore"
    FINISH = "the last path, as was asked for from ashore"
    RETURN = "sent home from ashore"


_STATES = {
    Command.BEFORE_START: State.WAITING_FOR_VEHICLE,
    Command.DISPLACED: State.YIELDED,
    Command.YIELDED: State.YIELDED,
    Command.SENT_HOME: State.RETURNING,
    Command.RETURNING: State.RETURNING,
    Command.STOPPING: State.PAUSED,
    Command.HELD: State.PAUSED,
    Command.OBSERVED: State.OBSERVING,
}


class Situation:
    """Follows helm, seaway and homeward, which belong to the core, as does the reporter that is told of changes.

    Args:
        message_name: the probe's, for a person who misses its readings.
    """

    def __init__(
        self, helm: Helm, seaway: Seaway, homeward: Homeward, reporter: Reporter, message_name: str
    ) -> None:
        self._helm, self._seaway, self._homeward = helm, seaway, homeward
        self._reporter = reporter
        self._message_name = message_name
        self._in_touch_since = math.inf
        self._heard_reading = -math.inf
        self._since = math.inf
        self._told: tuple[str, float] | None = None
        self.state = State.WAITING_FOR_VEHICLE
        self.reason = "nothing heard from the autopilot yet"
        self.in_touch = False
        """Whether the autopilot is heard."""
        self.may_upload = False
        """Whether a plan may be brought on board."""
        self.wish: Wish | None = None
        """What people ashore have asked for; while there is any, nothing is planned."""

    def heard_reading(self, now: float) -> None:
        """The probe has said a number."""
        self._heard_reading = now

    def look(self, now: float) -> str | None:
        """Take in what has changed, and log it; returns why the vehicle is no longer ours to send, if that is new."""
        was_in_touch, self.in_touch = self.in_touch, self._helm.is_heard(now)
        if self.in_touch and not was_in_touch:
            self._in_touch_since = now
        before, self.state, reason = self.state, *self._judged(now)
        if (before, self.reason) != (self.state, reason):
            self._reporter.log(Level.INFO, f"{self.state.value}: {reason}")
        self.reason = reason
        if before is self.state:
            return None
        self._since = now
        if self.state not in (State.YIELDED, State.RETURNING):
            return None
        if self._told is not None and self._told[0] == reason and now < self._told[1] + SAY_AGAIN_S:
            return None
        self._told = (reason, now)
        return reason

    @property
    def wants_plans(self) -> bool:
        """Whether a plan that is ready now may still be brought on board, or may be once the mission there is read."""
        if self.state is State.YIELDED or not self.in_touch or self.wish is not None:
            return False
        return self.may_upload or self._helm.authority.on_board is OnBoard.UNREAD

    def is_lost(self, now: float) -> bool:
        """Whether nobody knows where the vessel is."""
        heard = max(self._helm.telemetry.position_heard, self._in_touch_since)
        return self.in_touch and now - heard > STALE_POSITION_S

    def is_deaf(self, now: float) -> bool:
        """Whether the survey has been without readings for long."""
        return now - max(self._heard_reading, self._since) > SILENT_SENSOR_S

    def _judged(self, now: float) -> tuple[State, str]:
        vehicle, authority = self._helm.state, self._helm.authority
        self.may_upload = False
        if vehicle is None:
            return State.WAITING_FOR_VEHICLE, "nothing heard from the autopilot yet"
        if not self.in_touch:
            return State.WAITING_FOR_VEHICLE, "the autopilot has fallen silent"
        permission = self._helm.dispatch.permission(vehicle)
        self.may_upload = permission.allowed
        reason = authority.reason if permission.allowed else permission.reason
        if permission.allowed:
            hindrance = self._helm.unread or self._seaway.problem
            if self.is_lost(now):
                hindrance = "it does not tell its position"
            reason += "" if hindrance is None else f", but {hindrance}"
        if authority.command is not Command.OURS:
            return _STATES[authority.command], reason
        if self._homeward.is_finished:
            return State.FINISHED, self._homeward.reason
        if self._homeward.is_returning:
            return State.RETURNING, self._homeward.reason or "the way home is what is left of the budget"
        if self.wish is Wish.PAUSE:
            sails = (
                ""
                if self._helm.headway.path_finished
                else ": the boat sails its leg to the end, and stays there"
            )
            return State.PAUSED, f"{Wish.PAUSE.value}{sails}"
        if self.wish is Wish.FINISH:
            reason += f", {Wish.FINISH.value}"
        if self.is_deaf(now) and not self.is_lost(now):
            reason += f", but no reading named {self._message_name} comes in"
        return State.EXPLORING, reason
