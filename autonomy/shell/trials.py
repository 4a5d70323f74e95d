"""Records that the core does not survive, remembered from run to run.

One that raises is quarantined at once. One that hangs the process or ends it without a word is suspected: which record
is being handled is marked in a file beforehand, and what is marked at the end of two runs in a row is quarantined too.
(A single time may be chance: a service that is killed is often killed while it works.)

It may be what the core knows, and no record, that it does not survive. So it is remembered, too, what a run has gone on
from, and how many in a row went on from the same and ended before they had handled a few records.
"""

import json
import logging
import os
import struct
from collections.abc import Callable
from pathlib import Path

from autonomy.shell.files import cause, open_to_read
from autonomy.shell.journal_files import Position

log = logging.getLogger(__name__)

_REMEMBERED = 200
_MARK = struct.Struct("<QQ")
_UNPROVED = struct.Struct("<Q")
_NONE = Position(0, 0)

PROVED_BY = 10
"""So many records handled, and going on has not come to nothing."""

JOURNAL = "the journal alone"
"""What is gone on from, where it is no checkpoint."""


class Mark:
    """What is being done, in a file that outlives the process (if not the machine: it is never synced)."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._descriptor: int | None = None
        self.found: Position | None = None
        """The record in whose midst the run before this one ended."""
        self.found_unproved = False
        """Whether that run had not handled a few records yet."""
        try:
            self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            content = os.pread(self._descriptor, _MARK.size, 0)
            self.found_unproved = any(os.pread(self._descriptor, _UNPROVED.size, _MARK.size))
        except OSError as error:
            log.error("what is being done can't be marked: %s", cause(error, path))
            return
        if len(content) == _MARK.size and content.strip(b"\0"):
            self.found = Position(*_MARK.unpack(content))

    def set(self, at: Position | None) -> None:
        """The record just before `at` is about to be handled; None: it has been."""
        place = _NONE if at is None else at
        self._write(_MARK.pack(place.run, place.sequence), 0)

    def set_unproved(self, *, unproved: bool) -> None:
        """The core goes on from something, and it is not known yet whether it will handle records."""
        self._write(_UNPROVED.pack(unproved), _MARK.size)

    def _write(self, data: bytes, offset: int) -> None:
        if self._descriptor is None:
            return
        try:
            os.pwrite(self._descriptor, data, offset)
        except OSError as error:
            log.error("what is being done can't be marked any more: %s", cause(error, self._path))
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
        self.source = ""
        """What the last run has gone on from: a checkpoint's name, or `JOURNAL`; empty if it began with nothing."""
        self.failures = 0
        """Runs in a row that went on from it and ended before they had handled a few records."""
        self.journal_tried = False
        """Whether the journal alone has been gone on from, and no run has gone well since."""
        self.handled = 0
        """Records that the core has handled since it was made from the source."""
        self._suspect: Position | None = None
        self._read()
        self._suspect_marked()
        self._judge_last()

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

    def going_on(self, source: str) -> None:
        """The core is about to be made from this; until `proved` that may be the end of the process."""
        if source != self.source:
            self.source, self.failures = source, 0
        self.journal_tried = self.journal_tried or source == JOURNAL
        self._write()
        self.mark.set_unproved(unproved=True)

    def proved(self) -> None:
        """It has handled a few records, or was stopped in order. Does not wait for the disk."""
        self.mark.set_unproved(unproved=False)

    def handled_one(self) -> None:
        """The core has handled another record."""
        self.handled += 1
        if self.handled == PROVED_BY:
            self.proved()

    def stopped_early(self) -> None:
        """Somebody has stopped the service while it was starting: no record and nothing gone on from is to blame."""
        self.mark.set(None)
        self.proved()

    def gave_up(self) -> None:
        """What was gone on from is of no use; the next deserves as many trials."""
        self.crashes = self.failures = 0
        self.source = ""
        self.proved()
        self._write()

    def began_anew(self) -> None:
        """The core knows nothing."""
        known = (self.crashes, self.failures, self.source, self.journal_tried)
        self.crashes, self.failures, self.source, self.journal_tried = 0, 0, "", False
        if any(known):
            self._write()

    def went_well(self) -> None:
        """The service has run for a while, or was stopped in order."""
        self.proved()
        if self.crashes or self.failures or self.journal_tried:
            self.crashes, self.failures, self.journal_tried = 0, 0, False
            self._write()

    def _judge_last(self) -> None:
        """Whether the last run has come to anything."""
        if not self.mark.found_unproved:
            self.failures = 0
        if not self.mark.found_unproved or not self.source:
            return
        self.failures += 1
        log.error(
            "the last run, gone on from %s, ended before it had handled %d records: %d in a row",
            self.source,
            PROVED_BY,
            self.failures,
        )
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
            # Remembered now: if this run ends before it has come to that record, it is not the second time.
            self.mark.set(None)

    def _read(self) -> None:
        try:
            with open_to_read(self._path) as file:
                content = json.loads(file.read(2**20))
            self.crashes = int(content["crashes"])
            self.quarantined = [Position(int(run), int(number)) for run, number in content["quarantined"]]
            self.source = str(content.get("source", ""))
            self.failures = int(content.get("failures", 0))
            self.journal_tried = bool(content.get("journal_tried", False))
            suspect = content.get("suspect")
            self._suspect = None if suspect is None else Position(int(suspect[0]), int(suspect[1]))
        except FileNotFoundError:
            return
        except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
            log.error("%s can't be read and is begun anew: %s", self._path, error)
            self.crashes, self.quarantined, self.source, self.failures = 0, [], "", 0

    def _write(self) -> None:
        suspect = self._suspect
        content = {
            "crashes": self.crashes,
            "quarantined": [[at.run, at.sequence] for at in self.quarantined],
            "suspect": None if suspect is None else [suspect.run, suspect.sequence],
            "source": self.source,
            "failures": self.failures,
            "journal_tried": self.journal_tried,
        }
        try:
            self._write_file(self._path, json.dumps(content).encode())
        except OSError as error:
            log.error("%s can't be written: %s", self._path, error.strerror)
