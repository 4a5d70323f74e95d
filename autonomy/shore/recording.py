"""The shore's recording: everything that arrives, exactly as it arrived, and reading it again.

A folder of files `shore000001.recording`, …, each a row of frames (see `autonomy.frames`) whose payloads are CBOR
lists. The first is a header, [0, {"schema", "version", "software", "utc_s"}]; the others are [1, received_utc_s, key,
encoding, payload]: the shore's clock when it came, the zenoh key, the encoding, the bytes. The numbers of the records
run on over files and restarts.
"""

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cbor2

from autonomy import __version__, plain_cbor, wire
from autonomy.frames import MAXIMUM_PAYLOAD_BYTES, Damage, Frame, scan
from autonomy.shore.recording_files import Files, Limits, recording_files

__all__ = [
    "Limits",
    "Recorded",
    "Recorder",
    "RecorderStatus",
    "RecordingError",
    "is_recording",
    "known_vehicles",
    "read_recording",
]

log = logging.getLogger(__name__)

SCHEMA = "halocline/recording"
VERSION = 1
QUEUE_BYTES = 64 * 2**20
"""Room for what the disk has not taken yet."""

_HEADER, _ARRIVAL = 0, 1
_ITEM_BYTES = 200  # what an item takes besides its payload
_LINGER_S = 0.01  # so long the thread lets records gather: a burst costs one turn of it


class RecordingError(ValueError):
    """Files that can't be read as a recording of ours; says which and why."""


@dataclass(frozen=True)
class Recorded:
    """One sample as it arrived: when, by the shore's clock in seconds since 1970, under which key, encoded how."""

    received_utc_s: float
    key: str
    encoding: str
    payload: bytes

    @property
    def vehicle(self) -> str:
        """Whose it is; empty if the key is none of ours."""
        parts = self.key.split("/")
        return parts[1] if len(parts) == 3 and parts[0] == "usv" else ""

    @property
    def topic(self) -> str:
        """The last part of the key."""
        return self.key.rpartition("/")[2]


@dataclass(frozen=True)
class RecorderStatus:
    """How the recording goes.

    Attributes:
        recorded: records on the disk or on their way to it since the start.
        lost: records that are in no file, for want of room in the queue or on the disk.
        removed: old files removed to keep the bound.
        trouble: what is wrong at present, empty if nothing is.
        total_bytes: of all files.
    """

    recorded: int
    lost: int
    removed: int
    trouble: str
    total_bytes: int


class Recorder:
    """Keeps what arrives in a folder, from a thread of its own; whoever calls `write` never waits for the disk.

    Args:
        folder: made if it isn't there; what it holds stays, within the bound.
        limits: of size and age.
        queue_bytes: room for what the disk has not taken yet.
        write: as `os.write`.

    Raises:
        OSError: the folder can't be made, read or locked; BlockingIOError if another process records there.
    """

    def __init__(
        self,
        folder: Path,
        limits: Limits | None = None,
        queue_bytes: int = QUEUE_BYTES,
        write: Callable[[int, bytes], int] = os.write,
    ) -> None:
        limits = Limits() if limits is None else limits
        self._files = Files(folder, limits, _header, write=write)
        self._sync_s = limits.sync_s
        self._room = queue_bytes
        self._waiting: deque[bytes] = deque()
        self._changed = threading.Condition()
        self._closing = False
        self._failure = ""
        self._taken = 0
        self._refused = 0
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, received_utc_s: float, key: str, encoding: str, payload: bytes) -> None:
        """Keep one sample; for any thread."""
        record = cbor2.dumps([_ARRIVAL, float(received_utc_s), key, encoding, payload])
        size = len(record) + _ITEM_BYTES
        with self._changed:
            if self._closing or self._failure or size > self._room or len(record) > MAXIMUM_PAYLOAD_BYTES:
                self._refused += 1
                return
            self._room -= size
            self._taken += 1
            self._waiting.append(record)
            self._changed.notify_all()

    @property
    def status(self) -> RecorderStatus:
        """How it goes."""
        files = self._files
        return RecorderStatus(
            self._taken - files.lost,
            self._refused + files.lost,
            files.removed,
            self._failure or files.trouble,
            files.total_bytes,
        )

    def close(self) -> None:
        """Write and sync what is left; nothing is recorded afterwards."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        try:
            self._serve()
        except Exception as error:
            # A bug: those who follow the vehicles go on without a recording, and hear of it.
            log.exception("the recording ends over an error of its own")
            with self._changed:
                self._failure = f"ended over an error of its own: {error}"
                self._refused += len(self._waiting)
                self._taken -= len(self._waiting)
                self._waiting.clear()
        finally:
            self._files.close()

    def _serve(self) -> None:
        sync_due: float | None = None
        while True:
            patience_s = None if sync_due is None else max(0.0, sync_due - time.monotonic())
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closing, patience_s)
                records, closing = list(self._waiting), self._closing
                self._waiting.clear()
            self._files.append(records)
            with self._changed:
                self._room += sum(len(record) + _ITEM_BYTES for record in records)
            if records and sync_due is None:
                sync_due = time.monotonic() + self._sync_s
            if sync_due is not None and time.monotonic() >= sync_due:
                self._files.sync()
                sync_due = None
            if closing and not records:
                return
            if records and not closing:
                time.sleep(_LINGER_S)


def is_recording(folder: Path) -> bool:
    """Whether a folder holds a recording. OSError if it can't be read."""
    return bool(recording_files(folder))


def read_recording(
    folder: Path, vehicle: str | None = None, regret: Callable[[str], None] = log.warning
) -> Iterator[Recorded]:
    """Everything that a recording holds, oldest first, one record at a time; it may still be written to.

    Args:
        folder: of the recording.
        vehicle: whose records; None for all.
        regret: is told, for a person, what can't be read and where; a torn end is nothing to regret.

    Raises:
        RecordingError: there is none, or a file is of another version.
        OSError: a file can't be read.
    """
    files = recording_files(folder)
    if not files:
        raise RecordingError(f"{folder}: holds no recording (shore000001.recording, …)")
    reached = 0
    for path in files:
        try:
            with path.open("rb") as file:
                for part in scan(file):
                    if isinstance(part, Damage):
                        if not part.torn:
                            regret(f"{path} bytes {part.offset} to {part.end}: damaged, left out")
                        continue
                    found = _read(path, part, regret)
                    if 0 < reached < part.sequence - 1:
                        missing = part.sequence - reached - 1
                        regret(f"{path} byte {part.offset}: {missing} records before it are missing")
                    reached = part.sequence or reached
                    if found is not None and vehicle in (None, found.vehicle):
                        yield found
        except FileNotFoundError:
            # Removed by its recorder in the meantime, to keep the bound.
            regret(f"{path}: has been removed meanwhile")


def _header() -> bytes:
    content = {"schema": SCHEMA, "version": VERSION, "software": __version__, "utc_s": time.time()}
    return cbor2.dumps([_HEADER, content])


def _read(path: Path, frame: Frame, regret: Callable[[str], None]) -> Recorded | None:
    """The sample in a frame; None for a header, and for what is no record."""
    where = f"{path} byte {frame.offset}"
    try:
        content = plain_cbor.load(
            frame.payload, maximum_bytes=MAXIMUM_PAYLOAD_BYTES, maximum_items=100, maximum_depth=3
        )
    except plain_cbor.CBORError as error:
        regret(f"{where}: the record {error}; left out")
        return None
    match content:
        case [0, dict() as header]:
            _check(path, header)
            return None
        case [1, float() as at, str() as key, str() as encoding, bytes() as payload]:
            return Recorded(at, key, encoding, payload)
        case _:
            regret(f"{where}: the record is of no known kind; left out")
            return None


def _check(path: Path, header: dict[str, Any]) -> None:
    schema, version = header.get("schema"), header.get("version")
    if schema != SCHEMA:
        raise RecordingError(f"{path}: is no recording of this software: its schema is {str(schema)[:80]!r}")
    if version != VERSION:
        which = "a newer" if isinstance(version, int) and version > VERSION else "another"
        raise RecordingError(
            f"{path}: is of {which} version, {str(version)[:20]}; this software reads {VERSION}"
        )


def known_vehicles(folder: Path) -> list[str]:
    """Names of the vehicles that a recording holds anything of, sorted; raises as `read_recording`."""
    names = {one.vehicle for one in read_recording(folder, regret=lambda _: None)}
    return sorted(name for name in names if wire.VEHICLE_NAME.fullmatch(name))
