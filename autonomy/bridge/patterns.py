"""What a line says, by the three shapes that it may have: columns, a regular expression, an NMEA sentence.

Regular expressions come from a configuration, lines from outside, and some of the former take exponentially long on
some of the latter (`(\\d+)+x`). Lines are short (`lines.LONGEST_LINE`), and the `regex` package gives a match up after
`MATCH_S`: such a line counts as unreadable, and nothing else of the bridge is held up. Python's own `re` can't do that.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping

import regex

Field = int | str
Fields = Mapping[Field, str]

MATCH_S = 0.01
"""Usual matches take some microseconds; five times as long as this, at 20 lines a second, would be all of a core."""

LONGEST_PATTERN = 200_000
"""Characters and classes, counted repetitions written out, as `regex` does: 30 MB, and a tenth of a second."""

_REPETITION = re.compile(r"(\)?)\{([^{}]*)\}")
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?")
LARGEST = 3.4e38
"""Of a MAVLink float."""

TOO_LARGE = "a number is too large"
_SENTENCE = re.compile(r"\$(?P<body>[ -)+-~]*)(?:\*(?P<sum>[0-9A-Fa-f]{2}))?")


class PatternError(ValueError):
    """A regular expression that can't be used; says why."""


class LineError(ValueError):
    """A line that can't be read; says why, in words that are the same for all lines of that kind."""


class OtherSentenceError(LineError):
    """A sound sentence that is not the one: instruments send several kinds, and nothing is wrong with that."""


class Reader(ABC):
    """Finds the fields of a line."""

    fields: str
    """What a field may be, in words."""

    @abstractmethod
    def read(self, line: str) -> Fields:
        """The text of every field; LineError if it is no such line."""

    @abstractmethod
    def why_not(self, field: Field) -> str | None:
        """Why there is no such field; None if there may be."""


def number(text: str, decimal: str = ".") -> float:
    """The number that a field says; LineError if it says none. Not all that Python takes for one is: "1_0", "nan"."""
    text = text.strip()
    if decimal == ",":
        text = text.replace(".", "#").replace(",", ".")
    if not _NUMBER.fullmatch(text):
        raise LineError("a field that should be a number is empty" if not text else "a field is no number")
    value = float(text)
    if not abs(value) <= LARGEST:
        raise LineError(TOO_LARGE)
    return value


class Columns(Reader):
    """So many columns between separators; a separator of mere space is any amount of it."""

    def __init__(self, separator: str, columns: int) -> None:
        self._separator = separator.strip() or None
        self._columns = columns
        self.fields = f"a column from 1 to {columns}"

    def read(self, line: str) -> Fields:
        """See `Reader.read`."""
        parts = line.split(self._separator)
        if len(parts) != self._columns:
            raise LineError(f"not {self._columns} columns")
        return {place: part.strip() for place, part in enumerate(parts, start=1)}

    def why_not(self, field: Field) -> str | None:
        """See `Reader.why_not`."""
        there = isinstance(field, int) and field <= self._columns
        return None if there else f"is no column of a line that has {self._columns} (got {field})"


class Pattern(Reader):
    """A regular expression that all of a line must match; PatternError if it is none, or names no groups."""

    def __init__(self, pattern: str) -> None:
        if written_out(pattern) > LONGEST_PATTERN:
            raise PatternError(f"what it repeats, {{n}}, comes to more than {LONGEST_PATTERN} characters")
        try:
            self._pattern = regex.compile(pattern)
        except RecursionError:
            raise PatternError("its groups are nested too deeply") from None
        except (regex.error, ValueError, OverflowError) as error:
            raise PatternError(f"not a regular expression: {error}") from None
        self._groups = sorted(self._pattern.groupindex)
        if not self._groups:
            raise PatternError("has no named groups")
        self.fields = f"a group of the pattern: {', '.join(self._groups)}"

    def read(self, line: str) -> Fields:
        """See `Reader.read`."""
        try:
            match = self._pattern.fullmatch(line, timeout=MATCH_S)
        except TimeoutError:
            raise LineError("the pattern took too long") from None
        if match is None:
            raise LineError("does not match the pattern")
        return {name: text for name, text in match.groupdict().items() if text is not None}

    def why_not(self, field: Field) -> str | None:
        """See `Reader.why_not`."""
        return None if field in self._groups else f"is no group of the pattern (got {field})"


class Sentence(Reader):
    """An NMEA 0183 sentence with its checksum."""

    fields = "a field of the sentence, from 1, not counting its address"

    def __init__(self, sentence: str, *, checksum_required: bool) -> None:
        self._wanted = sentence
        self._checksum_required = checksum_required

    def read(self, line: str) -> Fields:
        """See `Reader.read`."""
        match = _SENTENCE.fullmatch(line)
        if match is None:
            raise LineError("no NMEA sentence")
        address, *parts = match["body"].split(",")
        told = match["sum"]
        if told is not None and int(told, 16) != checksum(match["body"]):
            raise LineError("wrong checksum")
        if not self._is_wanted(address):
            raise OtherSentenceError("another sentence")
        if told is None and self._checksum_required:
            raise LineError("no checksum")
        return {place: part.strip() for place, part in enumerate(parts, start=1)}

    def _is_wanted(self, address: str) -> bool:
        if len(self._wanted) == 3 and not self._wanted.startswith("P"):
            return len(address) == 5 and not address.startswith("P") and address[2:] == self._wanted
        return address == self._wanted

    def why_not(self, field: Field) -> str | None:
        """See `Reader.why_not`."""
        return None if isinstance(field, int) else f"is no number of a field (got {field})"


def written_out(pattern: str) -> int:
    """No fewer than the characters of a regular expression whose counted repetitions are written out."""
    # With the flag x space and comments are nothing, even within braces.
    bare = re.sub(r"#[^\n]*|\s", "", pattern)
    return max(_written_out(pattern), _written_out(bare))


def _written_out(pattern: str) -> int:
    """As if all groups that are repeated lay in one another."""
    groups, others = [1], [len(pattern)]
    for group, bounds in _REPETITION.findall(pattern):
        most = max(_count(bound) for bound in bounds.split(","))
        (groups if group else others).append(max(most, 1))
    return math.prod(groups) * sum(others)


def _count(bound: str) -> int:
    digits = re.sub(r"[^0-9]", "", bound)
    return int(digits or 0) if len(digits) < 7 else LONGEST_PATTERN


def checksum(body: str) -> int:
    """Of an NMEA 0183 sentence: all characters between $ and *, combined by exclusive or."""
    total = 0
    for byte in body.encode("latin-1"):
        total ^= byte
    return total
