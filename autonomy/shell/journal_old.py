"""The journal's files that are not written any more: how large they are together, and which one goes next."""

import contextlib
from collections import deque
from collections.abc import Iterable

from autonomy.shell.journal_files import JournalFile


class OldFiles:
    """Oldest first. Nothing here raises.

    Args:
        files: those of earlier runs, oldest first.
    """

    def __init__(self, files: Iterable[JournalFile]) -> None:
        self._files = deque((file, _size(file)) for file in files)
        self.total_bytes = sum(size for _, size in self._files)

    def __bool__(self) -> bool:
        return bool(self._files)

    @property
    def oldest_bytes(self) -> int:
        """What the oldest takes; there must be one."""
        return self._files[0][1]

    def add(self, file: JournalFile, size: int) -> None:
        """A file is finished, and the newest of these."""
        self._files.append((file, size))
        self.total_bytes += size

    def remove_oldest(self) -> None:
        """Give up the oldest, with the stream beside it; there must be one."""
        file, size = self._files.popleft()
        self.total_bytes -= size
        for path in (file.path, file.stream):
            with contextlib.suppress(OSError):
                path.unlink()


def _size(file: JournalFile) -> int:
    total = 0
    for path in (file.path, file.stream):
        with contextlib.suppress(OSError):
            total += path.stat().st_size
    return total
