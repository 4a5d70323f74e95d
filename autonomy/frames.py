"""Records in a file: marker, length, number, CRC-32, payload. Damage costs the records that it touches, no more.

The checksum covers the frame's place in its file too, so that a frame quoted inside another's payload, or
left over from an older file, is never taken for a record.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

MARKER = b"\xf5HJ\x1e"
"""No UTF-8 text and no MAVLink frame begins like this."""

MAXIMUM_PAYLOAD_BYTES = 32 * 2**20

_HEAD = struct.Struct(">4sIQI")
_SEALED = struct.Struct(">QIQ")
_PIECE_BYTES = 2**18
# How often, on average, a byte of a damaged file may be looked at: a file made of markers must not take for ever.
_PATIENCE = 8

OVERHEAD_BYTES = _HEAD.size


@dataclass(frozen=True)
class Frame:
    """One sound record: where it begins in its file, its number, its payload."""

    offset: int
    sequence: int
    payload: bytes

    @property
    def end(self) -> int:
        """Where the next one begins."""
        return self.offset + OVERHEAD_BYTES + len(self.payload)


@dataclass(frozen=True)
class Damage:
    """Bytes `offset` to `end` of a file hold no sound record; `torn` if nothing sound follows them."""

    offset: int
    end: int
    torn: bool


def pack(offset: int, sequence: int, payload: bytes) -> bytes:
    """The frame of a record that will begin at `offset` of its file.

    Raises:
        ValueError: the payload is larger than `MAXIMUM_PAYLOAD_BYTES`.
    """
    if len(payload) > MAXIMUM_PAYLOAD_BYTES:
        raise ValueError(f"a record has at most {MAXIMUM_PAYLOAD_BYTES} bytes, not {len(payload)}")
    return _HEAD.pack(MARKER, len(payload), sequence, _checksum(offset, sequence, payload)) + payload


def scan(file: BinaryIO) -> Iterator[Frame | Damage]:
    """Every sound frame of a file opened for reading, in order, and what is damaged in between.

    Raises:
        OSError: the file can't be read.
    """
    size = file.seek(0, 2)
    patience = [_PATIENCE * size + MAXIMUM_PAYLOAD_BYTES]
    offset = 0
    while offset < size:
        frame = _read(file, offset, size)
        if frame is not None:
            yield frame
            offset = frame.end
            continue
        following = _next(file, offset + 1, size, patience)
        end = size if following is None else following
        yield Damage(offset, end, torn=following is None)
        offset = end


def cut_torn_tail(path: Path) -> int:
    """Cut what follows a file's last sound record; returns how many bytes that was. OSError if it can't be read."""
    end, size = 0, 0
    with path.open("rb") as file:
        for part in scan(file):
            size = part.end
            if isinstance(part, Damage):
                continue
            end = part.end
    if size > end:
        os.truncate(path, end)
    return size - end


def _checksum(offset: int, sequence: int, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(_SEALED.pack(offset, len(payload), sequence)))


def _read(file: BinaryIO, offset: int, size: int, patience: list[int] | None = None) -> Frame | None:
    """The frame that begins here, None if none does."""
    file.seek(offset)
    head = file.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    marker, length, sequence, checksum = _HEAD.unpack(head)
    if marker != MARKER or length > min(MAXIMUM_PAYLOAD_BYTES, size - offset - _HEAD.size):
        return None
    if patience is not None:
        patience[0] -= length
    payload = file.read(length)
    if len(payload) < length or checksum != _checksum(offset, sequence, payload):
        return None
    return Frame(offset, sequence, payload)


def _next(file: BinaryIO, offset: int, size: int, patience: list[int]) -> int | None:
    """Where the first sound frame from `offset` on begins."""
    while offset < size and patience[0] > 0:
        file.seek(offset)
        piece = file.read(_PIECE_BYTES)
        patience[0] -= len(piece)
        found = piece.find(MARKER)
        while found >= 0 and patience[0] > 0:
            if _read(file, offset + found, size, patience) is not None:
                return offset + found
            found = piece.find(MARKER, found + 1)
        if len(piece) < len(MARKER):
            return None
        offset += len(piece) - len(MARKER) + 1
    return None
