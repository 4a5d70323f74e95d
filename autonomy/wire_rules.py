"""What each field of each published message may hold: the bounds that both ends keep to."""

import re
from math import isnan
from typing import Any

import numpy as np

from autonomy import wire_kinds as kinds
from autonomy.effects import Topic
from autonomy.learning.calibration import CalibrationFigures
from autonomy.wire_kinds import INT32_TAG, UINT8_TAG, Rule, WireError, brief

MAXIMUM_OBSERVATIONS = 4096
MAXIMUM_CORNERS = 10_000
MAXIMUM_REASON = 400
MAXIMUM_REJECTED = 20
MAXIMUM_KERNEL = 200
MAXIMUM_LINE = 2000
VEHICLE_NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
MAXIMUM_TALLIES = 20
QARTOD_FLAGS = frozenset({1, 2, 3, 4, 9})
CHECKS = 7
"""Tests whose flags go with each observation: timing, syntax, gross range, location, spike, rate of change, flat
line."""
LEVELS = ("debug", "info", "warning", "error")

MAXIMUM_LINES = 500
MAXIMUM_RINGS = 1000
MAXIMUM_RING_CORNERS = 20_000
MAXIMUM_DIGEST = 340
RING_UNITS_PER_DEG = 1e6
"""Corners of rings are whole millionths of a degree, a tenth of a metre, so that they take half the bytes."""


def _qartod(group: int = 1) -> Rule:
    """A typed array of bytes, each a QARTOD flag; more than one of them make an element that is a tuple."""

    def rule(value: Any) -> tuple[Any, ...]:
        data = kinds.typed(value, UINT8_TAG, "bytes")
        elements, rest = divmod(len(data), group)
        if rest or elements > MAXIMUM_OBSERVATIONS or not QARTOD_FLAGS.issuperset(data):
            raise WireError(
                f"must have at most {MAXIMUM_OBSERVATIONS} times {group} bytes, each 1, 2, 3, 4 or 9 "
                f"(got {len(data)} bytes)"
            )
        if group == 1:
            return tuple(data)
        return tuple(tuple(data[k : k + group]) for k in range(0, len(data), group))

    return rule


def _reading(value: float) -> float:
    """What a probe may send, which is a 32-bit number; NaN where it was not finite."""
    return value if isnan(value) else kinds.number(-3.5e38, 3.5e38)(value)


def _tallies(value: Any) -> dict[str, tuple[int, ...]]:
    """Counts of the five flags by the name of the test."""
    if not isinstance(value, dict) or len(value) > MAXIMUM_TALLIES:
        raise WireError(f"must be a map of at most {MAXIMUM_TALLIES} (got {brief(value)})")
    name = kinds.text(40)
    counts: dict[str, tuple[int, ...]] = {}
    for key, row in value.items():
        if not isinstance(row, list | tuple) or len(row) != len(QARTOD_FLAGS):
            raise WireError(f"must hold lists of {len(QARTOD_FLAGS)} counts (got {brief(row)})")
        counts[name(key)] = tuple(kinds.count(count) for count in row)
    return counts


def _pairs(minimum: int, maximum: int) -> Rule:
    flat = kinds.numbers(minimum, maximum, kinds.number(-180, 360), group=2)

    def rule(value: Any) -> tuple[tuple[float, float], ...]:
        numbers = flat(value)
        return tuple((_latitude(lat), lon) for lat, lon in zip(numbers[0::2], numbers[1::2], strict=True))

    return rule


def _start(value: Any) -> tuple[float, float]:
    pairs: tuple[tuple[float, float], ...] = _pairs(1, 1)(value)
    return pairs[0]


def _bounds(value: Any) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = kinds.numbers(1, 1, kinds.number(-1e7, 1e7), group=4)(value)
    if not (x_min < x_max and y_min < y_max):
        raise WireError(
            f"must be x minimum, y minimum, x maximum, y maximum (got {x_min}, {y_min}, {x_max}, {y_max})"
        )
    return x_min, y_min, x_max, y_max


def _blob(maximum: int) -> Rule:
    def rule(value: Any) -> bytes:
        if not isinstance(value, bytes) or not 0 < len(value) <= maximum:
            raise WireError(f"must be a byte string of at most {maximum} bytes (got {brief(value)})")
        return value

    return rule


def _ring(value: Any) -> tuple[tuple[float, float], ...]:
    data = kinds.typed(value, INT32_TAG, "int32")
    if len(data) % 8 or not 3 <= len(data) // 8 <= MAXIMUM_RING_CORNERS:
        raise WireError(f"must have 3 to {MAXIMUM_RING_CORNERS} times 2 int32 (got {len(data)} bytes)")
    corners = (np.frombuffer(data, dtype="<i4").reshape(-1, 2) / RING_UNITS_PER_DEG).tolist()
    return tuple((_latitude(lat), _longitude(lon)) for lat, lon in corners)


def _rings(value: Any) -> tuple[tuple[tuple[float, float], ...], ...]:
    """Closed lines; how many corners they may have together is bounded."""
    if not isinstance(value, list | tuple) or len(value) > MAXIMUM_RINGS:
        raise WireError(f"must be a list of at most {MAXIMUM_RINGS} rings (got {brief(value)})")
    rings = []
    left = MAXIMUM_RING_CORNERS
    for each in value:
        ring = _ring(each)
        left -= len(ring)
        if left < 0:
            raise WireError(f"must have at most {MAXIMUM_RING_CORNERS} corners in all")
        rings.append(ring)
    return tuple(rings)


def _valid_range(value: Any) -> tuple[float | None, float | None]:
    end = kinds.or_none(kinds.number(-1e300, 1e300))
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise WireError(f"must be a list of two, each a number or null (got {brief(value)})")
    return end(value[0]), end(value[1])


def _bounds_deg(value: Any) -> tuple[float, float, float, float]:
    south, west, north, east = kinds.numbers(1, 1, _longitude, group=4)(value)
    if not (-90.0 <= south < north <= 90.0 and west < east):
        raise WireError(f"must be south, west, north, east (got {south}, {west}, {north}, {east})")
    return south, west, north, east


def _lines(value: Any) -> tuple[tuple[str, str, float | None], ...]:
    """Level, text and time of lines of the log."""
    if not isinstance(value, list | tuple) or len(value) > MAXIMUM_LINES:
        raise WireError(f"must be a list of at most {MAXIMUM_LINES} (got {brief(value)})")
    level, text = kinds.one_of(LEVELS), kinds.text(MAXIMUM_LINE)
    rows = []
    for row in value:
        if not isinstance(row, list | tuple) or len(row) != 3:
            raise WireError(f"must hold level, text and time of each line (got {brief(row)})")
        rows.append((level(row[0]), text(row[1]), _utc(row[2])))
    return tuple(rows)


_latitude = kinds.number(-90, 90)
_longitude = kinds.number(-180, 360)
_share = kinds.number(0, 1)
_utc = kinds.or_none(kinds.number(0, 1e11))
_columns = kinds.numbers(0, MAXIMUM_OBSERVATIONS, kinds.number())


def _calibration(value: Any) -> CalibrationFigures:
    if not isinstance(value, dict):
        raise WireError(f"must be a map of {', '.join(_CALIBRATION)} (got {brief(value)})")
    return CalibrationFigures(**kinds.each(value, _CALIBRATION))


def _rejected(value: Any) -> tuple[tuple[str, float], ...]:
    """Names and objectives of the candidates that lost."""
    if not isinstance(value, list | tuple) or len(value) > MAXIMUM_REJECTED:
        raise WireError(f"must be a list of at most {MAXIMUM_REJECTED} (got {brief(value)})")
    name, objective = kinds.text(40), kinds.number()
    rows = []
    for row in value:
        if not isinstance(row, list | tuple) or len(row) != 2:
            raise WireError(f"must hold pairs of a name and a number (got {brief(row)})")
        rows.append((name(row[0]), objective(row[1])))
    return tuple(rows)


_CALIBRATION: dict[str, Rule] = {
    "coverage_95": kinds.unknown_is_nan(_share),
    "mean_square": kinds.unknown_is_nan(kinds.number(0)),
    "log_score": kinds.unknown_is_nan(kinds.number()),
    "count": kinds.count,
}

_NUMBERS: dict[str, Rule] = {
    "run": kinds.count,
    "first": kinds.count,
    "oldest": kinds.count,
    "end": kinds.count,
}

RULES: dict[Topic, dict[str, Rule]] = {
    Topic.MODEL: {
        "vehicle": kinds.text(32, VEHICLE_NAME),
        "sequence": kinds.count,
        "software_version": kinds.text(64),
        "variable": kinds.text(100),
        "units": kinds.text(40),
        "model": _blob(2**24),
        "model_time_s": kinds.number(),
        "utc_s": _utc,
        "samples": kinds.count,
        "rho": _share,
        "replans": kinds.count,
        "calibration": _calibration,
        "ahead": _calibration,
        "origin_lat_deg": _latitude,
        "origin_lon_deg": _longitude,
        "bounds_m": _bounds,
        "survey": kinds.text(100),
        "capacity": kinds.count,
        "rho0": _share,
        "configuration_hash": kinds.text(64),
        "run": kinds.count,
    },
    Topic.PLAN: {
        "sequence": kinds.count,
        "start_deg": _start,
        "route_deg": _pairs(0, MAXIMUM_CORNERS),
        "is_spot": kinds.flags(MAXIMUM_CORNERS),
        "mutual_information": kinds.or_none(kinds.number()),
        "planner": kinds.text(40),
        "reason": kinds.text(MAXIMUM_REASON),
        "objective_before": kinds.or_none(kinds.number()),
        "objective_after": kinds.or_none(kinds.number()),
        "expected_rmse": kinds.or_none(kinds.number(0)),
        "rejected": _rejected,
        "seed": kinds.or_none(kinds.count),
        "model_version": kinds.or_none(kinds.count),
        "run": kinds.count,
        "utc_s": _utc,
    },
    Topic.OBSERVATIONS: {
        **_NUMBERS,
        "model_time_s": _columns,
        "lat_deg": kinds.numbers(0, MAXIMUM_OBSERVATIONS, _latitude),
        "lon_deg": kinds.numbers(0, MAXIMUM_OBSERVATIONS, _longitude),
        "value": kinds.numbers(0, MAXIMUM_OBSERVATIONS, _reading),
        "flag": _qartod(),
        "checks": _qartod(CHECKS),
    },
    Topic.HEALTH: {
        "state": kinds.text(40),
        "reason": kinds.text(MAXIMUM_REASON),
        "mode": kinds.text(40),
        "armed": kinds.flag,
        "lat_deg": kinds.or_none(_latitude),
        "lon_deg": kinds.or_none(_longitude),
        "heading_deg": kinds.or_none(kinds.number(-360, 360)),
        "groundspeed_mps": kinds.or_none(kinds.number(0, 1e4)),
        "model_time_s": kinds.or_none(kinds.number()),
        "samples": kinds.count,
        "basis_size": kinds.count,
        "rho": kinds.or_none(_share),
        "rho0": kinds.or_none(_share),
        "replans": kinds.count,
        "kernel": kinds.text(MAXIMUM_KERNEL),
        "calibration": _calibration,
        "ahead": _calibration,
        "repairs": kinds.count,
        "distance_m": kinds.or_none(kinds.number(0)),
        "clock_rate": kinds.or_none(kinds.number(0)),
        "link_ok": kinds.flag,
        "worker_busy": kinds.flag,
        "dropped": kinds.count,
        "journal": kinds.text(MAXIMUM_REASON),
        "quality": _tallies,
        "security": kinds.text(MAXIMUM_REASON),
        "shore": kinds.text(MAXIMUM_REASON),
        "run": kinds.count,
        "observations_end": kinds.count,
        "log_end": kinds.count,
        "utc_s": _utc,
    },
    Topic.LOG: {**_NUMBERS, "lines": _lines},
    Topic.SURVEY: {
        "name": kinds.text(100),
        "variable": kinds.text(100),
        "long_name": kinds.text(100),
        "units": kinds.text(40),
        "valid_range": _valid_range,
        "rho0": _share,
        "capacity": kinds.or_none(kinds.count),
        "bounds_deg": _bounds_deg,
        **dict.fromkeys(("area", "land", "keep_in", "keep_out", "fence"), _rings),
    },
    Topic.STATUS: {"data": _blob(MAXIMUM_DIGEST)},
}


# Arrays that belong together, element by element.
PARALLEL: dict[Topic, tuple[str, ...]] = {
    Topic.MODEL: (),
    Topic.PLAN: ("route_deg", "is_spot"),
    Topic.OBSERVATIONS: ("model_time_s", "lat_deg", "lon_deg", "value", "flag", "checks"),
    Topic.HEALTH: (),
    Topic.LOG: (),
    Topic.SURVEY: (),
    Topic.STATUS: (),
}


def checked(topic: Topic, content: dict[str, Any]) -> dict[str, Any]:
    """The fields of a message, each by its rule, and those that belong together equally long."""
    try:
        values = kinds.each(content, RULES[topic])
    except WireError as error:
        raise WireError(f"{topic.value}: {error}") from None
    lengths = {
        len(values[name]) for name in values if isinstance(values[name], tuple) and name in PARALLEL[topic]
    }
    if len(lengths) > 1:
        raise WireError(f"{topic.value}: {', '.join(PARALLEL[topic])}: must be equally long")
    if "first" in values:
        items = len(values[_ITEMS[topic]])
        if not values["oldest"] <= values["first"] <= values["first"] + items <= values["end"]:
            raise WireError(
                f"{topic.value}: first: must be from oldest to end less the {items} items "
                f"(got {values['oldest']}, {values['first']}, {values['end']})"
            )
    return values


_ITEMS = {Topic.OBSERVATIONS: "value", Topic.LOG: "lines"}
