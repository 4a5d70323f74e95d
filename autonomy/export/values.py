"""What an archive gives to those who write files."""

import math
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray, LocalFrame
from autonomy.wire import LogNotice, ModelSnapshot, PlanNotice


def iso_utc(utc_s: float) -> str:
    """A moment as ISO 8601 has it, to the millisecond: 2026-05-01T12:30:00.250Z."""
    text = datetime.fromtimestamp(round(utc_s, 3), UTC).isoformat(timespec="milliseconds")
    return text.replace("+00:00", "Z")


class ExportError(ValueError):
    """What there is can't be exported as asked; says why, and what would help."""


@dataclass(frozen=True)
class Window:
    """From when until when, seconds since 1970, both included."""

    start_s: float = -math.inf
    end_s: float = math.inf


@dataclass(frozen=True)
class Subject:
    """What was surveyed, and where; the same for all models of an export.

    Attributes:
        variable: what was measured (CF standard name).
        units: its units.
        frame: local metres of the models.
        bounds_m: x minimum, y minimum, x maximum, y maximum of the survey area.
    """

    variable: str
    units: str
    frame: LocalFrame
    bounds_m: tuple[float, float, float, float]


@dataclass(frozen=True)
class Origin:
    """Name of the survey, version of the vehicle's software, hash of its configuration; empty for what is unknown."""

    survey: str
    software_version: str
    configuration_hash: str


@dataclass(frozen=True, eq=False)
class DatedModel:
    """A model, and the moment that its map is of."""

    utc_s: float
    snapshot: ModelSnapshot


@dataclass(frozen=True, eq=False)
class DatedPlan:
    """A plan, and when it was made or, if it does not say so, heard."""

    utc_s: float
    plan: PlanNotice


@dataclass(frozen=True)
class DatedLine:
    """A line of the vehicle's log, and when it was written or, if it does not say so, heard."""

    utc_s: float
    line: LogNotice


@dataclass(frozen=True)
class State:
    """Where the vehicle was and what it did at one moment; None for what was not known."""

    utc_s: float
    lat_deg: float | None
    lon_deg: float | None
    heading_deg: float | None
    groundspeed_mps: float | None
    samples: int
    basis_size: int
    rho: float | None
    state: str
    reason: str


@dataclass(frozen=True, eq=False)
class Readings:
    """Consecutive readings in the order in which they were made, n of them.

    `utc_s`, `model_time_s`, `lat_deg`, `lon_deg` and `value` are (n,), values NaN where the probe sent no number;
    `flag` is (n,) and `checks` (n, 7), in the order of `autonomy.quality.Check`, as `ObservationNotice` has them.
    """

    utc_s: FloatArray
    model_time_s: FloatArray
    lat_deg: FloatArray
    lon_deg: FloatArray
    value: FloatArray
    flag: NDArray[np.int8]
    checks: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.utc_s)

    def within(self, window: Window) -> "Readings":
        """Those that lie in a window."""
        kept = (self.utc_s >= window.start_s) & (self.utc_s <= window.end_s)
        return self if kept.all() else Readings(*(getattr(self, name)[kept] for name in self.__annotations__))
