"""Files that must outlive the process, whatever becomes of it or of the disk, and whatever else lies in their place."""

import errno
import fcntl
import os
import stat
from pathlib import Path
from typing import BinaryIO


def open_to_read(path: Path) -> BinaryIO:
    """Open a file for reading. OSError if that fails, or if it is something else: a pipe would be waited for."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError(errno.EINVAL, "it is no file", str(path))
    return os.fdopen(descriptor, "rb")


def locked(path: Path, flags: int = os.O_RDWR | os.O_CREAT) -> int:
    """The descriptor of a file, opened with these flags, that no other process has as long as it is open.

    Raises:
        BlockingIOError: another process has it.
        OSError: it can't be made, opened or locked.
    """
    descriptor = os.open(path, flags | os.O_NONBLOCK | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise BlockingIOError(error.errno, "another process uses it", str(path)) from None
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def locked_still(descriptor: int, path: Path) -> int:
    """The same descriptor of `locked`; or, if somebody has removed the file, a new one of it, in its folder made anew.

    Raises:
        BlockingIOError: another process has it meanwhile.
        OSError: it can't be made, opened or locked.
    """
    if os.fstat(descriptor).st_nlink:
        return descriptor
    path.parent.mkdir(parents=True, exist_ok=True)
    anew = locked(path)
    os.close(descriptor)
    return anew


def write_atomically(path: Path, data: bytes) -> None:
    """Replace a file so that after any interruption it is the old or the new one, whole. OSError if that fails."""
    draft = path.with_name(path.name + ".new")
    try:
        with draft.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
    except OSError:
        # What is there of it keeps others from a full disk.
        draft.unlink(missing_ok=True)
        raise
    draft.replace(path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def cause(error: OSError, place: Path) -> str:
    """What went wrong where, for a person; not every error of the system names the file."""
    return f"{error.filename or place}: {error.strerror or error}"
