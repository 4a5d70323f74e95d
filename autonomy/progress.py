"""How far the mission on board has been sailed, by what the autopilot says of it."""

from pymavlink.dialects.v20 import ardupilotmega as mavlink

WITNESSES = 2
"""So many MISSION_CURRENT in a row must agree: a single one may be a straggler of the mission before."""


class Progress:
    """Which waypoint has been reached, and whether the mission is complete.

    Theory of operation. MISSION_ITEM_REACHED comes once and counts at once if the autopilot has named that item,
    or a later one, as its present one. A number beyond it may belong to the mission that was on board before, or
    the MISSION_CURRENT in between was lost: it waits until two MISSION_CURRENT in a row say which.

    A mission may also be sailed again from an earlier waypoint: after a reboot, when AUTO is selected with
    MIS_RESTART 1, or because the operator says so. Then what had been reached lies before the boat again.
    """

    def __init__(self) -> None:
        self._mission: object = None
        self._pending = 0
        self._agreeing = 0
        self._differing = 0
        self._complete = 0
        self._behind = 0

    @property
    def is_complete(self) -> bool:
        """Whether the autopilot says that the mission has been sailed to its end."""
        return self._complete >= WITNESSES

    def begin(self, mission: object) -> None:
        """This is the mission on board; what was pending of another one is void."""
        if mission is not self._mission:
            self._mission, self._pending, self._behind = mission, 0, 0

    def reached(self, seq: int, current: int) -> int:
        """Take in a MISSION_ITEM_REACHED; returns the waypoint that has been reached for certain, or 0."""
        if seq <= current:
            return seq
        self._pending, self._agreeing, self._differing = max(seq, self._pending), 0, 0
        return 0

    def told(self, current: int, mission_state: int) -> int:
        """Take in a MISSION_CURRENT; returns the waypoint that has been reached for certain, or 0."""
        is_complete = mission_state == mavlink.MISSION_STATE_COMPLETE
        self._complete = self._complete + 1 if is_complete else 0
        if not self._pending:
            return 0
        agrees = current >= self._pending
        self._agreeing = self._agreeing + 1 if agrees else 0
        self._differing = 0 if agrees else self._differing + 1
        if max(self._agreeing, self._differing) < WITNESSES:
            return 0
        reached, self._pending = self._pending, 0
        return reached if agrees else 0

    def goes_back(self, current: int, reached: int, last: int) -> bool:
        """Take in a MISSION_CURRENT; whether a waypoint that counted as reached is made for again.

        The one just reached is named for a moment yet, and the `last` one for good: only the former, named twice, is
        sailed to again.
        """
        is_under_way = not self._complete and current > 0
        self._behind = self._behind + 1 if is_under_way and current == reached < last else 0
        return is_under_way and (current < reached or self._behind >= WITNESSES)
