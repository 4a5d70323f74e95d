"""Sensor readings and position fixes, paired by model time."""

import math
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass
from operator import attrgetter

from pyproj import Geod

_FIXES = 512
"""Water may have been on its way to the sensor for a minute: at four fixes a second half of these are enough."""

_WAITING = 256
_WGS84 = Geod(ellps="WGS84")

NO_HEADING = "no heading to find the intake by"


@dataclass(frozen=True)
class Observation:
    """One reading of the sensor, where and when it was taken; the value is NaN where the sensor had none."""

    model_time_s: float
    lat_deg: float
    lon_deg: float
    value: float


@dataclass(frozen=True)
class Intake:
    """Where the water is taken in, seen from the place whose position is told: metres ahead and to starboard."""

    forward_m: float = 0.0
    starboard_m: float = 0.0

    @property
    def is_elsewhere(self) -> bool:
        """Whether it is not that place."""
        return (self.forward_m, self.starboard_m) != (0.0, 0.0)

    def position(self, lat_deg: float, lon_deg: float, heading_deg: float) -> tuple[float, float]:
        """Its latitude and longitude, in degrees, when the vehicle is there and heads so."""
        bearing_deg = heading_deg + math.degrees(math.atan2(self.starboard_m, self.forward_m))
        lon, lat, _ = _WGS84.fwd(lon_deg, lat_deg, bearing_deg, math.hypot(self.forward_m, self.starboard_m))
        return float(lat), float(lon)


@dataclass(frozen=True)
class _Fix:
    model_time_s: float
    lat_deg: float
    lon_deg: float
    heading_deg: float | None


@dataclass(frozen=True)
class _Reading:
    model_time_s: float
    value: float


_time = attrgetter("model_time_s")


class Pairing:
    """Gives each reading the position at its time, interpolated between the fixes on both sides of it.

    A reading newer than every fix waits for the next one. A reading whose nearest fix is more than `gap_s`
    away (model time), or that is older than every fix, is dropped and counted under its reason.

    If the water is taken in elsewhere than the fixes are of, the observation's position is the intake's: this is the
    one place where that is corrected. Without a heading it can't be, and the reading is dropped.
    """

    def __init__(self, gap_s: float, dropped: Counter[str], intake: Intake | None = None) -> None:
        self._gap_s = gap_s
        self._intake = Intake() if intake is None else intake
        self._fixes: list[_Fix] = []
        self._waiting: list[_Reading] = []
        self._dropped = dropped

    def add_fix(
        self, model_time_s: float, lat_deg: float, lon_deg: float, heading_deg: float | None = None
    ) -> list[Observation]:
        """Take in a position, and the heading there; returns the readings that waited for it."""
        index = bisect_left(self._fixes, model_time_s, key=_time)
        if index < len(self._fixes) and self._fixes[index].model_time_s == model_time_s:
            return []
        self._fixes.insert(index, _Fix(model_time_s, lat_deg, lon_deg, heading_deg))
        if len(self._fixes) > _FIXES:
            del self._fixes[0]
        newest_s = self._fixes[-1].model_time_s
        ready = [reading for reading in self._waiting if reading.model_time_s <= newest_s]
        self._waiting = [reading for reading in self._waiting if reading.model_time_s > newest_s]
        return [observation for reading in ready for observation in self._resolve(reading)]

    def add_reading(self, model_time_s: float, value: float) -> list[Observation]:
        """Take in a reading; returns it as an observation if its position is known already."""
        reading = _Reading(model_time_s, value)
        if self._fixes and model_time_s <= self._fixes[-1].model_time_s:
            return self._resolve(reading)
        self._waiting.append(reading)
        if len(self._waiting) > _WAITING:
            del self._waiting[0]
            self._dropped["no fix came"] += 1
        return []

    def reset(self) -> None:
        """Forget fixes and waiting readings: model time was re-anchored."""
        self._dropped["clock re-anchored"] += len(self._waiting)
        self._fixes.clear()
        self._waiting.clear()

    def _resolve(self, reading: _Reading) -> list[Observation]:
        time_s = reading.model_time_s
        index = bisect_left(self._fixes, time_s, key=_time)
        after = self._fixes[index]
        if after.model_time_s == time_s:
            return self._observation(after, reading.value)
        if index == 0:
            self._dropped["older than every fix"] += 1
            return []
        before = self._fixes[index - 1]
        if min(time_s - before.model_time_s, after.model_time_s - time_s) > self._gap_s:
            self._dropped["no fix near in time"] += 1
            return []
        return self._observation(_interpolate(before, after, time_s), reading.value)

    def _observation(self, fix: _Fix, value: float) -> list[Observation]:
        place = fix.lat_deg, fix.lon_deg
        if self._intake.is_elsewhere:
            if fix.heading_deg is None:
                self._dropped[NO_HEADING] += 1
                return []
            place = self._intake.position(*place, fix.heading_deg)
        return [Observation(fix.model_time_s, *place, value)]


def _interpolate(before: _Fix, after: _Fix, time_s: float) -> _Fix:
    share = (time_s - before.model_time_s) / (after.model_time_s - before.model_time_s)
    east_deg = _short_way(after.lon_deg - before.lon_deg)  # also over the antimeridian
    lat_deg = before.lat_deg + share * (after.lat_deg - before.lat_deg)
    lon_deg = _short_way(before.lon_deg + share * east_deg)
    heading_deg = None
    if before.heading_deg is not None and after.heading_deg is not None:
        heading_deg = before.heading_deg + share * _short_way(after.heading_deg - before.heading_deg)
    return _Fix(time_s, lat_deg, lon_deg, heading_deg)


def _short_way(angle_deg: float) -> float:
    """The same angle from -180 to 180 degrees."""
    return (angle_deg + 180.0) % 360.0 - 180.0
