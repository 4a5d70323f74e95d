"""What would happen if a boat that is not ours now were given back by AUTO: the way to its waypoint may not be free.

Whoever has taken the boat may bring it anywhere: behind an island, out of the fence. AUTO then sails straight to the
waypoint at which the mission was left. What is on board is read as soon as AUTO is back, and the mission sent round
the land: within two seconds on a good link, in which the boat sails some metres. On a link that loses every third
message it takes up to half a minute, so the operator is told before he selects AUTO.
"""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.effects import Level
from autonomy.helm import Helm
from autonomy.mavlink.authority_table import Command
from autonomy.mavlink.rover import AUTO
from autonomy.reporting import Reporter
from autonomy.seaway import Seaway, is_free_of_land

WATCH_S = 1.0
"""How often the way is looked at."""

REMIND_S = 300.0
"""It is told once, and once more if the way was free in between, but no sooner: along a coast that comes and goes."""


class Handback:
    """See the module's description. It looks at helm, seaway and reporter, which belong to the core."""

    def __init__(self, helm: Helm, seaway: Seaway, reporter: Reporter) -> None:
        self._helm, self._seaway, self._reporter = helm, seaway, reporter
        self._due = self._quiet_until = 0.0
        self.trouble: str | None = None
        """What lies in the way, for health; None if nothing does."""

    def watch(self, now: float) -> str | None:
        """Look at the way the boat would sail in AUTO; returns what to tell the operator of it, if that is new."""
        if now < self._due:
            return None
        self._due = now + WATCH_S
        was_free, number = self.trouble is None, self._resumed()
        if number is None or self._is_free(number):
            self.trouble = None
            return None
        self.trouble = f"land or the fence lies before waypoint {number}: AUTO would sail there straight"
        if not was_free or now < self._quiet_until:
            return None
        self._quiet_until = now + REMIND_S
        self._reporter.log(Level.WARNING, self.trouble)
        return f"LAND before waypoint {number}: no AUTO here"

    def _resumed(self) -> int | None:
        """The waypoint of ours that AUTO would make for; None if it is none of ours, or AUTO is far."""
        helm, vehicle, active = self._helm, self._helm.state, self._helm.dispatch.active
        if (
            vehicle is None
            or active is None
            or not helm.headway.is_sure
            or not vehicle.armed
            or vehicle.mode == AUTO
        ):
            return None
        if helm.authority.command not in (Command.YIELDED, Command.HELD):
            return None
        if not helm.dispatch.may_be_on_board(vehicle):
            return None
        # A mission that is complete begins anew.
        is_complete = vehicle.mission_state == mavlink.MISSION_STATE_COMPLETE
        number = 1 if is_complete else max(1, vehicle.mission_current or 1)
        return number if number <= len(active.items) else None

    def _is_free(self, number: int) -> bool:
        here_m, active = self._helm.headway.position_m, self._helm.dispatch.active
        assert here_m is not None
        assert active is not None
        return is_free_of_land(here_m, active.plan.route_m[number - 1], self._seaway.water)
