"""What options of several verbs take: for argparse's `type`, with errors that say what would be right."""

import argparse
import math
from collections.abc import Callable

from autonomy.wire_rules import VEHICLE_NAME


def above_zero(what: str) -> Callable[[str], float]:
    """A finite number above 0, of what is named for the error: "seconds"."""

    def parse(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not 0.0 < number < math.inf:
            raise argparse.ArgumentTypeError(f"must be {what} above 0 (got {text!r})")
        return number

    return parse


def vehicle_or_all(text: str) -> str:
    """The name of a vehicle, or * for all."""
    if text != "*" and not VEHICLE_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"must be * or match {VEHICLE_NAME.pattern} (got {text!r})")
    return text
