"""A boat in AUTO that doesn't get anywhere, or not where its mission begins."""

import math
from dataclasses import dataclass

from autonomy.geometry import FloatArray
from autonomy.planning.restrictions import Region

_NEAREST_SHARE = 0.75
"""Of the way from the stall to its waypoint: the radius of the water given up about the waypoint."""

_REMEMBERED_PLACES = 64
"""Of more, those are forgotten that were given up for the shortest time to come, or the longest ago."""

CLOSING_S = 20.0
"""Model time in which a boat must have come nearer to the first waypoint of a new mission."""

_CLOSER_M = 10.0


@dataclass(frozen=True)
class _Anchor:
    """Where the boat was, on its way to which waypoint, and since when."""

    time_s: float
    point_m: FloatArray
    target: object


class StallWatch:
    """Notices a boat that stays within `stall_m` of one place for `stall_s` of model time; None: never."""

    def __init__(self, stall_s: float | None, stall_m: float) -> None:
        self._stall_s = stall_s
        self._stall_m = stall_m
        self._anchor: _Anchor | None = None

    def rest(self) -> None:
        """The boat has no waypoint to get to, or nobody knows where it is."""
        self._anchor = None

    def follow(self, time_s: float, point_m: FloatArray, target: object) -> bool:
        """The boat is at a point, shape (2,), on its way to `target`; returns whether it has stalled, once."""
        anchor = self._anchor
        moved = anchor is None or math.hypot(*(point_m - anchor.point_m)) > self._stall_m
        if anchor is None or moved or target != anchor.target:
            self._anchor = _Anchor(time_s, point_m, target)
            return False
        if self._stall_s is None or time_s - anchor.time_s <= self._stall_s:
            return False
        self._anchor = None
        return True


class GivenUp:
    """Water behind stalls, each for `give_up_s` of model time; twice as long for the next stall before it."""

    def __init__(self, give_up_s: float, least_m: float) -> None:
        self._give_up_s = give_up_s
        self._least_m = least_m
        self._places: list[tuple[Region, float, float]] = []  # until when, and for how long

    def add(self, time_s: float, point_m: FloatArray, waypoint_m: FloatArray) -> float:
        """The boat has stalled at a point on its way to a waypoint; returns for how long its water is given up."""
        distance_m = math.hypot(*(waypoint_m - point_m))
        x, y = map(float, waypoint_m)
        before = [
            (region, lasts_s)
            for region, _, lasts_s in self._places
            if math.dist(region.corners_m[0], (x, y)) <= (region.radius_m or 0.0)
        ]
        lasts_s = 2.0 * max(lasts_s for _, lasts_s in before) if before else self._give_up_s
        region = Region(((x, y),), max(self._least_m, _NEAREST_SHARE * distance_m))
        self._places = [place for place in self._places if place[0] not in [known for known, _ in before]]
        self._places.append((region, time_s + lasts_s, lasts_s))
        if len(self._places) > _REMEMBERED_PLACES:
            self._places.remove(min(self._places, key=lambda place: place[1]))
        return lasts_s

    def regions(self, time_s: float) -> tuple[Region, ...]:
        """What is given up at a model time."""
        return tuple(region for region, until_s, _ in self._places if until_s > time_s)


class ClosingWatch:
    """Sees whether a boat that was given a new mission under way makes for its first waypoint.

    MISSION_CURRENT alone is no proof: an autopilot may keep its old index, or loiter on at the end of the mission
    before.
    """

    def __init__(self) -> None:
        self._mission: object = None
        self._began: tuple[float, float] | None = None  # when, and how far away

    @property
    def open(self) -> bool:
        """Whether there is something to confirm."""
        return self._mission is not None

    def begin(self, mission: object) -> None:
        """This mission is sailed from its first waypoint on, from now."""
        self._mission, self._began = mission, None

    def rest(self) -> None:
        """There is nothing to confirm."""
        self._mission = self._began = None

    def follow(self, time_s: float, distance_m: float, *, reached: bool, elsewhere: bool = False) -> bool:
        """So far from the first waypoint; returns whether the boat does not make for it, once.

        `reached`: it is behind the boat. `elsewhere`: the autopilot names another one, and comes nearer by chance.
        """
        if self._mission is None:
            return False
        if self._began is None:
            self._began = (time_s, distance_m)
        began_s, began_m = self._began
        nearer = began_m - distance_m >= min(_CLOSER_M, 0.5 * began_m)
        if reached or (nearer and not elsewhere):
            self.rest()
            return False
        if time_s - began_s <= CLOSING_S:
            return False
        self.rest()
        return True
