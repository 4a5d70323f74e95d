"""The mission on board as far as it is known, and what may have got mixed into it."""

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.authority import OnBoard
from autonomy.mavlink.mission_items import Mission, missions_equal
from autonomy.mavlink.vehicle import VehicleState

FIRST_COMPARISON_S = 2.0
"""A length that does not fit is held against what is on board again after this, doubled each time it does not help."""

LONGEST_COMPARISON_S = 600.0
"""It is not doubled beyond this."""

_REMEMBERED_INTERRUPTED = 8

_MANY_MISMATCHES = 20


class Aboard:
    """What was last read or verified to be on board, and the transfers that ended half-way since."""

    def __init__(self) -> None:
        self.mission: Mission | None = None
        """None: unknown."""
        self._interrupted: deque[Mission] = deque(maxlen=_REMEMBERED_INTERRUPTED)
        self._odd: int | None = None
        self._mismatches = 0
        self._compare_due = 0.0

    @property
    def sources(self) -> tuple[Mission, ...]:
        """Missions of which items may be on board."""
        return (self.mission or (), *self._interrupted)

    def interrupted(self, mission: Mission) -> None:
        """The transfer of a mission ended half-way: items of it are among those that were on board before."""
        for each in (self.mission or (), mission):
            if each not in self._interrupted:
                self._interrupted.append(each)

    def verified(self, mission: Mission) -> None:
        """This is on board, and nothing else."""
        self.mission = mission
        self._interrupted.clear()

    def read(self, mission: Mission, active: Mission | None) -> tuple[OnBoard, bool]:
        """This was read; what it is to one who had `active` verified last, and whether it is anything new."""
        changed = self.mission is None or not missions_equal(self.mission, mission)
        self.mission = mission
        return self._judge(mission, active), changed

    def may_be(self, mission: Mission, vehicle: VehicleState) -> bool:
        """Whether a mission that was verified may still be on board, as far as that is known without reading it."""
        return not self._interrupted and _fits(_total_of(vehicle), mission)

    def forget(self) -> None:
        """What is on board is not known any more."""
        self.mission = None

    def differs(self, now: float, vehicle: VehicleState) -> bool:
        """Take in what the vehicle tells; whether that is another length than the one known, and news.

        Ever more rarely if it stays so.
        """
        if self.mission is None:
            return False
        told = _total_of(vehicle)
        if _fits(told, self.mission):
            self._mismatches = 0
            return False
        self._mismatches = self._mismatches if told == self._odd else 0
        if self._mismatches and now < self._compare_due:
            return False
        # One that was read and is what we know after all: this autopilot counts otherwise.
        self._odd = told
        self._compare_due = now + min(LONGEST_COMPARISON_S, FIRST_COMPARISON_S * 2**self._mismatches)
        self._mismatches = min(self._mismatches + 1, _MANY_MISMATCHES)
        return True

    def _judge(self, mission: Mission, active: Mission | None) -> OnBoard:
        if not mission:
            return OnBoard.EMPTY
        if active is not None and missions_equal(active, mission):
            return OnBoard.OURS
        if self._is_mixture(mission):
            return OnBoard.DAMAGED
        # Whoever replaces a mission of ours means it, also where one that was there before us may be adopted.
        return OnBoard.FOREIGN if active is None else OnBoard.REPLACED

    def _is_mixture(self, mission: Mission) -> bool:
        """Whether every item comes from a transfer of ours that ended half-way or from what it was to replace."""
        return bool(self._interrupted) and all(
            any(missions_equal(each[k : k + 1], (item,)) for each in self._interrupted)
            for k, item in enumerate(mission)
        )


def _total_of(vehicle: VehicleState) -> int | None:
    """How many waypoints the vehicle says are on board; None if it does not."""
    return 0 if vehicle.mission_state == mavlink.MISSION_STATE_NO_MISSION else vehicle.mission_total


def _fits(total: int | None, mission: Mission) -> bool:
    """Whether a mission may be that long; some autopilots count home, which is item 0."""
    return total is None or total in (len(mission), len(mission) + 1)
