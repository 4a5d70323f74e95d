"""What goes ashore and comes from there: wire, commands, snapshots, digests."""

import functools
import zlib
from typing import Any

import cbor2
import zstandard

from autonomy import digest, wire, wire_commands
from autonomy.charting import survey_notice
from autonomy.core import Core
from autonomy.effects import Answer, Outcome, Publish, Topic
from autonomy.events import DeadlineReached
from autonomy.learning import snapshot
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import SquaredExponential

from .decoder import CBOR_TOKENS, Decoder, unpacked
from .survey import CONFIGURATION, FRAME, SURVEY


@functools.cache
def model() -> Any:
    gp = SparseOnlineGP(
        Kernel((Component(1.0, SquaredExponential((300.0, 300.0))),), 0.01), 6, prior_mean=33.0
    )
    for k in range(12):
        gp.update((250.0 * k % 3000, 170.0 * k % 2000), 33.0 + 0.1 * k)
    return gp.model()


@functools.cache
def payload(topic: Topic) -> bytes:
    figures = CalibrationFigures(0.95, 1.0, -0.5, 20)
    values: dict[Topic, Any] = {
        Topic.MODEL: wire.ModelSnapshot(
            "boat", 3, "0.1", "sea_water_salinity", "1", model(), 100.0, None, 12, 0.2, 1, figures, figures,
            33.5, -118.5, (0.0, 0.0, 3000.0, 2000.0), "a survey", 6, 0.6, "0123456789abcdef",
        ),
        Topic.PLAN: wire.PlanNotice(
            1, (33.5, -118.5), ((33.51, -118.5), (33.52, -118.49)), (True, False), 1.5, "route", "first plan",
            2.0, 1.0, 0.3, (("lawnmower", 2.5),), 7, 12,
        ),
        Topic.OBSERVATIONS: wire.ObservationBatch(5, 2, 0, 9, tuple(
            wire.ObservationNotice(float(k), 33.5, -118.5, 33.0 + k, 1, (1, 1, 1, 1, 1, 1, 1)) for k in range(3)
        )),
        Topic.HEALTH: health(figures),
        Topic.LOG: wire.LogBatch(5, 0, 0, 1, (wire.LogNotice("info", "sailing", 1e9),)),
        Topic.SURVEY: survey_notice(CONFIGURATION, SURVEY),
        Topic.STATUS: wire.StatusDigest(b"a digest"),
    }  # fmt: skip
    return wire.encode(values[topic])


def health(figures: CalibrationFigures) -> wire.HealthNotice:
    """As a core tells it."""
    core = Core(CONFIGURATION, SURVEY)
    told = [
        effect.payload
        for now in range(20)
        for effect in core.handle(1000.0 + now, DeadlineReached())
        if isinstance(effect, Publish) and effect.topic is Topic.HEALTH
    ]
    return told[-1]


TOKEN = wire_commands.Token(b"a secret of 22 bytes..")
REQUEST = wire_commands.Request(bytes(range(16)), "boat1", "pause", 1.7e9, 30.0)
ANSWER = Answer(bytes(16), "pause", Outcome.DONE, "so it is", "paused", "from ashore", "AUTO", True, 1.7e9)


def packed(content: bytes) -> bytes:
    return zstandard.ZstdCompressor(write_checksum=True).compress(content)


def digests() -> list[digest.Digest]:
    """With a map and without."""
    coarse, mean_sd = digest.charted(model(), FRAME, (33.4, -118.6, 33.6, -118.4))
    told = digest.Digest(
        "boat1",
        1_790_000_000,
        *(33.5, -118.5),
        state="exploring",
        kernel=model().kernel,
        route_deg=((33.5, -118.5), (33.51, -118.49), (33.52, -118.5)),
        bounds_deg=(33.4, -118.6, 33.6, -118.4),
        mean_sd=mean_sd,
        coarse=coarse,
    )
    return [told, digest.Digest("boat1")]


def read_digest(data: bytes) -> None:
    read = digest.decode(data)
    if read.coarse is not None:
        read.map(20, 20)


def read_snapshot(data: bytes) -> None:
    snapshot.decode(data).predict([[0.0, 0.0], [1e6, 1e6]])


def wire_decoder(topic: Topic) -> Decoder:
    return Decoder(
        lambda data: wire.decode(topic, data), lambda: [payload(topic)], (wire.WireError,), CBOR_TOKENS
    )


DECODERS = {
    **{f"wire {topic.value}": wire_decoder(topic) for topic in Topic},
    "command": Decoder(
        lambda data: wire_commands.decode_request(data, "boat1", None),
        lambda: [wire_commands.encode_request(REQUEST, None), wire_commands.encode_request(REQUEST, TOKEN)],
        (wire.WireError,),
        CBOR_TOKENS,
    ),
    "command sealed": Decoder(
        lambda data: wire_commands.decode_request(data, "boat1", TOKEN),
        lambda: [cbor2.loads(wire_commands.encode_request(REQUEST, None))["command"]],
        (wire.WireError,),
        CBOR_TOKENS,
        lambda content: cbor2.dumps(
            {"v": wire.VERSION, "command": content, "mac": TOKEN.code("command", content)}
        ),
    ),
    "command answer": Decoder(
        lambda data: wire_commands.decode_answer(data, None),
        lambda: [wire_commands.encode_answer(ANSWER, recorded=True, token=None)],
        (wire.WireError,),
        CBOR_TOKENS,
    ),
    "snapshot": Decoder(
        read_snapshot,
        lambda: [unpacked(snapshot.encode(model(), None, precision)) for precision in snapshot.PRECISIONS],
        (snapshot.SnapshotError,),
        CBOR_TOKENS,
        packed,
    ),
    "digest": Decoder(
        read_digest,
        lambda: [digest.encode(each)[:-4] for each in digests()],
        (digest.DigestError,),
        [b"\xff" * 4, bytes(4), b"\x00\x00\xc0\x7f", b"\x01", b"\x80\x80\xff\x14"],
        lambda content: content + zlib.crc32(content).to_bytes(4, "little"),
    ),
}
