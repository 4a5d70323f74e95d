"""Room for the journal on its disk: what its finished files take, and when the oldest is given up."""

import contextlib
import errno
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path

from autonomy.shell.journal_files import JournalFile

RETRY_S = 5.0
"""Pause after the disk refused a file before another is begun, or after giving files up has freed nothing."""

MOST_ROOM_BYTES = 64 * 10**6
"""What is left of a disk to others, if a file of the journal is larger than that."""

FULL_DISK = "the disk is full: the oldest files are given up"
FULL = (errno.ENOSPC, errno.EDQUOT)
"""What a disk says that has no room left."""


class Room:
    """The files that are not written any more, oldest first. Nothing here raises.

    Args:
        folder: of the journal.
        files: those of earlier runs, oldest first.
        file_bytes: size at which a file is full.
        total_bytes: bound for all files together.
        clock: seconds, for pauses.
        free: bytes that are free on the disk of a folder.
    """

    def __init__(
        self,
        folder: Path,
        files: Iterable[JournalFile],
        file_bytes: int,
        total_bytes: int,
        clock: Callable[[], float],
        free: Callable[[Path], int],
    ) -> None:
        self._folder, self._file_bytes, self._bound = folder, file_bytes, total_bytes
        self._clock, self._free = clock, free
        self._files = deque((file, _size(file)) for file in files)
        self.total_bytes = sum(size for _, size in self._files)
        self.is_full = False
        """Whether files had to be given up: until one was begun and filled without, or there is ample room again."""
        self._begun = 0
        self._gave_up_for = 0
        self._free_then = 0.0
        self._not_before = -float("inf")

    def begins(self) -> None:
        """Another file is about to be begun."""
        self._begun += 1
        self.is_full = self.is_full and self._begun <= self._gave_up_for + 1

    def add(self, file: JournalFile, size: int) -> None:
        """A file is finished, and the newest of these."""
        self._files.append((file, size))
        self.total_bytes += size

    def relieve(self, error: OSError) -> bool:
        """Make room on a full disk by the oldest file; whether it is full, and there was one."""
        if error.errno not in FULL or not self._files:
            return False
        self._give_up_oldest()
        return True

    def keep_bound(self, open_bytes: int) -> None:
        """Remove the oldest, if with those being written all take more than they may."""
        while self._files and self.total_bytes + open_bytes > self._bound:
            self._remove_oldest()

    def keep_free(self) -> None:
        """Leave the disk's last bytes, as many as a file of the journal takes, to others: checkpoints above all."""
        if self.is_full and self._free_bytes() > self._free_then + self._file_bytes:
            self.is_full = False
        while self._files and self._clock() >= self._not_before:
            free = self._free_bytes()
            if free >= min(self._file_bytes, MOST_ROOM_BYTES):
                return
            size = self._files[0][1]
            self._give_up_oldest()
            if self._free_then < free + size // 2:
                # Somebody else has taken it, or the file system frees it later: not all shall go for that.
                self._not_before = self._clock() + RETRY_S

    def _give_up_oldest(self) -> None:
        self._remove_oldest()
        self.is_full = True
        self._gave_up_for = self._begun
        self._free_then = self._free_bytes()

    def _remove_oldest(self) -> None:
        file, size = self._files.popleft()
        self.total_bytes -= size
        for path in (file.path, file.stream):
            with contextlib.suppress(OSError):
                path.unlink()

    def _free_bytes(self) -> float:
        try:
            return self._free(self._folder)
        except OSError:
            return float("inf")


def _size(file: JournalFile) -> int:
    total = 0
    for path in (file.path, file.stream):
        with contextlib.suppress(OSError):
            total += path.stat().st_size
    return total
