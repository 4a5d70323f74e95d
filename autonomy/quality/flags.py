"""QARTOD's flags, its tests by name, and how the flags of one reading are summed up."""

from collections.abc import Collection
from enum import IntEnum


class Flag(IntEnum):
    """Primary flags (IOC 54:V3, QARTOD)."""

    GOOD = 1
    NOT_EVALUATED = 2
    SUSPECT = 3
    FAIL = 4
    MISSING = 9


class Check(IntEnum):
    """The tests; the value is the flag's place among the flags of a reading."""

    TIMING = 0
    SYNTAX = 1
    GROSS_RANGE = 2
    LOCATION = 3
    SPIKE = 4
    RATE_OF_CHANGE = 5
    FLAT_LINE = 6


Flags = tuple[Flag, ...]
"""One flag for each `Check`, in its order."""

_SEVERITY = {Flag.MISSING: 0, Flag.NOT_EVALUATED: 1, Flag.GOOD: 2, Flag.SUSPECT: 3, Flag.FAIL: 4}


def aggregate(flags: Flags) -> Flag:
    """The flag of a reading: the worst of its tests'; MISSING where there is no value to be good or bad.

    As in QARTOD's roll-up, a test that wasn't evaluated takes nothing from one that was passed.
    """
    if flags[Check.SYNTAX] is Flag.MISSING:
        return Flag.MISSING
    return max(flags, key=_SEVERITY.__getitem__)


class Tally:
    """How many readings got which flag, for each test and summed up."""

    def __init__(self) -> None:
        self._counts = {name: dict.fromkeys(Flag, 0) for name in ("aggregate", *map(_name, Check))}
        self._rows = tuple(self._counts[_name(check)] for check in Check)

    def add(self, flags: Flags) -> None:
        """Count one reading."""
        self._counts["aggregate"][aggregate(flags)] += 1
        for row, flag in zip(self._rows, flags, strict=True):
            row[flag] += 1

    def add_missing(self, count: int) -> None:
        """Count readings that were due and did not come."""
        self._counts["aggregate"][Flag.MISSING] += count
        self._counts[_name(Check.TIMING)][Flag.MISSING] += count

    @property
    def counts(self) -> dict[str, tuple[int, ...]]:
        """Readings flagged 1, 2, 3, 4 and 9, by the test's name in small letters, and as `aggregate`."""
        return {name: tuple(counts.values()) for name, counts in self._counts.items()}


def refused_by(flags: Flags, allowed: Collection[Flag]) -> Check | None:
    """The test for which a reading isn't among the allowed flags, the worst first; None if it is allowed."""
    if aggregate(flags) in allowed:
        return None
    if flags[Check.SYNTAX] is Flag.MISSING:
        return Check.SYNTAX
    return max(Check, key=lambda check: (_SEVERITY[flags[check]], -check))


def _name(check: Check) -> str:
    return check.name.lower()
