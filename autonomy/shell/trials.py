"""Records that the core does not survive, remembered from run to run.

One that raises is quarantined at once. One that hangs the process or ends it without a word is suspected: which record
is being handled is marked in a file beforehand, and what is marked at the end of two runs in a row is quarantined too.
(A single time may be chance: a service that is killed is often killed while it works.)
"""

import json
import logging
import os
import struct
from collections.abc import Callable
from pathlib import Path

from autonomy.shell.journal_files import Position

log = logging.getLogger(__name__)

_REMEMBERED = 200
_MARK = struct.Struct("<QQ")
_NONE = Position(0, 0)


class Mark:
    """Which record is being handled, in a file that outlives the process (if not the machine: it is never synced)."""

    def __init__(self, path: Path) -> None:
        self._descriptor: int | None = None
        self.found: Position | None = None
        """The record in whose midst the run before this one ended."""
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            content = os.pread(self._descriptor, _MARK.size, 0)
        except OSError as error:
            log.error("%s can't be used: %s", path, error)
            return
        if len(content) == _MARK.size and content.strip(b"\0"):
            self.found = Position(*_MARK.unpack(content))

    def set(self, at: Position | None) -> None:
        """The record just before `at` is about to be handled; None: it has been."""
        if self._descriptor is None:
            return
        place = _NONE if at is None else at
        try:
            os.pwrite(self._descriptor, _MARK.pack(place.run, place.sequence), 0)
        except OSError as error:
            log.error("the record being handled can't be marked any more: %s", error)
            self.close()

    def close(self) -> None:
        """Nothing is marked from now on."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None


class Trials:
    """What went wrong in earlier runs, kept in two files beside the checkpoints.

    Args:
        folder: of the checkpoints.
        write: replaces a file, whole.
    """

    def __init__(self, folder: Path, write: Callable[[Path, bytes], None]) -> None:
        self._path = folder / "trials.json"
        self._write_file = write
        self.mark = Mark(folder / "mark")
        self.crashes = 0
        """Runs in a row that the core itself has ended early."""
        self.quarantined: list[Position] = []
        """Records that have crashed the core."""
        self._suspect: Position | None = None
        self._read()
        self._suspect_marked()

    def crashed(self, at: Position | None) -> None:
        """The core has raised on the record just before `at`."""
        self.crashes += 1
        self.quarantine(at)

    def quarantine(self, at: Position | None) -> None:
        """The record just before `at`, if any, is not to be handled again."""
        self.mark.set(None)
        if at is not None and at not in self.quarantined:
            self.quarantined = [*self.quarantined, at][-_REMEMBERED:]
        self._write()

    def went_well(self) -> None:
        """The service has run for a while, or was stopped in order."""
        if self.crashes:
            self.crashes = 0
            self._write()

    def _suspect_marked(self) -> None:
        """The last run ended in the midst of a record, by whatever cause; the second time the record is to blame."""
        before, self._suspect = self._suspect, self.mark.found
        if self._suspect is not None and self._suspect == before:
            place = (before.sequence, before.run)
            log.error(
                "the service ended twice in the midst of record %d of run %d: it is quarantined", *place
            )
            self.crashed(before)
        elif self._suspect != before:
            self._write()

    def _read(self) -> None:
        try:
            content = json.loads(self._path.read_bytes()[: 2**20])
            self.crashes = int(content["crashes"])
            self.quarantined = [Position(int(run), int(number)) for run, number in content["quarantined"]]
            suspect = content.get("suspect")
            self._suspect = None if suspect is None else Position(int(suspect[0]), int(suspect[1]))
        except FileNotFoundError:
            return
        except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            log.error("%s can't be read and is begun anew: %s", self._path, error)
            self.crashes, self.quarantined = 0, []

    def _write(self) -> None:
        suspect = self._suspect
        content = {
            "crashes": self.crashes,
            "quarantined": [[at.run, at.sequence] for at in self.quarantined],
            "suspect": None if suspect is None else [suspect.run, suspect.sequence],
        }
        try:
            self._write_file(self._path, json.dumps(content).encode())
        except OSError as error:
            log.error("%s can't be written: %s", self._path, error)
