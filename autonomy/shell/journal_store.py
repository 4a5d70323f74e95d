"""A journal's files being written: rotated by size and age, bounded together, synced; a full disk costs the oldest.

For the journal's thread alone: everything here may wait for the disk. Nothing here raises once a run is open.
"""

import contextlib
import errno
import os
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autonomy.frames import cut_torn_tail, pack
from autonomy.records import encode_header
from autonomy.shell import tlog
from autonomy.shell.files import locked, locked_still
from autonomy.shell.journal_files import JournalFile, Position, file_name, highest_run, journal_files
from autonomy.shell.journal_room import FULL_DISK, RETRY_S, Room

_LOCK = "lock"


@dataclass(frozen=True)
class Limits:
    """When a file is full (bytes, or seconds since it was begun), and how many bytes all files may have together."""

    file_bytes: int
    file_age_s: float
    total_bytes: int


@dataclass(frozen=True)
class Row:
    """One record on its way to the disk."""

    sequence: int
    payload: bytes


@dataclass(frozen=True)
class Packet:
    """One MAVLink packet on its way to the stream."""

    utc_us: int
    data: bytes


class _Open:
    """The two files being written; `written` and `stream_written` are their sound lengths."""

    def __init__(self, file: JournalFile, begun: float) -> None:
        self.file = file
        self.begun = begun
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND
        self.records = os.open(file.path, flags, 0o644)
        try:
            self.stream = os.open(file.stream, flags, 0o644)
        except OSError:
            os.close(self.records)
            with contextlib.suppress(OSError):
                file.path.unlink()
            raise
        self.written = 0
        self.stream_written = 0

    @property
    def size(self) -> int:
        return self.written + self.stream_written

    def close(self) -> None:
        for descriptor in (self.records, self.stream):
            with contextlib.suppress(OSError):
                os.close(descriptor)


class Store:
    """The files of one run in a folder that other runs share.

    Args:
        folder: made if it isn't there.
        limits: of size and age.
        header: what each file begins with; run, file and first record are added.
        clock: seconds, for ages and pauses.
        write: as `os.write`.
        free: bytes that are free on the disk of a folder.

    Raises:
        OSError: the folder can't be made, read or locked; BlockingIOError if another process writes a journal there.
    """

    def __init__(
        self,
        folder: Path,
        limits: Limits,
        header: dict[str, Any],
        clock: Callable[[], float] = time.monotonic,
        write: Callable[[int, bytes], int] = os.write,
        free: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        self._folder, self._limits, self._header = folder, limits, header
        self._clock, self._write = clock, write
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = locked(folder / _LOCK)
        old = journal_files(folder)
        if old:
            cut_torn_tail(old[-1].path)
        # A checkpoint may stand in a run whose files are gone: its number is not given again, or what follows would
        # look older than the checkpoint.
        resumed = header.get("resumed") or [0]
        self.run = 1 + max(highest_run(folder), resumed[0])
        self._room = Room(folder, old, limits.file_bytes, limits.total_bytes, clock, free)
        self._files = 0
        self._open: _Open | None = None
        self._not_before = -float("inf")
        self._rows: list[Row] = []
        self._buffer = bytearray()
        self._stream = bytearray()
        self._packets = 0
        self._unsynced_records = 0
        self._unsynced_packets = 0
        self._last = 0
        self._dirty = False
        self.lost_records = 0
        self.lost_packets = 0
        self._refusal = ""
        self.synced = Position(self.run, 0)

    @property
    def trouble(self) -> str:
        """What is wrong at present, empty if nothing is."""
        return self._refusal or (FULL_DISK if self._room.is_full else "")

    @property
    def is_refused(self) -> bool:
        """Whether nothing is recorded at present, since the disk takes nothing."""
        return bool(self._refusal)

    @property
    def total_bytes(self) -> int:
        """Of all files of the journal."""
        return self._room.total_bytes + self._open_bytes

    def write(self, items: Sequence[Row | Packet]) -> None:
        """Append records and packets; what the disk refuses is counted as lost."""
        for item in items:
            if not self._is_ready(item):
                self._lose(item)
            elif isinstance(item, Row):
                assert self._open is not None
                offset = self._open.written + len(self._buffer)
                self._buffer += pack(offset, item.sequence, item.payload)
                self._rows.append(item)
                self._last = item.sequence
            else:
                self._stream += tlog.pack(item.utc_us, item.data)
                self._packets += 1
        self._flush()
        self._room.keep_bound(self._open_bytes)
        if self._open is not None:
            # While the disk refuses all, what the newest file holds may be all that is known since the checkpoint.
            self._room.keep_free()

    def sync(self) -> None:
        """Wait until what was written is on the disk."""
        if self._open is None or not self._dirty:
            return
        try:
            self._put_on_disk(self._open)
        except OSError as error:
            # Asked again, the system may say that all is well: it has forgotten what it could not write.
            self._lose_unsynced()
            self._abandon(error)
            return
        self.synced = Position(self.run, self._last)

    def close(self) -> None:
        """Sync and close; another process may write here then."""
        self.sync()
        self._shut()
        os.close(self._lock)

    def _is_ready(self, item: Row | Packet) -> bool:
        """Whether there is a file with room; begins one if need be."""
        if self._open is not None and self._is_full(self._open):
            self._flush()
            self.sync()
            self._shut()
        if self._open is None and self._clock() >= self._not_before:
            self._begin(item.sequence if isinstance(item, Row) else self._last + 1)
        return self._open is not None

    def _is_full(self, current: _Open) -> bool:
        size = current.size + len(self._buffer) + len(self._stream)
        return size >= self._limits.file_bytes or self._clock() - current.begun >= self._limits.file_age_s

    def _begin(self, first_record: int) -> None:
        self._room.begins()
        self._files += 1
        file = JournalFile(self.run, self._files, self._folder / file_name(self.run, self._files))
        place = {"run": self.run, "file": self._files, "first_record": first_record}
        header = pack(0, first_record, encode_header({**self._header, **place}))
        while True:
            try:
                self._lock = locked_still(self._lock, self._folder / _LOCK)
                self._open = _Open(file, self._clock())
                self._put(self._open.records, header)
                self._open.written = len(header)
                _sync_folder(self._folder)
                self._dirty = True
                self._refusal = ""
                return
            except OSError as error:
                self._discard(file)
                if not self._room.relieve(error):
                    self._abandon(error)
                    return

    def _discard(self, file: JournalFile) -> None:
        """A file that could not be begun; one that is not ours stays."""
        if self._open is None:
            return
        self._open.close()
        self._open = None
        for path in (file.path, file.stream):
            with contextlib.suppress(OSError):
                path.unlink()

    def _flush(self) -> None:
        if self._open is not None and self._buffer:
            if self._append(self._open.records, bytes(self._buffer), self._open.written):
                self._open.written += len(self._buffer)
                self._unsynced_records += len(self._rows)
            else:
                self.lost_records += len(self._rows)
        if self._open is not None and self._stream:
            if self._append(self._open.stream, bytes(self._stream), self._open.stream_written):
                self._open.stream_written += len(self._stream)
                self._unsynced_packets += self._packets
            else:
                self.lost_packets += self._packets
        elif self._stream:
            self.lost_packets += self._packets
        self._rows.clear()
        self._buffer.clear()
        self._stream.clear()
        self._packets = 0

    def _append(self, descriptor: int, data: bytes, end: int) -> bool:
        """Append to a file whose sound length is `end`; False if the disk refuses, and the file is given up."""
        while True:
            try:
                self._put(descriptor, data)
                self._dirty = True
                return True
            except OSError as error:
                try:
                    os.ftruncate(descriptor, end)
                except OSError as worse:
                    self._abandon(worse)
                    return False
                if not self._room.relieve(error):
                    self._abandon(error)
                    return False

    def _put(self, descriptor: int, data: bytes) -> None:
        view = memoryview(data)
        while view:
            view = view[self._write(descriptor, bytes(view)) :]

    @property
    def _open_bytes(self) -> int:
        return 0 if self._open is None else self._open.size

    def _lose(self, item: Row | Packet) -> None:
        if isinstance(item, Row):
            self.lost_records += 1
        else:
            self.lost_packets += 1

    def _put_on_disk(self, current: _Open) -> None:
        if not os.fstat(current.records).st_nlink:
            raise FileNotFoundError(errno.ENOENT, "its files were removed")
        os.fsync(current.records)
        self._unsynced_records = 0
        os.fsync(current.stream)
        self._unsynced_packets = 0
        self._dirty = False

    def _lose_unsynced(self) -> None:
        """What was written since the last sync is on no disk, as far as anybody can tell."""
        self.lost_records += self._unsynced_records
        self.lost_packets += self._unsynced_packets
        self._dirty = False
        self._unsynced_records = self._unsynced_packets = 0

    def _abandon(self, error: OSError) -> None:
        """Begin another file after a pause; what this one holds is to last."""
        if self._open is not None and self._dirty:
            try:
                self._put_on_disk(self._open)
            except OSError:
                self._lose_unsynced()
        self._shut()
        self._refusal = f"{error.strerror or error}: nothing is recorded"
        self._not_before = self._clock() + RETRY_S

    def _shut(self) -> None:
        if self._open is not None:
            self._open.close()
            self._room.add(self._open.file, self._open.size)
            self._open = None
            self._dirty = False


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
