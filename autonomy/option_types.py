"""What options of several verbs take: for argparse's `type`, with errors that say what would be right."""

import argparse
import math
from collections.abc import Callable


def finite(what: str) -> Callable[[str], float]:
    """A finite number, of what is named for the error: "degrees"."""
    return _number(what, lambda number: True)


def above_zero(what: str) -> Callable[[str], float]:
    """A finite number above 0, of what is named for the error: "seconds"."""
    return _number(f"{what} above 0", lambda number: number > 0.0)


def not_negative(what: str) -> Callable[[str], float]:
    """A finite number of at least 0, of what is named for the error: "metres"."""
    return _number(f"{what}, 0 or more", lambda number: number >= 0.0)


def between(least: float, most: float, what: str) -> Callable[[str], float]:
    """A number between two, both included, of what is named for the error: "seconds"."""
    return _number(f"{what} from {least:g} to {most:g}", lambda number: least <= number <= most)


def share(text: str) -> float:
    """A number of at least 0 and below 1."""
    return _number("at least 0 and below 1", lambda number: 0.0 <= number < 1.0)(text)


def whole(least: int) -> Callable[[str], int]:
    """A whole number of at least `least`, which is 0 or more."""

    def parse(text: str) -> int:
        if not (text.isascii() and text.isdecimal() and int(text) >= least):
            raise argparse.ArgumentTypeError(f"must be a whole number from {least} (got {text!r})")
        return int(text)

    return parse


def vehicle_name(text: str) -> str:
    """The name of a vehicle."""
    return _vehicle(text, "must match")


def vehicle_or_all(text: str) -> str:
    """The name of a vehicle, or * for all."""
    return text if text == "*" else _vehicle(text, "must be * or match")


def _vehicle(text: str, right: str) -> str:
    # What goes over the wire takes a while to import: help on a command need not wait for it.
    from autonomy.wire_rules import VEHICLE_NAME

    if not VEHICLE_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"{right} {VEHICLE_NAME.pattern} (got {text!r})")
    return text


def _number(right: str, is_right: Callable[[float], bool]) -> Callable[[str], float]:
    def parse(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and is_right(number)):
            raise argparse.ArgumentTypeError(f"must be {right} (got {text!r})")
        return number

    return parse
