"""Rules of the kinds of fields that published messages are made of, and what is said of a field that breaks them."""

import math
import re
from collections.abc import Callable, Sequence
from typing import Any

import cbor2
import numpy as np

from autonomy import plain_cbor

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


def opened(
    what: str, data: bytes, *, maximum_bytes: int, maximum_items: int, maximum_depth: int
) -> dict[str, Any]:
    """The map in bytes that may come from anybody; `what` is how they are named in an error.

    Raises:
        WireError: they are no map of CBOR, or more than they may be; see `plain_cbor.load`.
    """
    try:
        content = plain_cbor.load(
            data, maximum_bytes=maximum_bytes, maximum_items=maximum_items, maximum_depth=maximum_depth
        )
    except plain_cbor.CBORError as error:
        raise WireError(f"{what}: {error}") from None
    if not isinstance(content, dict):
        raise WireError(f"{what}: must be a map (got {brief(content)})")
    return content


def text(maximum: int, pattern: re.Pattern[str] | None = None) -> Rule:
    """Text of at most so many characters, all of it like the pattern."""

    def rule(value: Any) -> str:
        if not isinstance(value, str) or len(value) > maximum:
            raise WireError(f"must be text of at most {maximum} characters (got {brief(value)})")
        if pattern is not None and not pattern.fullmatch(value):
            raise WireError(f"must match {pattern.pattern} (got {brief(value)})")
        return value

    return rule


def one_of(choices: Sequence[str]) -> Rule:
    """One of these texts."""

    def rule(value: Any) -> str:
        if not isinstance(value, str) or value not in choices:
            raise WireError(f"must be one of {', '.join(choices)} (got {brief(value)})")
        return value

    return rule


def count(value: Any) -> int:
    """A whole number that is not negative."""
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= 2**53:
        raise WireError(f"must be a whole number from 0 to 2^53 (got {brief(value)})")
    return value


def flag(value: Any) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise WireError(f"must be true or false (got {brief(value)})")
    return value


def number(low: float = -1e30, high: float = 1e30) -> Rule:
    """A finite number between these, as a float."""

    def rule(value: Any) -> float:
        # NaN fails the comparison, infinities the bounds.
        if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
            raise WireError(f"must be a number from {low:g} to {high:g} (got {brief(value)})")
        return float(value)

    return rule


def or_none(inner: Rule) -> Rule:
    """The same, or null."""
    return lambda value: None if value is None else inner(value)


def typed(value: Any, tag: int, name: str) -> bytes:
    """The bytes of a typed array."""
    if not isinstance(value, cbor2.CBORTag) or value.tag != tag or not isinstance(value.value, bytes):
        raise WireError(f"must be an array of {name}, tag {tag} (got {brief(value)})")
    return value.value


def numbers(minimum: int, maximum: int, inner: Rule, group: int = 1) -> Rule:
    """A typed array of float64; `group` numbers make one element."""

    def rule(value: Any) -> tuple[float, ...]:
        data = typed(value, FLOAT64_TAG, "float64")
        elements, rest = divmod(len(data), 8 * group)
        if rest or not minimum <= elements <= maximum:
            raise WireError(f"must have {minimum} to {maximum} times {group} float64 (got {len(data)} bytes)")
        return tuple(inner(number) for number in np.frombuffer(data, dtype="<f8").tolist())

    return rule


def flags(maximum: int) -> Rule:
    """A typed array of at most so many bytes, each 0 or 1."""

    def rule(value: Any) -> tuple[bool, ...]:
        data = typed(value, UINT8_TAG, "bytes")
        if len(data) > maximum or max(data, default=0) > 1:
            raise WireError(f"must have at most {maximum} bytes, each 0 or 1 (got {len(data)} bytes)")
        return tuple(byte == 1 for byte in data)

    return rule


def each(content: dict[str, Any], rules: dict[str, Rule]) -> dict[str, Any]:
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


def unknown_is_nan(inner: Rule) -> Rule:
    """The same, with NaN for null."""
    return lambda value: math.nan if value is None else inner(value)
