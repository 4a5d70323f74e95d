"""A recording being written: numbered files, rotated by size and age, bounded together, synced.

For the recorder's thread alone: everything here may wait for the disk. Nothing here raises once it is open.
"""

import contextlib
import fcntl
import os
import re
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from autonomy.frames import Frame, cut_torn_tail, pack, scan

RETRY_S = 5.0
"""Pause after the disk refused a file before another is begun."""

_LOCK = "lock"
_NAME = re.compile(r"shore(\d{6,9})\.recording")


@dataclass(frozen=True)
class Limits:
    """When a file is full (bytes, or seconds since it was begun), how many bytes all files may have together, and the
    longest time between a record and its sync.
    """

    file_bytes: int = 64 * 10**6
    file_age_s: float = 86400.0
    total_bytes: int = 20 * 10**9
    sync_s: float = 5.0


def recording_files(folder: Path) -> list[Path]:
    """The files of a recording, oldest first. OSError if the folder can't be read."""
    found = [(int(match[1]), path) for path in folder.iterdir() if (match := _NAME.fullmatch(path.name))]
    return [path for _, path in sorted(found)]


class Files:
    """The files of a folder that one recorder writes to; it goes on after whatever is there.

    Args:
        folder: made if it isn't there.
        limits: of size and age.
        header: what each file begins with, as bytes.
        clock: seconds, for ages and pauses.
        write: as `os.write`.

    Attributes:
        lost: records that the disk refused.
        trouble: what is wrong at present, empty if nothing is.
        removed: files that were removed to keep the bound.

    Raises:
        OSError: the folder can't be made, read or locked; BlockingIOError if another process records there.
    """

    def __init__(
        self,
        folder: Path,
        limits: Limits,
        header: Callable[[], bytes],
        clock: Callable[[], float] = time.monotonic,
        write: Callable[[int, bytes], int] = os.write,
    ) -> None:
        self._folder, self._limits, self._header = folder, limits, header
        self._clock, self._write = clock, write
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = os.open(folder / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            old = recording_files(folder)
            self._sequence = 0
            for path in reversed(old):
                cut_torn_tail(path)
                self._sequence = _last_sequence(path)
                if self._sequence:
                    break
            self._number = int(_NAME.fullmatch(old[-1].name)[1]) if old else 0  # type: ignore[index]
            self._old = deque((path, path.stat().st_size) for path in old)
        except OSError:
            os.close(self._lock)
            raise
        self._old_bytes = sum(size for _, size in self._old)
        self._open: int | None = None
        self._written = 0
        self._begun = 0.0
        self._not_before = -float("inf")
        self._dirty = False
        self.lost = 0
        self.removed = 0
        self.trouble = ""

    @property
    def total_bytes(self) -> int:
        """Of all files of the recording."""
        return self._old_bytes + (0 if self._open is None else self._written)

    def append(self, payloads: Sequence[bytes]) -> None:
        """Append records; those that the disk refuses are counted as lost."""
        for payload in payloads:
            self._sequence += 1
            if not self._is_ready() or not self._put(pack(self._written, self._sequence, payload)):
                self.lost += 1
        self._keep_bound()

    def sync(self) -> None:
        """Wait until what was written is on the disk."""
        if self._open is not None and self._dirty:
            try:
                os.fsync(self._open)
            except OSError as error:
                self._abandon(error)
                return
            self._dirty = False

    def close(self) -> None:
        """Sync and close; another process may write here then."""
        self.sync()
        self._shut()
        os.close(self._lock)

    def _is_ready(self) -> bool:
        """Whether there is a file with room; begins one if need be."""
        age_s = self._clock() - self._begun
        full = self._written >= self._limits.file_bytes or age_s >= self._limits.file_age_s
        if self._open is not None and full:
            self.sync()
            self._shut()
        if self._open is None and self._clock() >= self._not_before:
            self._begin()
        return self._open is not None

    def _begin(self) -> None:
        path = self._folder / f"shore{self._number + 1:06d}.recording"
        try:
            self._open = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        except OSError as error:
            self._abandon(error)
            return
        self._number += 1
        self._written, self._begun = 0, self._clock()
        self._old.append((path, 0))
        if self._put(pack(0, 0, self._header())):
            _sync_folder(self._folder)
            self.trouble = ""
            return
        # A file without a header is of no use to anybody.
        self._old.pop()
        with contextlib.suppress(OSError):
            path.unlink()

    def _put(self, data: bytes) -> bool:
        """Append to the open file; False if the disk refuses, and the file is given up with what it holds so far."""
        assert self._open is not None
        view = memoryview(data)
        try:
            while view:
                view = view[self._write(self._open, bytes(view)) :]
        except OSError as error:
            with contextlib.suppress(OSError):
                os.ftruncate(self._open, self._written)
            self._abandon(error)
            return False
        self._written += len(data)
        self._dirty = True
        return True

    def _keep_bound(self) -> None:
        while len(self._old) > 1 and self.total_bytes > self._limits.total_bytes:
            path, size = self._old.popleft()
            self._old_bytes -= size
            self.removed += 1
            with contextlib.suppress(OSError):
                path.unlink()

    def _abandon(self, error: OSError) -> None:
        self._shut()
        self.trouble = f"{error.strerror or error}: nothing is recorded"
        self._not_before = self._clock() + RETRY_S

    def _shut(self) -> None:
        if self._open is not None:
            with contextlib.suppress(OSError):
                os.close(self._open)
            self._old[-1] = (self._old[-1][0], self._written)
            self._old_bytes += self._written
            self._open, self._written, self._dirty = None, 0, False


def _last_sequence(path: Path) -> int:
    """Number of a file's last sound record, 0 if it has none."""
    last = 0
    with path.open("rb") as file:
        for part in scan(file):
            if isinstance(part, Frame):
                last = part.sequence
    return last


def _sync_folder(folder: Path) -> None:
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
