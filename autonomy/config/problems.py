"""Where a configuration value comes from, and what is wrong with it."""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum


class Source(Enum):
    """The four layers of a configuration; each overrides the ones before it."""

    DEFAULT = "default"
    FILE = "file"
    ENVIRONMENT = "environment"
    COMMAND_LINE = "command line"


@dataclass(frozen=True)
class Origin:
    """Where a value comes from.

    Attributes:
        source: the layer.
        name: the file's name, the environment variable, or the option with its key; empty for a default.
        line: 1 for the first line of the file; None outside files, and for the file as a whole.
        column: 1 for the first character of the line.
    """

    source: Source
    name: str = ""
    line: int | None = None
    column: int | None = None

    def __str__(self) -> str:
        if self.source is Source.FILE:
            return ":".join(str(part) for part in (self.name, self.line, self.column) if part is not None)
        return f"{self.source.value} {self.name}".rstrip()


DEFAULT = Origin(Source.DEFAULT)


def printable(text: str) -> str:
    """The text itself, or its escaped form where a terminal would choke on it."""
    return text if text.isprintable() else ascii(text)


@dataclass(frozen=True)
class Problem:
    """One mistake: where it is, at which key (dotted; may be empty), what is wrong, what would be right."""

    origin: Origin
    key: str
    what: str
    allowed: str = ""

    @property
    def file(self) -> str:
        """The file's name, the environment variable or the option."""
        return self.origin.name

    @property
    def line(self) -> int | None:
        """Line in the file, from 1."""
        return self.origin.line

    @property
    def column(self) -> int | None:
        """Column in the line, from 1."""
        return self.origin.column

    def __str__(self) -> str:
        parts = [str(self.origin), printable(self.key), self.what]
        line = ": ".join(part for part in parts if part)
        return f"{line}; allowed: {self.allowed}" if self.allowed else line


class ConfigurationError(ValueError):
    """A configuration that can't be used; `problems` are all its mistakes, in the order of the file."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(sorted(problems, key=_order))
        super().__init__("\n".join(map(str, self.problems)))


def _order(problem: Problem) -> tuple[bool, str, int, int]:
    origin = problem.origin
    return (origin.source is not Source.FILE, origin.name, origin.line or 0, origin.column or 0)
