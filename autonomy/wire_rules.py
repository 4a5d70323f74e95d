"""What each field of each published message may hold: the bounds that both ends keep to."""

import math
import re
from collections.abc import Callable, Sequence
from math import isnan
from typing import Any

import cbor2
import numpy as np

from autonomy.effects import Topic
from autonomy.learning.calibration import CalibrationFigures

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

# RFC 8746: little-endian float64 and int32, and bytes.
FLOAT64_TAG = 86
INT32_TAG = 78
UINT8_TAG = 64


class WireError(ValueError):
    """A value cannot be published, or received bytes are not what their key promises; says what and where."""


class VersionError(WireError):
    """What came is of another version of these messages."""


# Gives the value in its final form or raises WireError.
Rule = Callable[[Any], Any]


def brief(value: Any) -> str:
    """A value for an error message: short, whatever was sent."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float) or (isinstance(value, int) and abs(value) < 2**64):
        return str(value)
    if isinstance(value, str):
        return repr(value if len(value) <= 20 else value[:20] + "…")
    return f"a {type(value).__name__}"


def _text(maximum: int, pattern: re.Pattern[str] | None = None) -> Rule:
    def rule(value: Any) -> str:
        if not isinstance(value, str) or len(value) > maximum:
            raise WireError(f"must be text of at most {maximum} characters (got {brief(value)})")
        if pattern is not None and not pattern.fullmatch(value):
            raise WireError(f"must match {pattern.pattern} (got {brief(value)})")
        return value

    return rule


def _one_of(choices: Sequence[str]) -> Rule:
    def rule(value: Any) -> str:
        if not isinstance(value, str) or value not in choices:
            raise WireError(f"must be one of {', '.join(choices)} (got {brief(value)})")
        return value

    return rule


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 2**53:
        raise WireError(f"must be a whole number from 0 to 2^53 (got {brief(value)})")
    return value


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise WireError(f"must be true or false (got {brief(value)})")
    return value


def _number(low: float = -1e30, high: float = 1e30) -> Rule:
    def rule(value: Any) -> float:
        # NaN fails the comparison, infinities the bounds.
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise WireError(f"must be a number from {low:g} to {high:g} (got {brief(value)})")
        return float(value)

    return rule


def _or_none(inner: Rule) -> Rule:
    return lambda value: None if value is None else inner(value)


def _typed(value: Any, tag: int, name: str) -> bytes:
    """The bytes of a typed array."""
    if not isinstance(value, cbor2.CBORTag) or value.tag != tag or not isinstance(value.value, bytes):
        raise WireError(f"must be an array of {name}, tag {tag} (got {brief(value)})")
    return value.value


def _numbers(minimum: int, maximum: int, inner: Rule, group: int = 1) -> Rule:
    """A typed array of float64; `group` numbers make one element."""

    def rule(value: Any) -> tuple[float, ...]:
        data = _typed(value, FLOAT64_TAG, "float64")
        elements, rest = divmod(len(data), 8 * group)
        if rest or not minimum <= elements <= maximum:
            raise WireError(f"must have {minimum} to {maximum} times {group} float64 (got {len(data)} bytes)")
        return tuple(inner(number) for number in np.frombuffer(data, dtype="<f8").tolist())

    return rule


def _flags(maximum: int) -> Rule:
    def rule(value: Any) -> tuple[bool, ...]:
        data = _typed(value, UINT8_TAG, "bytes")
        if len(data) > maximum or max(data, default=0) > 1:
            raise WireError(f"must have at most {maximum} bytes, each 0 or 1 (got {len(data)} bytes)")
        return tuple(byte == 1 for byte in data)

    return rule


def _qartod(group: int = 1) -> Rule:
    """A typed array of bytes, each a QARTOD flag; more than one of them make an element that is a tuple."""

    def rule(value: Any) -> tuple[Any, ...]:
        data = _typed(value, UINT8_TAG, "bytes")
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
    return value if isnan(value) else _number(-3.5e38, 3.5e38)(value)


def _tallies(value: Any) -> dict[str, tuple[int, ...]]:
    """Counts of the five flags by the name of the test."""
    if not isinstance(value, dict) or len(value) > MAXIMUM_TALLIES:
        raise WireError(f"must be a map of at most {MAXIMUM_TALLIES} (got {brief(value)})")
    name = _text(40)
    counts: dict[str, tuple[int, ...]] = {}
    for key, row in value.items():
        if not isinstance(row, list | tuple) or len(row) != len(QARTOD_FLAGS):
            raise WireError(f"must hold lists of {len(QARTOD_FLAGS)} counts (got {brief(row)})")
        counts[name(key)] = tuple(_count(count) for count in row)
    return counts


def _pairs(minimum: int, maximum: int) -> Rule:
    flat = _numbers(minimum, maximum, _number(-180, 360), group=2)

    def rule(value: Any) -> tuple[tuple[float, float], ...]:
        numbers = flat(value)
        return tuple((_latitude(lat), lon) for lat, lon in zip(numbers[0::2], numbers[1::2], strict=True))

    return rule


def _start(value: Any) -> tuple[float, float]:
    pairs: tuple[tuple[float, float], ...] = _pairs(1, 1)(value)
    return pairs[0]


def _bounds(value: Any) -> tuple[float, float, float, float]:
    x_min, y_min, x_max, y_max = _numbers(1, 1, _number(-1e7, 1e7), group=4)(value)
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
    data = _typed(value, INT32_TAG, "int32")
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
    end = _or_none(_number(-1e300, 1e300))
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise WireError(f"must be a list of two, each a number or null (got {brief(value)})")
    return end(value[0]), end(value[1])


def _bounds_deg(value: Any) -> tuple[float, float, float, float]:
    south, west, north, east = _numbers(1, 1, _longitude, group=4)(value)
    if not (-90.0 <= south < north <= 90.0 and west < east):
        raise WireError(f"must be south, west, north, east (got {south}, {west}, {north}, {east})")
    return south, west, north, east


def _lines(value: Any) -> tuple[tuple[str, str, float | None], ...]:
    """Level, text and time of lines of the log."""
    if not isinstance(value, list | tuple) or len(value) > MAXIMUM_LINES:
        raise WireError(f"must be a list of at most {MAXIMUM_LINES} (got {brief(value)})")
    level, text = _one_of(LEVELS), _text(MAXIMUM_LINE)
    rows = []
    for row in value:
        if not isinstance(row, list | tuple) or len(row) != 3:
            raise WireError(f"must hold level, text and time of each line (got {brief(row)})")
        rows.append((level(row[0]), text(row[1]), _utc(row[2])))
    return tuple(rows)


_latitude = _number(-90, 90)
_longitude = _number(-180, 360)
_share = _number(0, 1)
_utc = _or_none(_number(0, 1e11))
_columns = _numbers(0, MAXIMUM_OBSERVATIONS, _number())


def _calibration(value: Any) -> CalibrationFigures:
    if not isinstance(value, dict):
        raise WireError(f"must be a map of {', '.join(_CALIBRATION)} (got {brief(value)})")
    return CalibrationFigures(**_each(value, _CALIBRATION))


def _rejected(value: Any) -> tuple[tuple[str, float], ...]:
    """Names and objectives of the candidates that lost."""
    if not isinstance(value, list | tuple) or len(value) > MAXIMUM_REJECTED:
        raise WireError(f"must be a list of at most {MAXIMUM_REJECTED} (got {brief(value)})")
    name, objective = _text(40), _number()
    rows = []
    for row in value:
        if not isinstance(row, list | tuple) or len(row) != 2:
            raise WireError(f"must hold pairs of a name and a number (got {brief(row)})")
        rows.append((name(row[0]), objective(row[1])))
    return tuple(rows)


def _each(content: dict[str, Any], rules: dict[str, Rule]) -> dict[str, Any]:
    """The fields of a map, each by its rule; keys without a rule are ignored, for newer vehicles."""
    values: dict[str, Any] = {}
    for name, rule in rules.items():
        if name not in content:
            raise WireError(f"{name}: is missing")
        try:
            values[name] = rule(content[name])
        except WireError as error:
            raise WireError(f"{name}: {error}") from None
    return values


def _unknown_is_nan(inner: Rule) -> Rule:
    return lambda value: math.nan if value is None else inner(value)


_CALIBRATION: dict[str, Rule] = {
    "coverage_95": _unknown_is_nan(_share),
    "mean_square": _unknown_is_nan(_number(0)),
    "log_score": _unknown_is_nan(_number()),
    "count": _count,
}

_NUMBERS: dict[str, Rule] = {"run": _count, "first": _count, "oldest": _count, "end": _count}

RULES: dict[Topic, dict[str, Rule]] = {
    Topic.MODEL: {
        "vehicle": _text(32, VEHICLE_NAME),
        "sequence": _count,
        "software_version": _text(64),
        "variable": _text(100),
        "units": _text(40),
        "model": _blob(2**24),
        "model_time_s": _number(),
        "utc_s": _utc,
        "samples": _count,
        "rho": _share,
        "replans": _count,
        "calibration": _calibration,
        "ahead": _calibration,
        "origin_lat_deg": _latitude,
        "origin_lon_deg": _longitude,
        "bounds_m": _bounds,
        "survey": _text(100),
        "capacity": _count,
        "rho0": _share,
        "configuration_hash": _text(64),
    },
    Topic.PLAN: {
        "sequence": _count,
        "start_deg": _start,
        "route_deg": _pairs(0, MAXIMUM_CORNERS),
        "is_spot": _flags(MAXIMUM_CORNERS),
        "mutual_information": _or_none(_number()),
        "planner": _text(40),
        "reason": _text(MAXIMUM_REASON),
        "objective_before": _or_none(_number()),
        "objective_after": _or_none(_number()),
        "expected_rmse": _or_none(_number(0)),
        "rejected": _rejected,
        "seed": _or_none(_count),
        "model_version": _or_none(_count),
    },
    Topic.OBSERVATIONS: {
        **_NUMBERS,
        "model_time_s": _columns,
        "lat_deg": _numbers(0, MAXIMUM_OBSERVATIONS, _latitude),
        "lon_deg": _numbers(0, MAXIMUM_OBSERVATIONS, _longitude),
        "value": _numbers(0, MAXIMUM_OBSERVATIONS, _reading),
        "flag": _qartod(),
        "checks": _qartod(CHECKS),
    },
    Topic.HEALTH: {
        "state": _text(40),
        "reason": _text(MAXIMUM_REASON),
        "mode": _text(40),
        "armed": _flag,
        "lat_deg": _or_none(_latitude),
        "lon_deg": _or_none(_longitude),
        "heading_deg": _or_none(_number(-360, 360)),
        "groundspeed_mps": _or_none(_number(0, 1e4)),
        "model_time_s": _or_none(_number()),
        "samples": _count,
        "basis_size": _count,
        "rho": _or_none(_share),
        "rho0": _or_none(_share),
        "replans": _count,
        "kernel": _text(MAXIMUM_KERNEL),
        "calibration": _calibration,
        "ahead": _calibration,
        "repairs": _count,
        "distance_m": _or_none(_number(0)),
        "clock_rate": _or_none(_number(0)),
        "link_ok": _flag,
        "worker_busy": _flag,
        "dropped": _count,
        "journal": _text(MAXIMUM_REASON),
        "quality": _tallies,
        "security": _text(MAXIMUM_REASON),
        "shore": _text(MAXIMUM_REASON),
        "run": _count,
        "observations_end": _count,
        "log_end": _count,
    },
    Topic.LOG: {**_NUMBERS, "lines": _lines},
    Topic.SURVEY: {
        "name": _text(100),
        "variable": _text(100),
        "long_name": _text(100),
        "units": _text(40),
        "valid_range": _valid_range,
        "rho0": _share,
        "capacity": _or_none(_count),
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
        values = _each(content, RULES[topic])
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
