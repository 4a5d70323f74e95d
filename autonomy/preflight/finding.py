"""What a check comes to: good or not, in words, and what to do about it."""

from dataclasses import dataclass
from enum import Enum


class Grade(Enum):
    """How bad it is."""

    PASS = "pass"
    """As it should be."""

    WARN = "warn"
    """The survey can be sailed, but somebody should know."""

    FAIL = "fail"
    """The survey would not start, not be safe, or teach nothing."""

    SKIP = "skip"
    """Not to be told, since something else is missing."""


@dataclass(frozen=True)
class Finding:
    """One line of the table.

    Attributes:
        check: its name, such as `sensor.name`; the same for every run.
        grade: how bad it is.
        says: what was found.
        remedy: what to do; empty for what is as it should be.
    """

    check: str
    grade: Grade
    says: str
    remedy: str = ""

    @property
    def topic(self) -> str:
        """What it is about: the first part of the check's name."""
        return self.check.partition(".")[0]


def passed(check: str, says: str) -> Finding:
    """As it should be."""
    return Finding(check, Grade.PASS, says)


def warned(check: str, says: str, remedy: str) -> Finding:
    """Somebody should know."""
    return Finding(check, Grade.WARN, says, remedy)


def failed(check: str, says: str, remedy: str) -> Finding:
    """Not to be sailed with."""
    return Finding(check, Grade.FAIL, says, remedy)


def skipped(check: str, why: str) -> Finding:
    """Not to be told."""
    return Finding(check, Grade.SKIP, f"not checked: {why}")
