"""Whether the boat sails the mission we believe to be on board, by what its autopilot tells under way."""

import math

ROOM_M = 50.0
"""Places that agree may differ by this: a waypoint counts as reached abeam of it, and clocks and roundings differ."""

ROOM_SHARE = 0.01
"""And by this share of a distance: the autopilot's Earth is a simpler one than ours."""

WITNESSES = 3
"""So many distances in a row must disagree: one is told between a waypoint and its successor's name."""

PAUSE_S = 60.0
"""Between two doubts, in protocol time: one that was wrong would come again with the next message."""

LONGEST_PAUSE_S = 600.0
"""An autopilot whose distances never fit is doubted ever more rarely: the pause doubles until one does."""

_MOST_M = 65535
"""What NAV_CONTROLLER_OUTPUT tells of anything farther away."""


class MissionWitness:
    """Doubts that the mission on board is ours, from what does not fit it.

    Theory of operation. MISSION_CURRENT tells a number and how many items there are, which another mission of the
    same length has too. NAV_CONTROLLER_OUTPUT tells how far it is to where the boat makes for, and
    MISSION_ITEM_REACHED comes at the place of that item: both are held against our item of that number. A doubt costs
    a download, no more; what is read then decides.
    """

    def __init__(self) -> None:
        self._number = 0
        self._is_named = False
        self._against = 0
        self._not_before = -math.inf
        self._pause_s = PAUSE_S

    def reset(self) -> None:
        """The boat does not sail ours: what was doubted is past."""
        self._not_before, self._pause_s = -math.inf, PAUSE_S
        self.rest()

    def rest(self) -> None:
        """There is nothing to judge for the moment: a transfer runs, or the boat makes for no waypoint."""
        self._against, self._is_named = 0, False

    def named(self, number: int) -> None:
        """The autopilot names the item that it makes for."""
        if number != self._number:
            self._number, self._against = number, 0
        self._is_named = True

    def doubts_way(self, now: float, claimed_m: float, distance_m: float, slack_m: float) -> bool:
        """The autopilot is `claimed_m` from where it makes for, and `distance_m` from our item of that number.

        `slack_m` is what the boat may have sailed between the messages. Each claim counts once, with a number that
        was named since the one before. 0 is what those tell that know none, or make for nothing.
        """
        if not self._is_named or claimed_m == 0.0:
            return False
        self._is_named = False
        if abs(claimed_m - min(distance_m, _MOST_M)) <= _room_m(distance_m) + slack_m:
            self._against, self._pause_s = 0, PAUSE_S
            return False
        self._against += 1
        return self._against >= WITNESSES and self._doubts(now)

    def doubts_place(self, now: float, distance_m: float, radius_m: float, slack_m: float) -> bool:
        """An item counts as reached, and the boat is `distance_m` from ours of that number."""
        return distance_m > radius_m + _room_m(0.0) + slack_m and self._doubts(now)

    def _doubts(self, now: float) -> bool:
        if now < self._not_before:
            return False
        self._not_before, self._against = now + self._pause_s, 0
        self._pause_s = min(LONGEST_PAUSE_S, 2.0 * self._pause_s)
        return True


def _room_m(distance_m: float) -> float:
    return ROOM_M + ROOM_SHARE * distance_m
