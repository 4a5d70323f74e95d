"""A journal on a disk that fails in every way, with kills and power cuts: what was said to be safe is safe.

The model is a list of what was handed in, and what the disk was made to forget. HALOCLINE_EXAMPLES: how many
sequences; without it 120.
"""

import errno
import os
import shutil
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from autonomy.events import LinkDown
from autonomy.frames import Frame, scan
from autonomy.records import Happened, encode_event
from autonomy.shell.journal_files import (
    SCHEMA,
    VERSION,
    Entry,
    Position,
    Trouble,
    journal_files,
    read_entries,
)
from autonomy.shell.journal_store import Limits, Packet, Row, Store

FILE_BYTES, FILE_AGE_S, TOTAL_BYTES = 900, 60.0, 5000
LIMITS = Limits(FILE_BYTES, FILE_AGE_S, TOTAL_BYTES)
PLENTY = 10**9
HEADER = {"schema": SCHEMA, "version": VERSION}
Place = tuple[int, int]
"""A record's run and number."""


def failure(number: int) -> OSError:
    return OSError(number, os.strerror(number))


def text_of(place: Place, size: int) -> str:
    return f"{place[0]}/{place[1]} " + "x" * size


class Disk:
    """A folder on a disk that can be full, fail, and forget what was not synced when the power goes."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.folder = folder
        self.free_bytes: int | None = None
        self.write_fails = self.truncate_fails = False
        self.sync_fails: tuple[str, ...] = ()
        """Kinds of files that can't be synced."""
        self.short: int | None = None
        """Most bytes that one write takes."""
        self.synced: dict[Path, int] = {}
        self.forgotten: set[Path] = set()
        """Files that a sync failed for: what came after the last good one is never written, whatever is said later."""
        self.given_up: set[Place] = set()
        """Sound records in files that the store has removed."""
        self.uncut: set[Place] = set()
        """Sound records of a batch that failed as a whole, but could not be cut off again: they count as lost."""
        self._sync, self._truncate, self._unlink = os.fsync, os.ftruncate, Path.unlink
        patch.setattr(os, "fsync", self.fsync)
        patch.setattr(os, "ftruncate", self.ftruncate)

        def unlink(path: Path, missing_ok: bool = False) -> None:
            self.unlink(path, missing_ok)

        patch.setattr(Path, "unlink", unlink)

    @property
    def used(self) -> int:
        return sum(path.stat().st_size for path in self.folder.iterdir())

    def room(self) -> int:
        return PLENTY if self.free_bytes is None else max(0, self.free_bytes - self.used)

    def write(self, descriptor: int, data: bytes) -> int:
        if self.write_fails:
            raise failure(errno.EIO)
        room = self.room()
        if room == 0:
            raise failure(errno.ENOSPC)
        return os.write(descriptor, data[: min(room, self.short or PLENTY)])

    def fsync(self, descriptor: int) -> None:
        path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
        if not path.is_relative_to(self.folder):
            self._sync(descriptor)
        elif path.suffix in self.sync_fails:
            self.forgotten.add(path)
            raise failure(errno.EIO)
        elif path not in self.forgotten:
            self.synced[path] = os.fstat(descriptor).st_size

    def ftruncate(self, descriptor: int, length: int) -> None:
        if self.truncate_fails:
            path = Path(os.readlink(f"/proc/self/fd/{descriptor}"))
            if path.suffix == ".journal":
                self.uncut |= {place for place, _, end in frames(path) if end > length}
            raise failure(errno.EIO)
        self._truncate(descriptor, length)

    def unlink(self, path: Path, missing_ok: bool = False) -> None:
        if path.parent == self.folder and path.suffix == ".journal" and path.exists():
            # What a failed sync left in doubt was counted as lost before.
            sure = self.synced.get(path, 0) if path in self.forgotten else PLENTY
            self.given_up |= {place for place, _, end in frames(path) if end <= sure} - self.uncut
        self._unlink(path, missing_ok=missing_ok)

    def files(self) -> list[Path]:
        return sorted(path for path in self.folder.iterdir() if path.suffix in (".journal", ".tlog"))

    def lose_power(self, kept: float, garbage: bool) -> None:
        """Every file ends somewhere behind what was synced, perhaps in bytes that were never written to it."""
        for path in self.files():
            whole = path.read_bytes()
            safe = min(self.synced.get(path, 0), len(whole))
            end = safe + int(kept * (len(whole) - safe))
            tail = bytes(end - safe) if garbage else whole[safe:end]
            path.write_bytes(whole[:safe] + tail)


def frames(path: Path) -> list[tuple[Place, int, int]]:
    """The sound records of a file, headers left out, with the bytes that they take."""
    run = int(path.name[3:9])
    with path.open("rb") as file:
        parts = [part for part in scan(file) if isinstance(part, Frame)]
    return [((run, part.sequence), part.offset, part.end) for part in parts if b"schema" not in part.payload]


class JournalMachine(RuleBasedStateMachine):
    """One folder and the runs in it."""

    @initialize()
    def begin(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="journal-"))
        self.patch = pytest.MonkeyPatch()
        self.disk = Disk(self.folder, self.patch)
        self.now = 0.0
        self.store: Store | None = None
        self.handed_in: dict[Place, str] = {}
        self.runs: set[int] = set()
        """Those that left something, or that a checkpoint stands in."""
        self.safe: set[Place] = set()
        """Records that were said to be on the disk."""
        self.next = 1
        self.counted_though_there: set[Place] = set()
        """Records counted as lost since nobody can tell, though they can be read until the power goes."""
        self.found: list[Place] = []
        self.checkpoint: Position | None = None
        self.damaged: set[tuple[Path, int]] = set()
        self.open()

    def teardown(self) -> None:
        if self.store is not None:
            self.heal(0.0)
            self.store.close()
        self.patch.undo()
        shutil.rmtree(self.folder)

    # What happens ------------------------------------------------------------------------------------------------

    def open(self) -> None:
        resumed = None if self.checkpoint is None else [self.checkpoint.run, self.checkpoint.sequence]
        self.store = Store(
            self.folder,
            LIMITS,
            {**HEADER, "resumed": resumed},
            clock=lambda: self.now,
            write=self.disk.write,
            free=lambda _folder: self.disk.room(),
        )
        self.next = 1
        self.counted_though_there = set()
        self.disk.given_up, self.disk.uncut = set(), set()
        assert self.store.run not in self.runs
        assert self.store.run > max(self.runs, default=0)

    @precondition(lambda self: self.store is not None)
    @rule(
        sizes=st.lists(st.integers(0, 300), min_size=1, max_size=4),
        packets=st.integers(0, 2),
        then_sync=st.booleans(),
    )
    def write(self, sizes: list[int], packets: int, then_sync: bool) -> None:
        assert self.store is not None
        items: list[Row | Packet] = []
        for size in sizes:
            place = (self.store.run, self.next)
            self.handed_in[place] = text_of(place, size)
            items.append(Row(self.next, encode_event(self.now, LinkDown(self.handed_in[place]))))
            self.next += 1
        items += [Packet(self.next, bytes(40))] * packets
        self.watched(lambda: self.store.write(items))
        assert self.disk.used <= TOTAL_BYTES
        self.runs.add(self.store.run)
        if then_sync:
            self.watched(self.store.sync)

    def watched(self, act: Any) -> None:
        """Do something that may sync; note what was said to be safe then, and what a failed sync leaves in doubt."""
        assert self.store is not None
        act()
        for path in self.disk.forgotten:
            if path.suffix == ".journal" and path.exists():
                safe = self.disk.synced.get(path, 0)
                doubtful = {place for place, _, end in frames(path) if end > safe}
                self.counted_though_there |= {place for place in doubtful if place[0] == self.store.run}
        self.counted_though_there |= self.disk.uncut
        self.read()
        said = self.store.synced
        there = {place for place in self.found if place[0] == said.run and place[1] <= said.sequence}
        self.safe |= there - self.counted_though_there
        self.safe -= self.disk.given_up
        self.checkpoint = said if said.sequence else self.checkpoint

    @precondition(lambda self: self.store is not None)
    @rule(room=st.integers(0, 2500), cannot_be_cut=st.booleans(), most=st.sampled_from([None, 7, 50]))
    def disk_fills(self, room: int, cannot_be_cut: bool, most: int | None) -> None:
        self.disk.free_bytes = self.disk.used + room
        self.disk.truncate_fails, self.disk.short = cannot_be_cut, most

    @precondition(lambda self: self.store is not None)
    @rule(cannot_be_cut=st.booleans())
    def writes_fail(self, cannot_be_cut: bool) -> None:
        self.disk.write_fails, self.disk.truncate_fails = True, cannot_be_cut

    @precondition(lambda self: self.store is not None)
    @rule(kinds=st.sampled_from([(".journal",), (".tlog",), (".journal", ".tlog")]))
    def syncs_fail(self, kinds: tuple[str, ...]) -> None:
        self.disk.sync_fails = kinds

    @precondition(lambda self: self.store is not None)
    @rule(seconds=st.sampled_from([0.0, 5.0]))
    def heal(self, seconds: float) -> None:
        self.disk.free_bytes = self.disk.short = None
        self.disk.write_fails = self.disk.truncate_fails = False
        self.disk.sync_fails = ()
        self.now += seconds

    @precondition(lambda self: self.store is not None)
    @rule(seconds=st.sampled_from([0.5, 5.0, 61.0]))
    def time_passes(self, seconds: float) -> None:
        self.now += seconds

    @precondition(lambda self: self.store is not None)
    @rule(orderly=st.booleans())
    def end(self, orderly: bool) -> None:
        """By itself, or killed without a word: the system still has what it was given."""
        assert self.store is not None
        if orderly:
            self.watched(self.store.sync)
        self.store._shut()
        os.close(self.store._lock)
        self.store = None

    @rule(kept=st.floats(0, 1), garbage=st.booleans())
    def power_cut(self, kept: float, garbage: bool) -> None:
        if self.store is not None:
            self.end(orderly=False)
        self.disk.lose_power(kept, garbage)
        self.disk.synced = {path: path.stat().st_size for path in self.disk.files()}
        self.disk.forgotten = set()

    @precondition(lambda self: self.store is None)
    @rule(
        which=st.floats(0, 1, exclude_max=True),
        place=st.floats(0, 1, exclude_max=True),
        bit=st.integers(0, 7),
    )
    def byte_is_damaged(self, which: float, place: float, bit: int) -> None:
        files = [path for path in self.disk.files() if path.suffix == ".journal" and path.stat().st_size]
        if not files:
            return
        path = files[int(which * len(files))]
        content = bytearray(path.read_bytes())
        at = int(place * len(content))
        if (path, at) in self.damaged:
            return  # the same bit twice would mend it
        self.damaged.add((path, at))
        hit = {record for record, offset, end in frames(path) if offset <= at < end}
        content[at] ^= 1 << bit
        path.write_bytes(content)
        before = self.found
        self.read()
        assert self.found == [record for record in before if record not in hit]
        self.safe -= hit

    @precondition(lambda self: self.store is None)
    @rule()
    def all_files_are_removed(self) -> None:
        for path in self.disk.files():
            self.disk._unlink(path)
            # A file of the same name is another one.
            self.disk.synced.pop(path, None)
        self.safe = set()
        # Without a checkpoint nothing tells that there ever was a run: then the first is the first again.
        self.runs = set() if self.checkpoint is None else {self.checkpoint.run}
        self.handed_in = {}

    @precondition(lambda self: self.store is None)
    @rule(with_checkpoint=st.booleans())
    def reopen(self, with_checkpoint: bool) -> None:
        if not with_checkpoint:
            self.checkpoint = None
        named = {file.run for file in journal_files(self.folder)}
        self.runs = named | ({self.checkpoint.run} if self.checkpoint is not None else set())
        self.handed_in = {place: text for place, text in self.handed_in.items() if place[0] in self.runs}
        self.open()

    # What holds whatever happens ---------------------------------------------------------------------------------

    def read(self) -> None:
        """Everything that can be read: in order, none twice, as it was handed in, with the gaps told."""
        found: list[Place] = []
        told: Counter[int] = Counter()
        missing = 0
        for part in read_entries(self.folder, Position(0, 0)):
            if isinstance(part, Trouble):
                missing += part.lost or 0
                continue
            assert isinstance(part, Entry)
            assert isinstance(part.record, Happened)
            place = (part.position.run, part.position.sequence)
            assert part.record.event == LinkDown(self.handed_in[place])
            told[place[0]] += missing
            missing = 0
            found.append(place)
        assert found == sorted(set(found))
        assert missing == 0, "what is missing is told before the next sound record"
        for run in {run for run, _ in found}:
            sound = [number for each, number in found if each == run]
            assert told[run] == max(sound) - len(sound)
        self.found = found

    @invariant()
    def what_was_said_to_be_safe_is_there(self) -> None:
        self.read()
        assert self.safe <= set(self.found)

    @invariant()
    def what_is_missing_was_counted(self) -> None:
        if self.store is None:
            return
        mine = {place for place in self.found if place[0] == self.store.run}
        kept = (mine | {place for place in self.disk.given_up if place[0] == self.store.run}) - (
            self.counted_though_there
        )
        assert self.store.lost_records == self.next - 1 - len(kept)

    @invariant()
    def a_trouble_is_told(self) -> None:
        if self.store is not None and self.store._open is None and self.store.lost_records:
            assert self.store.trouble


TestJournal = JournalMachine.TestCase
TestJournal.settings = settings(
    max_examples=int(os.environ.get("HALOCLINE_EXAMPLES", "120")),
    stateful_step_count=30,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
