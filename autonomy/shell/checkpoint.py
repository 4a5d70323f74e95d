"""A checkpoint as bytes: what the core knows, in a file that tells whether it is whole.

A file is `MAGIC`, the BLAKE2b digest (32 bytes) of the rest, and a zstd frame of CBOR:

    {"number": counts the checkpoints, "fits": {what it depends on: digest}, "now", "utc_s": when, by both clocks,
     "boot": the machine's boot, "journal": [run, sequence] or null, "memory": see `autonomy.memory`}

with arrays as ["array", type, order, [side, …], bytes]. Nothing in a file is ever run as code.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import cbor2
import numpy as np
import shapely
import zstandard

from autonomy import plain_cbor
from autonomy.config import Configuration
from autonomy.memory import Memory
from autonomy.planning.survey import SurveyArea
from autonomy.shell.journal_files import Position

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


class CheckpointError(ValueError):
    """A file that is no sound checkpoint; says why."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """What a core knew at one moment.

    Attributes:
        number: counts the written checkpoints of a boat; the highest is the newest. 0 before it is written.
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
