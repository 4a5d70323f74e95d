"""Sensor readings and position fixes, paired by model time."""

from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass
from operator import attrgetter

_FIXES = 256
_WAITING = 256


@dataclass(frozen=True)
class Observation:
    """One reading of the sensor, where and when it was taken; the value is NaN where the sensor had none."""

    model_time_s: float
    lat_deg: float
    lon_deg: float
    value: float


@dataclass(frozen=True)
class _Fix:
    model_time_s: float
    lat_deg: float
    lon_deg: float


@dataclass(frozen=True)
class _Reading:
    model_time_s: float
    value: float


_time = attrgetter("model_time_s")


class Pairing:
    """Gives each reading the position at its time, interpolated between the fixes on both sides of it.

    A reading newer than every fix waits for the next one. A reading whose nearest fix is more than `gap_s`
    away (model time), or that is older than every fix, is dropped and counted under its reason.
    """

    def __init__(self, gap_s: float, dropped: Counter[str]) -> None:
        self._gap_s = gap_s
        self._fixes: list[_Fix] = []
        self._waiting: list[_Reading] = []
        self._dropped = dropped

    def add_fix(self, model_time_s: float, lat_deg: float, lon_deg: float) -> list[Observation]:
        """Take in a position; returns the readings that waited for it."""
        index = bisect_left(self._fixes, model_time_s, key=_time)
        if index < len(self._fixes) and self._fixes[index].model_time_s == model_time_s:
            return []
        self._fixes.insert(index, _Fix(model_time_s, lat_deg, lon_deg))
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
            return [Observation(time_s, after.lat_deg, after.lon_deg, reading.value)]
        if index == 0:
            self._dropped["older than every fix"] += 1
            return []
        before = self._fixes[index - 1]
        if min(time_s - before.model_time_s, after.model_time_s - time_s) > self._gap_s:
            self._dropped["no fix near in time"] += 1
            return []
        lat_deg, lon_deg = _interpolate(before, after, time_s)
        return [Observation(time_s, lat_deg, lon_deg, reading.value)]


def _interpolate(before: _Fix, after: _Fix, time_s: float) -> tuple[float, float]:
    share = (time_s - before.model_time_s) / (after.model_time_s - before.model_time_s)
    east_deg = (after.lon_deg - before.lon_deg + 180.0) % 360.0 - 180.0  # the short way over the antimeridian
    lat_deg = before.lat_deg + share * (after.lat_deg - before.lat_deg)
    lon_deg = before.lon_deg + share * east_deg
    return lat_deg, (lon_deg + 180.0) % 360.0 - 180.0
