"""The location test: readings from places where the vessel can't have been (QARTOD's test 3)."""

import math
from dataclasses import dataclass

import shapely
from shapely.geometry.base import BaseGeometry

from autonomy.quality.flags import Flag
from autonomy.quality.running import RunningMedian

SPEED_RATIO = 8.0
"""A scaled limit of speed: so many times the stream's usual speed under way …"""

SLOWEST_LIMIT_MPS = 15.0
"""… but never below this: vessels speed up, and fixes are metres off."""

FIX_ERROR_M = 15.0
"""A jump no longer than this may be the receiver's error, however short the time."""

CONSISTENT_READINGS = 10
"""So many places in a row that follow from each other are right: the place that they can't be reached from was not."""

_SPEEDS = 61
_UNDER_WAY_MPS = 0.2

_Place = tuple[float, float, float]
"""Time, s, x and y, m."""


@dataclass(frozen=True)
class Waters:
    """Where a survey's readings can come from, in local metres.

    Attributes:
        ground: the survey area, land and all.
        obstacles: land and whatever else is closed; polygons that may be wrong by a cell near the shore.
        margin_m: further than this from the ground nothing belongs to the survey.
    """

    ground: BaseGeometry
    obstacles: BaseGeometry
    margin_m: float


class Location:
    """Follows one vessel: FAIL far outside the survey or after an impossible jump, SUSPECT on land."""

    def __init__(self, waters: Waters, maximum_speed_mps: float | None) -> None:
        shapely.prepare([waters.ground, waters.obstacles])
        self._waters = waters
        self._maximum_speed_mps = maximum_speed_mps
        self._speeds = RunningMedian(_SPEEDS)
        self._good: _Place | None = None
        self._last: _Place | None = None
        self._consistent = 0

    def add(self, time_s: float, x: float, y: float) -> Flag:
        """The flag of the next reading's place; times increase."""
        here = (time_s, x, y)
        self._consistent = self._consistent + 1 if self._is_reachable(self._last, here) else 0
        possible = self._is_reachable(self._good, here) or self._consistent >= CONSISTENT_READINGS
        self._learn_speed(here)
        if not possible:
            return Flag.FAIL
        self._good = here
        waters = self._waters
        if not shapely.intersects_xy(waters.ground, x, y):
            distance_m = waters.ground.distance(shapely.Point(x, y))
            return Flag.FAIL if distance_m > waters.margin_m else Flag.GOOD
        return Flag.SUSPECT if shapely.intersects_xy(waters.obstacles, x, y) else Flag.GOOD

    def interrupt(self) -> None:
        """The next place does not follow from the last one."""
        self._good = self._last = None

    def _is_reachable(self, start: _Place | None, here: _Place) -> bool:
        """Whether the vessel can have come here since it was there."""
        if start is None:
            return True
        time_s, distance_m = _between(start, here)
        return distance_m <= FIX_ERROR_M + self._limit_mps * time_s

    @property
    def _limit_mps(self) -> float:
        if self._maximum_speed_mps is not None:
            return self._maximum_speed_mps
        usual_mps = self._speeds.median if len(self._speeds) else 0.0
        return max(SLOWEST_LIMIT_MPS, SPEED_RATIO * usual_mps)

    def _learn_speed(self, here: _Place) -> None:
        if self._last is not None:
            time_s, distance_m = _between(self._last, here)
            if distance_m > _UNDER_WAY_MPS * time_s:
                self._speeds.add(distance_m / time_s)
        self._last = here


def _between(a: _Place, b: _Place) -> tuple[float, float]:
    """Seconds and metres from one place to the next."""
    return b[0] - a[0], math.hypot(b[1] - a[1], b[2] - a[2])
