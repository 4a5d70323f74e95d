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

# RFC 8746: little-endian float64, and bytes.
FLOAT64_TAG = 86
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


def _numbers(minimum: int, maximum: int, inner: Rule, group: int = 1) -> Rule:
    """A typed array of float64; `group` numbers make one element."""

    def rule(value: Any) -> tuple[float, ...]:
        if (
            not isinstance(value, cbor2.CBORTag)
            or value.tag != FLOAT64_TAG
            or not isinstance(value.value, bytes)
        ):
            raise WireError(f"must be an array of float64, tag {FLOAT64_TAG} (got {brief(value)})")
        elements, rest = divmod(len(value.value), 8 * group)
        if rest or not minimum <= elements <= maximum:
            raise WireError(
                f"must have {minimum} to {maximum} times {group} float64 (got {len(value.value)} bytes)"
            )
        return tuple(inner(number) for number in np.frombuffer(value.value, dtype="<f8").tolist())

    return rule


def _flags(maximum: int) -> Rule:
    def rule(value: Any) -> tuple[bool, ...]:
        if (
            not isinstance(value, cbor2.CBORTag)
            or value.tag != UINT8_TAG
            or not isinstance(value.value, bytes)
        ):
            raise WireError(f"must be an array of bytes, tag {UINT8_TAG} (got {brief(value)})")
        if len(value.value) > maximum or max(value.value, default=0) > 1:
            raise WireError(f"must have at most {maximum} bytes, each 0 or 1 (got {len(value.value)} bytes)")
        return tuple(byte == 1 for byte in value.value)

    return rule


def _qartod(group: int = 1) -> Rule:
    """A typed array of bytes, each a QARTOD flag; more than one of them make an element that is a tuple."""

    def rule(value: Any) -> tuple[Any, ...]:
        if (
            not isinstance(value, cbor2.CBORTag)
            or value.tag != UINT8_TAG
            or not isinstance(value.value, bytes)
        ):
            raise WireError(f"must be an array of bytes, tag {UINT8_TAG} (got {brief(value)})")
        elements, rest = divmod(len(value.value), group)
        if rest or elements > MAXIMUM_OBSERVATIONS or not QARTOD_FLAGS.issuperset(value.value):
            raise WireError(
                f"must have at most {MAXIMUM_OBSERVATIONS} times {group} bytes, each 1, 2, 3, 4 or 9 "
                f"(got {len(value.value)} bytes)"
            )
        if group == 1:
            return tuple(value.value)
        return tuple(tuple(value.value[k : k + group]) for k in range(0, len(value.value), group))

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


def _blob(value: Any) -> bytes:
    if not isinstance(value, bytes) or not value:
        raise WireError(f"must be a byte string (got {brief(value)})")
    return value


_latitude = _number(-90, 90)
_longitude = _number(-180, 360)
_share = _number(0, 1)
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
            if name in ADDED:
                continue
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

RULES: dict[Topic, dict[str, Rule]] = {
    Topic.MODEL: {
        "vehicle": _text(32, VEHICLE_NAME),
        "sequence": _count,
        "software_version": _text(64),
        "variable": _text(100),
        "units": _text(40),
        "model": _blob,
        "model_time_s": _number(),
        "utc_s": _or_none(_number(0, 1e11)),
        "samples": _count,
        "rho": _share,
        "replans": _count,
        "calibration": _calibration,
        "ahead": _calibration,
        "origin_lat_deg": _latitude,
        "origin_lon_deg": _longitude,
        "bounds_m": _bounds,
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
    },
    Topic.LOG: {"level": _one_of(LEVELS), "text": _text(MAXIMUM_LINE)},
}

ADDED = frozenset(
    {
        "objective_before",
        "objective_after",
        "expected_rmse",
        "rejected",
        "seed",
        "model_version",
        "security",
        "shore",
    }
)
"""Fields that came into a version after its beginning: an older sender has not got them, and has their defaults."""


# Arrays that belong together, element by element.
PARALLEL: dict[Topic, tuple[str, ...]] = {
    Topic.MODEL: (),
    Topic.PLAN: ("route_deg", "is_spot"),
    Topic.OBSERVATIONS: ("model_time_s", "lat_deg", "lon_deg", "value", "flag", "checks"),
    Topic.HEALTH: (),
    Topic.LOG: (),
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
    return values
