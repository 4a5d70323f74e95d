"""The files of a journal: their names, and reading them again.

A folder holds runs, one for each start of the service, numbered from 1; each run has files, numbered from 1:
`run000012-0003.journal` and, beside it, the MAVLink stream of the same time as `run000012-0003.tlog`.
"""

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from autonomy.events import Event
from autonomy.frames import Damage, Frame, scan
from autonomy.records import Happened, Header, Record, RecordDecoder, RecordError, Resumed

log = logging.getLogger(__name__)

SCHEMA = "halocline/journal"
VERSION = 1
SHAPES = ("ground", "obstacles", "water", "navigable")
"""The parts of a survey area that a header holds, as WKB in local metres."""

SUFFIX, STREAM_SUFFIX = ".journal", ".tlog"
_NAME = re.compile(r"run(\d{6,9})-(\d{4,9})\.(journal|tlog)")


class JournalError(ValueError):
    """Files that can't be read as a journal of ours; says which and why."""


@dataclass(frozen=True, order=True)
class Position:
    """The place just after a record: its run, and its number in that run. (run, 0) is the run's beginning.

    It stays true whatever becomes of the files. Records, of events and of effects, are numbered from 1.
    """

    run: int
    sequence: int


@dataclass(frozen=True)
class Recorded:
    """An event from a journal: where it stands, when it happened by its run's protocol time, and what it was.

    Where a run goes on after a restart, `event` is a `Resumed`: `Core.resume(now, event.away_s)` was called.
    """

    position: Position
    now: float
    event: Event | Resumed


@dataclass(frozen=True)
class Entry:
    """A record of any kind, and where it stands."""

    position: Position
    record: Record


@dataclass(frozen=True)
class Trouble:
    """Records that can't be read. `lost` is how many, where that is known; `torn` if it is merely the end of a file."""

    text: str
    lost: int | None
    torn: bool


@dataclass(frozen=True, order=True)
class JournalFile:
    """One file of a journal."""

    run: int
    number: int
    path: Path

    @property
    def stream(self) -> Path:
        """The MAVLink stream beside it."""
        return self.path.with_suffix(STREAM_SUFFIX)


def file_name(run: int, number: int) -> str:
    """The name of a run's file."""
    return f"run{run:06d}-{number:04d}{SUFFIX}"


def journal_files(folder: Path) -> list[JournalFile]:
    """The journal's files, oldest first, and nothing else of such a name. OSError if the folder can't be read."""
    return sorted(
        JournalFile(run, number, path)
        for path, run, number in _named(folder)
        if path.suffix == SUFFIX and path.is_file()
    )


def highest_run(folder: Path) -> int:
    """The highest number of a run in any name in the folder, whatever bears it; 0 if there is none."""
    return max((run for _, run, _ in _named(folder)), default=0)


def _named(folder: Path) -> Iterator[tuple[Path, int, int]]:
    for path in folder.iterdir():
        match = _NAME.fullmatch(path.name)
        if match is not None:
            yield path, int(match[1]), int(match[2])


def read_header(path: Path) -> dict[str, object]:
    """What the first sound header of a file says.

    Raises:
        JournalError: it is no journal, or one of another version.
        OSError: the file can't be read.
    """
    decoder = RecordDecoder()
    with path.open("rb") as file:
        for part in scan(file):
            if isinstance(part, Frame):
                try:
                    record = decoder.decode(part.payload)
                except RecordError:
                    continue
                if isinstance(record, Header):
                    return _checked(path, record.content)
    raise JournalError(f"{path}: is no journal, or its header is damaged")


def read_from(folder: Path, position: Position) -> Iterator[Recorded]:
    """Every event after `position`, oldest first: the rest of that run, and all of the later ones.

    What is damaged is left out, and told in the log with file and place.

    Raises:
        JournalError: a file is of another version.
        OSError: a file can't be read.
    """
    for part in read_entries(folder, position):
        if isinstance(part, Trouble):
            if not part.torn:
                log.warning("%s", part.text)
        elif isinstance(part.record, Resumed):
            yield Recorded(part.position, part.record.now, part.record)
        elif isinstance(part.record, Happened):
            yield Recorded(part.position, part.record.now, part.record.event)


def read_entries(folder: Path, after: Position, last_run: int | None = None) -> Iterator[Entry | Trouble]:
    """Every record after a position, up to the end of `last_run` (None: of the newest), and what can't be read.

    Raises:
        JournalError: a file is of another version.
        OSError: a file can't be read.
    """
    files = [
        file for file in journal_files(folder) if after.run <= file.run and file.run <= (last_run or file.run)
    ]
    decoder = RecordDecoder()
    reached = after
    for i, file in enumerate(files):
        if file.run != reached.run:
            reached = Position(file.run, 0)
        following = files[i + 1] if i + 1 < len(files) and files[i + 1].run == file.run else None
        if following is not None and _begins_at_most(following.path, after):
            continue
        for part in _parts(file, decoder, reached):
            if isinstance(part, Entry):
                reached = part.position
            yield part


def _begins_at_most(path: Path, after: Position) -> bool:
    """Whether all records before this file come before a position too."""
    try:
        first = read_header(path).get("first_record")
    except JournalError:
        return False
    return isinstance(first, int) and first <= after.sequence + 1 and _run_of(path) == after.run


def _run_of(path: Path) -> int:
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else 0


def _parts(file: JournalFile, decoder: RecordDecoder, reached: Position) -> Iterator[Entry | Trouble]:
    with file.path.open("rb") as opened:
        for part in scan(opened):
            if isinstance(part, Damage):
                place = f"{file.path} bytes {part.offset} to {part.end}"
                text = f"{place}: the end is torn" if part.torn else f"{place}: damaged, left out"
                yield Trouble(text, None, part.torn)
                continue
            found = _record(file, part, decoder)
            if isinstance(found, Trouble):
                reached = Position(file.run, part.sequence)
                yield found
            elif isinstance(found, Header):
                _checked(file.path, found.content)
            elif part.sequence > reached.sequence:
                missing = part.sequence - reached.sequence - 1
                if missing:
                    yield Trouble(
                        f"{file.path} byte {part.offset}: {missing} records before it are missing",
                        missing,
                        False,
                    )
                reached = Position(file.run, part.sequence)
                yield Entry(reached, found)


def _record(file: JournalFile, frame: Frame, decoder: RecordDecoder) -> Record | Trouble:
    try:
        return decoder.decode(frame.payload)
    except RecordError as error:
        return Trouble(f"{file.path} byte {frame.offset}: the record {error}; left out", 1, False)


def _checked(path: Path, content: dict[str, object]) -> dict[str, object]:
    schema, version = content.get("schema"), content.get("version")
    if schema != SCHEMA:
        raise JournalError(f"{path}: is no journal of this software: its schema is {str(schema)[:80]!r}")
    if version != VERSION:
        newer = isinstance(version, int) and version > VERSION
        which = "a newer" if newer else "another"
        raise JournalError(
            f"{path}: is of {which} version, {str(version)[:20]}; this software reads {VERSION}"
        )
    return content
