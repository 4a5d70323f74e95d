"""Checkpoints on disk: what the core knows, in two generations, each in a file that tells whether it is whole.

A file is `MAGIC`, the BLAKE2b digest (32 bytes) of the rest, and a zstd frame of CBOR:

    {"number": counts the checkpoints, "fits": {what it depends on: digest}, "now", "utc_s": when, by both clocks,
     "boot": the machine's boot, "journal": [run, sequence] or null, "memory": see `autonomy.memory`}

with arrays as ["array", type, order, [side, …], bytes]. A new one replaces the older of the two files, so that
whatever happens meanwhile, the newer one is whole. Nothing in a file is ever run as code.
"""

import errno
import fcntl
import hashlib
import logging
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal

import cbor2
import numpy as np
import shapely
import zstandard

from autonomy import plain_cbor
from autonomy.config import Configuration
from autonomy.memory import Memory
from autonomy.planning.survey import SurveyArea
from autonomy.shell.journal_files import Position
from autonomy.shell.journal_store import FULL

log = logging.getLogger(__name__)

MAGIC = b"HALOCKPT"
SCHEMA = 1
"""To be raised when what the core remembers changes its meaning but not the names of its attributes."""

MAXIMUM_BYTES = 2**26
"""Without compression: thrice what the largest model configurable takes, 300 basis vectors of three components, two of
which move, with 20 000 cells of history."""

MAXIMUM_ITEMS = 500_000
"""Numbers, texts, lists, … in it; arrays count as one, so that a core at sea has some thousands."""

FITTING_SHAPES = ("ground", "obstacles", "navigable")
"""The parts of a survey area that a checkpoint depends on."""

_DIGEST_BYTES = 32
_MAXIMUM_DEPTH = 400
_FILES = ("even.checkpoint", "odd.checkpoint")
TRIALS_FILES = ("trials.json", "mark")
"""Beside the checkpoints: see `autonomy.shell.trials`."""

_KEPT_ASIDE = 8
_LEAST_RESERVE_BYTES = 2**20


class CheckpointError(ValueError):
    """A file that is no sound checkpoint; says why."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """What a core knew at one moment.

    Attributes:
        number: counts the checkpoints of a boat; the highest is the newest.
        fits: what a core must have been made with to take it up, by name; see `fits`.
        memory: of the core.
        now: protocol time of the last event that it had heard of, or later.
        utc_s: the wall clock at that time.
        boot: names the machine's boot, for which alone protocol time means anything.
        position: the journal's, just after that event; None without a journal.
    """

    number: int
    fits: Mapping[str, str]
    memory: Memory
    now: float
    utc_s: float
    boot: str
    position: Position | None


def fits(configuration: Configuration, survey: SurveyArea) -> dict[str, str]:
    """Digests of all that must be the same for a checkpoint to be taken up; other keys may change meanwhile."""
    frame = survey.frame
    shapes = {name: shapely.to_wkb(getattr(survey, name)) for name in FITTING_SHAPES}
    return digests(configuration, shapes, frame.origin_lat_deg, frame.origin_lon_deg)


def digests(
    configuration: Configuration, shapes: Mapping[str, bytes], origin_lat_deg: float, origin_lon_deg: float
) -> dict[str, str]:
    """The same of a survey area whose shapes are at hand as WKB in local metres, by name."""
    origin = f"{origin_lat_deg!r} {origin_lon_deg!r}"
    parts = {
        "software": f"schema {SCHEMA}".encode(),
        "vehicle.name": configuration.vehicle.name.encode(),
        "survey": b"".join(shapes[name] for name in FITTING_SHAPES) + origin.encode(),
        "sensor": configuration.sensor.model_dump_json().encode(),
        "model": configuration.model.model_dump_json().encode(),
    }
    return {name: hashlib.blake2b(data, digest_size=16).hexdigest() for name, data in parts.items()}


def encode(checkpoint: Checkpoint) -> bytes:
    """The bytes of a file. ValueError if they are more than would be read again; TypeError if it can't be encoded."""
    position = checkpoint.position
    content = {
        "number": checkpoint.number,
        "fits": dict(checkpoint.fits),
        "now": checkpoint.now,
        "utc_s": checkpoint.utc_s,
        "boot": checkpoint.boot,
        "journal": None if position is None else [position.run, position.sequence],
        "memory": checkpoint.memory,
    }
    plain = cbor2.dumps(content, default=_encode_array)
    if len(plain) > MAXIMUM_BYTES:
        raise ValueError(
            f"it would have {len(plain)} bytes, more than the {MAXIMUM_BYTES} that are read again"
        )
    plain_cbor.check_items(plain, MAXIMUM_ITEMS)
    body = zstandard.ZstdCompressor(level=1).compress(plain)
    return MAGIC + hashlib.blake2b(body, digest_size=_DIGEST_BYTES).digest() + body


def decode(data: bytes) -> Checkpoint:
    """The checkpoint in a file's bytes. CheckpointError if there is none, or a damaged one."""
    head = len(MAGIC) + _DIGEST_BYTES
    if len(data) < head or not data.startswith(MAGIC):
        raise CheckpointError("it is no checkpoint, or its beginning is damaged")
    body = data[head:]
    if hashlib.blake2b(body, digest_size=_DIGEST_BYTES).digest() != data[len(MAGIC) : head]:
        raise CheckpointError("its digest does not agree: it is damaged or not whole")
    try:
        content = _content(body)
        journal = content["journal"]
        return Checkpoint(
            number=int(content["number"]),
            fits={str(name): str(digest) for name, digest in content["fits"].items()},
            memory=content["memory"],
            now=float(content["now"]),
            utc_s=float(content["utc_s"]),
            boot=str(content["boot"]),
            position=None if journal is None else Position(int(journal[0]), int(journal[1])),
        )
    except (zstandard.ZstdError, plain_cbor.CBORError) as error:
        raise CheckpointError(f"it can't be read: {error}") from error
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        raise CheckpointError(f"it makes no sense: {type(error).__name__}: {error}") from error


def _content(body: bytes) -> dict[str, Any]:
    size = zstandard.frame_content_size(body)
    if not 0 < size <= MAXIMUM_BYTES:
        raise CheckpointError(f"it claims to hold {size} bytes; the limit is {MAXIMUM_BYTES}")
    plain = zstandard.ZstdDecompressor().decompress(body, max_output_size=MAXIMUM_BYTES)
    content = plain_cbor.load(
        plain, maximum_bytes=MAXIMUM_BYTES, maximum_items=MAXIMUM_ITEMS, maximum_depth=_MAXIMUM_DEPTH
    )
    if not isinstance(content, dict):
        raise CheckpointError(f"a map was expected, not {type(content).__name__}")
    return content


def _encode_array(encoder: Any, value: Any) -> None:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a {type(value).__name__} has no place in a checkpoint")
    order: Literal["C", "F"] = "C" if value.flags.c_contiguous or not value.flags.f_contiguous else "F"
    encoder.encode(["array", value.dtype.str, order, list(value.shape), value.tobytes(order)])


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
        self._reserve = folder / "reserve"
        self._is_short = False
        self._lock = _open_lock(folder / "lock")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            raise

    def close(self) -> None:
        """Let another process use the folder."""
        self._lock.close()

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
                log.error("the checkpoint %s is not used: %s", path, error)
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
        return sorted(found, key=lambda checkpoint: -checkpoint.number)

    def reject(self, checkpoint: Checkpoint, why: str) -> None:
        """Put a checkpoint aside that turned out to be of no use."""
        name = _FILES[checkpoint.number % 2]
        log.error("the checkpoint %s is not used: %s", self.folder / name, why)
        self._put_aside(name, "unfit")

    def save(self, checkpoint: Checkpoint) -> int:
        """Write a checkpoint in place of the older one, to the disk itself; returns its size. OSError if that fails."""
        data = encode(checkpoint)
        self.write(self.folder / _FILES[checkpoint.number % 2], data)
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
        aside = sorted(self.folder.glob("*.aside"), key=lambda one: one.stat().st_mtime)
        for old in aside[: max(0, len(aside) + 1 - _KEPT_ASIDE)]:
            old.unlink(missing_ok=True)
        number = 1
        while (target := self.folder / f"{name}.{reason}-{number}.aside").exists():
            number += 1
        try:
            path.rename(target)
        except OSError as error:
            log.error("%s can't be put aside: %s", path, error)
        else:
            log.warning("it is kept as %s", target)


def _open_lock(path: Path) -> IO[bytes]:
    try:
        return path.open("wb")
    except OSError as error:
        if error.errno != errno.EROFS or not path.exists():
            raise
        log.error("%s is read-only: what is learnt from now on will not outlive this run", path.parent)
        return path.open("rb")


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


def _read(path: Path) -> bytes:
    with path.open("rb") as file:
        data = file.read(MAXIMUM_BYTES + 1)
    if len(data) > MAXIMUM_BYTES:
        raise CheckpointError(f"it has more than {MAXIMUM_BYTES} bytes")
    return data


class Keeper:
    """Writes checkpoints in a thread of its own; one that is not written yet gives way to a newer one.

    Before one is written, `sync` has the journal put on the disk up to its position: or after a power cut the
    checkpoint would know what the journal does not, and no replay could come to the same.

    To be used from one thread. `trouble` is why the last one could not be written, empty if it was.
    """

    def __init__(self, store: Store, sync: Callable[[Position], object] = lambda position: None) -> None:
        self._store = store
        self._sync = sync
        self._waiting: Checkpoint | None = None
        self._closing = False
        self._changed = threading.Condition()
        self.trouble = ""
        self.written = 0
        self._thread = threading.Thread(target=self._work, name="checkpoint", daemon=True)
        self._thread.start()

    def keep(self, checkpoint: Checkpoint) -> None:
        """Have it written; returns at once."""
        with self._changed:
            self._waiting = checkpoint
            self._changed.notify_all()

    def close(self) -> None:
        """Write what waits, and end."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._closing)
                checkpoint, self._waiting = self._waiting, None
            if checkpoint is None:
                return
            self._write(checkpoint)

    def _write(self, checkpoint: Checkpoint) -> None:
        if checkpoint.position is not None:
            self._sync(checkpoint.position)
        try:
            size = self._store.save(checkpoint)
        except (OSError, TypeError, ValueError) as error:
            if str(error) != self.trouble:
                log.error("no checkpoint could be written: %s", error)
            self.trouble = str(error)
            return
        self.trouble = ""
        self.written += 1
        log.debug("checkpoint %d: %d bytes", checkpoint.number, size)
