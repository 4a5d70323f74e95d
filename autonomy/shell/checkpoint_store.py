"""The folder of one boat's checkpoints, of which there are two generations.

A new one replaces the older of the two files, so that whatever happens meanwhile, the newer one is whole.
"""

import errno
import logging
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from autonomy.shell.checkpoint import MAXIMUM_BYTES, Checkpoint, CheckpointError, decode, encode
from autonomy.shell.files import locked, locked_still, open_to_read, write_atomically
from autonomy.shell.journal_room import FULL

log = logging.getLogger(__name__)

_LOCK = "lock"
_FILES = ("even.checkpoint", "odd.checkpoint")
TRIALS_FILES = ("trials.json", "mark")
"""Beside the checkpoints: see `autonomy.shell.trials`."""

_KEPT_ASIDE = 8
_LEAST_RESERVE_BYTES = 2**20


class Store:
    """The folder of one boat's checkpoints.

    One on a disk that has become read-only is still read. Raises OSError if the folder can't be made or written to
    for any other reason; BlockingIOError if another process uses it.
    """

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self.is_spoilt = False
        """Whether what was found there is damaged or another version's: the journal may still tell what it was."""
        self.newest = 0
        """Number of the newest checkpoint that was loaded or saved."""
        self._reserve = folder / "reserve"
        self._is_short = False
        self._lock: int | None = _lock(folder)

    def close(self) -> None:
        """Let another process use the folder."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def begin_anew(self) -> None:
        """Put aside what there is, and forget what went wrong with it."""
        for name in _FILES:
            if (self.folder / name).exists():
                self._put_aside(name, "earlier")
        for name in TRIALS_FILES:
            (self.folder / name).unlink(missing_ok=True)

    def load(self, wanted: Mapping[str, str]) -> list[Checkpoint]:
        """The sound checkpoints that fit, newest first; the others are put aside, and said to be."""
        found = []
        for name in _FILES:
            path = self.folder / name
            try:
                checkpoint = decode(_read(path))
            except FileNotFoundError:
                continue
            except (CheckpointError, OSError) as error:
                why = error.strerror if isinstance(error, OSError) else error
                log.error("the checkpoint %s is not used: %s", path, why)
                self._put_aside(name, "damaged")
                self.is_spoilt = True
                continue
            changed = [part for part in wanted if checkpoint.fits.get(part) != wanted[part]]
            if changed:
                why = f"what it depends on has changed: {', '.join(changed)}"
                log.error("the checkpoint %s is not used: %s", path, why)
                self._put_aside(name, "unfit")
                self.is_spoilt = self.is_spoilt or changed == ["software"]
            else:
                found.append(checkpoint)
        self.newest = max((checkpoint.number for checkpoint in found), default=0)
        return sorted(found, key=lambda checkpoint: -checkpoint.number)

    def reject(self, checkpoint: Checkpoint, why: str) -> None:
        """Put a checkpoint aside that turned out to be of no use."""
        name = _FILES[checkpoint.number % 2]
        log.error("the checkpoint %s is not used: %s", self.folder / name, why)
        self._put_aside(name, "unfit")

    def save(self, checkpoint: Checkpoint) -> int:
        """Write a checkpoint in place of the older one, to the disk itself; returns its size.

        A folder that somebody has removed is made and locked anew.

        Raises:
            OSError: the disk refuses.
            ValueError, TypeError: see `checkpoint.encode`.
        """
        data = encode(checkpoint)
        if self._lock is not None:
            self._lock = locked_still(self._lock, self.folder / _LOCK)
        self.write(self.folder / _FILES[checkpoint.number % 2], data)
        self.newest = checkpoint.number
        self._set_aside_room(max(_LEAST_RESERVE_BYTES, 2 * len(data)))
        return len(data)

    def write(self, path: Path, data: bytes) -> None:
        """As `write_atomically`; a full disk costs the room that is reserved for this."""
        try:
            write_atomically(path, data)
        except OSError as error:
            if error.errno not in FULL or not self._reserve.exists():
                raise
            self._reserve.unlink()
            write_atomically(path, data)

    def _set_aside_room(self, size: int) -> None:
        """Keep a file as large as the next checkpoints, if the disk has room for one."""
        try:
            if self._reserve.exists() and self._reserve.stat().st_size >= size:
                return
            with self._reserve.open("ab") as file:
                os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            self._reserve.unlink(missing_ok=True)
            if not self._is_short:
                log.warning("no room can be reserved for the next checkpoints: %s", error)
            self._is_short = True
        else:
            self._is_short = False

    def _put_aside(self, name: str, reason: str) -> None:
        """Keep a file under another name; of those the oldest goes when there are more than eight."""
        path = self.folder / name
        aside = sorted(self.folder.glob("*.aside"), key=lambda one: one.lstat().st_mtime)
        for old in aside[: max(0, len(aside) + 1 - _KEPT_ASIDE)]:
            with suppress(OSError):  # it may be no file, too
                old.unlink()
        number = 1
        while (target := self.folder / f"{name}.{reason}-{number}.aside").exists():
            number += 1
        try:
            path.rename(target)
        except OSError as error:
            log.error("%s can't be put aside: %s", path, error)
        else:
            log.warning("it is kept as %s", target)


def _lock(folder: Path) -> int:
    path = folder / _LOCK
    try:
        return locked(path)
    except OSError as error:
        if error.errno != errno.EROFS or not path.exists():
            raise
    log.error("%s is read-only: what is learnt from now on will not outlive this run", folder)
    return locked(path, os.O_RDONLY)


def _read(path: Path) -> bytes:
    with open_to_read(path) as file:
        data = file.read(MAXIMUM_BYTES + 1)
    if len(data) > MAXIMUM_BYTES:
        raise CheckpointError(f"it has more than {MAXIMUM_BYTES} bytes")
    return data
