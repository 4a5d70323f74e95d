"""What the service keeps for itself: checkpoints and journals."""

import functools
import hashlib
import io
from typing import Any

import cbor2
import numpy as np
import shapely
import zstandard

from autonomy import frames, jobs, records, structure
from autonomy.core import Core
from autonomy.events import CommandReceived, DeadlineReached, JobFailed, JobFinished, MessageReceived
from autonomy.mavlink.codec import Codec
from autonomy.planning.plan import Plan
from autonomy.records import RecordDecoder, RecordError
from autonomy.replay import read_configuration, read_survey_area
from autonomy.shell import checkpoint
from autonomy.shell.checkpoint import Checkpoint, CheckpointError
from autonomy.shell.journal_files import JournalError, read_header

from .autopilot import FRAMES
from .decoder import CBOR_TOKENS, Decoder, scratch, unpacked
from .survey import CONFIGURATION, SURVEY


@functools.cache
def memory() -> bytes:
    core = Core(CONFIGURATION, SURVEY)
    core.handle(5.0, DeadlineReached())
    for k in range(20):
        core._learner.add((10.0 * k, 5.0 * k), 30.0 + 0.1 * k, float(k))
    fits = checkpoint.fits(CONFIGURATION, SURVEY)
    return checkpoint.encode(Checkpoint(1, fits, core.checkpoint(), 5.0, 1e9, "boot", None))


HEAD_BYTES = len(checkpoint.MAGIC) + 32


def sealed_checkpoint(content: bytes) -> bytes:
    body = zstandard.ZstdCompressor(level=1).compress(content)
    return checkpoint.MAGIC + hashlib.blake2b(body, digest_size=32).digest() + body


@functools.cache
def event_records() -> tuple[bytes, ...]:
    plan = Plan(np.zeros(2), np.ones((2, 2)), np.ones(2, bool), 1.0, "paper", "a test")
    found = [
        records.encode_event(5.0, MessageReceived(Codec(1, 191).decode(FRAMES[0])[0])),
        records.encode_event(6.0, JobFinished(1, jobs.ExploreResult(None, plan, None))),
        records.encode_event(7.0, JobFailed(2, "died")),
        records.encode_event(7.5, CommandReceived(bytes(16), "pause", 1.7e9, 30.0, 1.7e9)),
        records.encode_effects(Core(CONFIGURATION, SURVEY).handle(5.0, DeadlineReached())),
        records.encode_resumed(9.0, 3.0),
        records.encode_header(header()),
    ]
    return tuple(found)


def header() -> dict[str, Any]:
    shapes = {
        name: shapely.to_wkb(getattr(SURVEY, name)) for name in ("ground", "obstacles", "water", "navigable")
    }
    return {
        "schema": "halocline/journal",
        "version": 1,
        "software": "0.1",
        "run": 1,
        "now": 5.0,
        "configuration": CONFIGURATION.model_dump(mode="json"),
        "survey": {
            **shapes,
            "origin_lat_deg": 33.5,
            "origin_lon_deg": -118.5,
            "standoff_m": 0.0,
            "passage_cells": 20,
        },
    }


def journal_file() -> bytes:
    content = b""
    for number, record in enumerate(event_records(), 1):
        content += frames.pack(len(content), number, record)
    return content


def read_frames(data: bytes) -> None:
    decoder = RecordDecoder()
    for part in frames.scan(io.BytesIO(data)):
        if isinstance(part, frames.Frame):
            try:
                decoder.decode(part.payload)
            except RecordError:
                continue


def read_journal_header(data: bytes) -> None:
    path = scratch("header.journal")
    path.write_bytes(data)
    content = read_header(path)
    read_configuration(content)
    read_survey_area(content)


DECODERS = {
    "checkpoint": Decoder(
        checkpoint.decode,
        lambda: [unpacked(memory()[HEAD_BYTES:])],
        (CheckpointError,),
        CBOR_TOKENS,
        sealed_checkpoint,
    ),
    "structure": Decoder(
        structure.decode,
        lambda: [cbor2.loads(each)[2] for each in event_records()[1:3]],
        (structure.StructureError,),
        CBOR_TOKENS,
    ),
    "record": Decoder(RecordDecoder().decode, lambda: list(event_records()), (RecordError,), CBOR_TOKENS),
    "journal": Decoder(
        read_frames, lambda: [journal_file()], (), [frames.MARKER, frames.MARKER + b"\x00\x10\x00\x00"]
    ),
    "journal header": Decoder(
        read_journal_header,
        lambda: [records.encode_header(header())],
        (JournalError,),
        CBOR_TOKENS,
        lambda content: frames.pack(0, 1, content),
    ),
}
