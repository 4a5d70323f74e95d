"""What reads bytes from outside: each with sound inputs, and with the only errors that it may answer others with."""

import functools
import hashlib
import io
import json
import tempfile
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cbor2
import netCDF4
import numpy as np
import shapely
import zstandard
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy import config, digest, frames, jobs, records, structure, wire, wire_commands
from autonomy.bridge.configuration import BridgeConfiguration, load_bridge
from autonomy.bridge.lines import LineSplitter
from autonomy.bridge.recorded import RecordingError, read_recorded
from autonomy.bridge.translator import Translator
from autonomy.charting import survey_notice
from autonomy.config import Configuration, ConfigurationError
from autonomy.core import Core
from autonomy.effects import Answer, Outcome, Publish, Topic
from autonomy.events import (
    CommandReceived,
    DeadlineReached,
    JobFailed,
    JobFinished,
    LinkDown,
    LinkUp,
    MessageReceived,
)
from autonomy.geometry import LocalFrame
from autonomy.learning import snapshot
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import SquaredExponential
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import EPOCH_UTC_S, KeyFormatError, Signing, SigningKey
from autonomy.planning.depth import shallow_water
from autonomy.planning.errors import SurveyError
from autonomy.planning.plan import Plan
from autonomy.planning.polygon_files import Role, read_polygons
from autonomy.planning.survey import SurveyArea
from autonomy.records import RecordDecoder, RecordError
from autonomy.replay import read_configuration, read_survey_area
from autonomy.shell import checkpoint
from autonomy.shell.checkpoint import Checkpoint, CheckpointError
from autonomy.shell.journal_files import JournalError, read_header
from sim.field import FieldError
from sim.field_netcdf import open_netcdf

ROOT = Path(__file__).resolve().parents[2]
AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
CONFIGURATION = Configuration.model_validate({"survey": {"area": AREA}})
FRAME = LocalFrame(33.5, -118.5)
SURVEY = SurveyArea.from_geometry(FRAME, shapely.box(0, 0, 3000, 2000), passage_cells=20)
ACK = mavlink.MAV_RESULT_ACCEPTED


@dataclass(frozen=True)
class Decoder:
    """One reader of bytes.

    Attributes:
        read: reads them.
        seeds: sound inputs; of sealed ones, what is inside.
        errors: what it may raise, for anything.
        tokens: what inputs are made of.
        seal: puts mutated content in a frame whose checksum agrees; None: there is none.
        cost: how many times as costly as others: so many fewer inputs are read.
    """

    read: Callable[[bytes], Any]
    seeds: Callable[[], Sequence[bytes]]
    errors: tuple[type[Exception], ...] = ()
    tokens: Sequence[bytes] = ()
    seal: Callable[[bytes], bytes] | None = None
    cost: int = 1


CBOR_TOKENS = [
    bytes([byte]) for byte in (0x00, 0x20, 0x40, 0x60, 0x80, 0xA0, 0xC0, 0xE0, 0xF4, 0xF6, 0xF7, 0x9F, 0xFF)
] + [
    *(b"\xd9" + tag.to_bytes(2, "big") for tag in (28, 35, 64, 85, 86, 258)),
    *(b"\xda" + tag.to_bytes(4, "big") for tag in range(70_000, 70_006)),
    *(b"\xc2", b"\xc4\x82\x3a\x7f\xff\xff\xff\x01", b"\xf9\x7e\x00", b"\xf9\x7c\x00", b"\x1b" + b"\xff" * 8),
    *(b"\x9a\x7f\xff\xff\xff", b"\x9b" + b"\xff" * 8, b"\xba\x7f\xff\xff\xff", b"\x5a\x7f\xff\xff\xff"),
    *(b"\x81" * 50, b"\x61a", b"\xfb\x7f\xf0" + bytes(6), b"\xfb" + b"\xff" * 8),
]


# MAVLink ---------------------------------------------------------------------------------------------------------


def messages() -> list[Any]:
    """One of everything that the core listens to, as an autopilot would say it."""
    us = (1, 191)
    place = (335_000_000, -1_185_000_000)
    return [
        mavlink.MAVLink_heartbeat_message(11, 3, 209, 10, 4, 3),
        mavlink.MAVLink_heartbeat_message(11, 3, 81, 0, 5, 3),
        mavlink.MAVLink_global_position_int_message(120_000, *place, 0, 0, 100, 0, 0, 9000),
        mavlink.MAVLink_gps_raw_int_message(120_000_000, 3, *place, 0, 90, 90, 100, 0, 9),
        mavlink.MAVLink_ekf_status_report_message(0x1F, 0.1, 0.1, 0.1, 0.1, 0.1),
        mavlink.MAVLink_named_value_float_message(120_000, b"SALT", 33.5),
        mavlink.MAVLink_mission_current_message(1, 5, 3, 1),
        mavlink.MAVLink_mission_item_reached_message(1),
        mavlink.MAVLink_mission_count_message(*us, 3, 0),
        mavlink.MAVLink_mission_count_message(*us, 4, 1),
        mavlink.MAVLink_mission_item_int_message(*us, 0, 0, 16, 0, 1, 0, 0, 0, 0, *place, 0, 0),
        mavlink.MAVLink_mission_item_int_message(*us, 1, 3, 5001, 0, 1, 4, 0, 0, 0, *place, 0, 1),
        mavlink.MAVLink_mission_request_message(*us, 0, 0),
        mavlink.MAVLink_mission_request_int_message(*us, 1, 0),
        mavlink.MAVLink_mission_ack_message(*us, 0, 0),
        mavlink.MAVLink_command_ack_message(224, ACK, 0, 0, *us),
        mavlink.MAVLink_command_ack_message(511, ACK, 0, 0, *us),
        mavlink.MAVLink_param_value_message(b"FENCE_TYPE", 6.0, 9, 1, 0),
        mavlink.MAVLink_param_value_message(b"FENCE_ENABLE", 1.0, 9, 1, 0),
        mavlink.MAVLink_param_value_message(b"FENCE_RADIUS", 300.0, 9, 1, 0),
        mavlink.MAVLink_home_position_message(*place, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12_000, 100, 80, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_battery_status_message(0, 0, 1, 2000, [4000] * 10, 100, 500, -1, 80),
        mavlink.MAVLink_system_time_message(1_700_000_000_000_000, 120_000),
        mavlink.MAVLink_timesync_message(1, 2),
        mavlink.MAVLink_statustext_message(4, b"EKF3 lane switch"),
    ]


def frame_of(message: Any, sequence: int = 0) -> bytes:
    codec = Codec(1, 1)
    codec._mav.seq = sequence
    return codec.encode(message)


FRAMES = [frame_of(message) for message in messages()]


def key() -> SigningKey:
    return SigningKey(bytes(range(32)))


def signing() -> Signing:
    return Signing(key(), lambda: EPOCH_UTC_S + 1e7)


def checked_frame(content: bytes) -> bytes:
    """A MAVLink 2 frame of the message that the first byte names, with the rest as its payload."""
    message = FRAMES[content[0] % len(FRAMES)] if content else FRAMES[0]
    payload = content[1:256]
    head = bytes([0xFD, len(payload), 0, 0, message[4], message[5], message[6], *message[7:10]])
    crc = mavlink.x25crc(head[1:] + payload)
    crc.accumulate(bytes([mavlink.mavlink_map[int.from_bytes(message[7:10], "little")].crc_extra]))
    return head + payload + int(crc.crc).to_bytes(2, "little")


def payloads() -> list[bytes]:
    return [bytes([number]) + each[10:-2] for number, each in enumerate(FRAMES)]


def read_stream(data: bytes) -> None:
    codec = Codec(1, 191)
    for start in range(0, len(data), 100):
        for message in codec.decode(data[start : start + 100]):
            message.get_type()


def read_signed(data: bytes) -> None:
    codec = Codec(1, 191, signing())
    codec.decode(data)


def signed_frames() -> list[bytes]:
    codec = Codec(1, 1, signing())
    return [codec.encode(message) for message in messages()]


def signed(content: bytes) -> bytes:
    """Wrong in everything but the signature."""
    body = content[:-13] + content[-13:-6] if len(content) > 13 else content
    return body + key().signature(body)


class Listener:
    """A core that is told everything that comes, and asked for its decisions; begun anew now and then."""

    def __init__(self) -> None:
        self._codec = Codec(1, 191)
        self._heard = 0

    def _begin(self) -> None:
        self._core = Core(CONFIGURATION, SURVEY)
        self._now = 1000.0
        self._happened(LinkUp())
        for data in FRAMES:
            self.hear(data)

    def hear(self, data: bytes) -> None:
        for message in self._codec.decode(data):
            self._now += 0.05
            self._happened(MessageReceived(message))

    def read(self, data: bytes) -> None:
        if self._heard % 300 == 0:
            self._begin()
        self._heard += 1
        self.hear(data)
        match self._heard % 7:
            case 0:
                self._now += 1.0
                self._happened(DeadlineReached())
            case 1:
                for each in FRAMES[:6]:
                    self.hear(each)
            case 2 if self._heard % 5 == 0:
                self._happened(JobFailed(self._core._jobs_started, "no time"))
        if self._heard % 120 == 0:
            self._happened(LinkDown("unplugged"))
            self._happened(LinkUp())

    def _happened(self, event: Any) -> None:
        self._core.handle(self._now, event)
        if self._core.next_deadline() <= self._now:
            self._core.handle(self._now, DeadlineReached())


# What goes ashore, and what is kept --------------------------------------------------------------------------------


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


def unpacked(data: bytes) -> bytes:
    return zstandard.ZstdDecompressor().decompress(data)


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


# The journal -------------------------------------------------------------------------------------------------------


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


# Files of people ---------------------------------------------------------------------------------------------------


@functools.cache
def folder() -> Path:
    made = tempfile.TemporaryDirectory(prefix="decoders-")
    KEPT.append(made)
    return Path(made.name)


KEPT: list[Any] = []
"""Removed at the end of the process."""


def scratch(name: str) -> Path:
    return folder() / name


def reader_of(name: str, read: Callable[[Path], Any]) -> Callable[[bytes], Any]:
    def from_file(data: bytes) -> Any:
        path = scratch(name)
        path.write_bytes(data)
        return read(path)

    return from_file


def shipped_configuration() -> list[bytes]:
    root = Path(__file__).resolve().parents[2]
    whole = (root / "config" / "default.yaml").read_bytes()
    lines = [line for line in whole.splitlines(keepends=True) if not line.strip().startswith(b"#")]
    return [
        b"".join(lines),
        b"survey: {area: [[33.4, -118.6], [33.4, -118.4], [33.6, -118.4]]}\nmodel: {capacity: 50}\n",
    ]


RING = [[-118.6, 33.4], [-118.4, 33.4], [-118.4, 33.6], [-118.6, 33.6], [-118.6, 33.4]]


def geojson() -> list[bytes]:
    polygon = {
        "type": "Polygon",
        "coordinates": [RING, [[-118.5, 33.5], [-118.49, 33.5], [-118.49, 33.51], [-118.5, 33.5]]],
    }
    many = {"type": "MultiPolygon", "coordinates": [[RING]]}
    features = [
        {"type": "Feature", "id": 3, "properties": {"name": "bay"}, "geometry": each}
        for each in (polygon, many)
    ]
    return [
        json.dumps(each).encode()
        for each in (polygon, features[0], {"type": "FeatureCollection", "features": features})
    ]


def qgc_plans() -> list[bytes]:
    corners = [[lat, lon] for lon, lat in RING[:-1]]
    fence = {
        "version": 2,
        "polygons": [{"inclusion": True, "polygon": corners, "version": 1}],
        "circles": [{"inclusion": False, "circle": {"center": [33.5, -118.5], "radius": 200}, "version": 1}],
    }
    survey = {"type": "ComplexItem", "complexItemType": "survey", "polygon": corners}
    plan = {"fileType": "Plan", "version": 1, "groundStation": "QGroundControl", "geoFence": fence}
    return [json.dumps(plan | {"mission": {"items": items}}).encode() for items in ([], [survey])]


def kml() -> list[bytes]:
    ring = " ".join(f"{lon},{lat},0" for lon, lat in RING)
    boundary = (
        f"<outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs>"
    )
    inside = f"<Document><Folder><Placemark><Polygon>{boundary}</Polygon></Placemark></Folder></Document>"
    head = '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">'
    return [
        f"{head}{inside}</kml>".encode(),
        f"{head}{inside}</kml>".encode().replace(b"UTF-8", b"latin-1"),
    ]


def kmz_of(content: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", content)
    return out.getvalue()


def depth_grid() -> list[bytes]:
    head = "ncols 4\nnrows 4\nxllcorner -118.7\nyllcorner 33.3\ncellsize 0.1\nNODATA_value -9999\n"
    rows = "-5 -20 -9999 3\n" * 4
    return [
        (head + rows).encode(),
        head.replace("corner", "center").replace("NODATA", "nodata").encode() + rows.encode(),
    ]


def read_depths(path: Path) -> None:
    for positive in ("up", "down"):
        shallow_water(path, (-118.6, 33.4, -118.4, 33.6), (-118.65, 33.35, -118.35, 33.65), 10.0, positive)


def netcdf() -> list[bytes]:
    """A small sea in each of the formats; with HDF5, one compressed and chunked."""
    return [
        netcdf_file(form, **storage)
        for form, storage in (
            ("NETCDF3_CLASSIC", {}),
            ("NETCDF3_64BIT_OFFSET", {}),
            ("NETCDF4", {}),
            ("NETCDF4", {"zlib": True, "chunksizes": (1, 4, 5)}),
        )
    ]


def netcdf_file(form: str, **storage: Any) -> bytes:
    path = scratch("sound.nc")
    with netCDF4.Dataset(path, "w", format=form) as dataset:
        for name, size in (("time", 2), ("lat", 8), ("lon", 10)):
            dataset.createDimension(name, size)
            variable = dataset.createVariable(name, "f8", (name,))
            variable[:] = np.arange(size) * (3600.0 if name == "time" else 0.01)
            variable.units = {
                "time": "seconds since 2020-01-01",
                "lat": "degrees_north",
                "lon": "degrees_east",
            }[name]
        salt = dataset.createVariable("salt", "i2", ("time", "lat", "lon"), fill_value=-999, **storage)
        salt.setncatts({"scale_factor": 0.01, "add_offset": 30.0, "units": "1e-3"})
        salt.set_auto_maskandscale(False)
        salt[:] = np.arange(160).reshape(2, 8, 10)
    return path.read_bytes()


def read_key(data: bytes) -> None:
    for form in ("passphrase", "key"):
        try:
            SigningKey.from_file_content(data, form)
        except KeyFormatError:
            continue


def polygons(name: str, role: Role) -> Callable[[bytes], Any]:
    return reader_of(name, lambda path: read_polygons(path, role))


YAML_TOKENS = [bytes([byte]) for byte in b"-[]{},:#&*!|>'\"%@`\t\n\\? "] + [
    *(
        b"!!binary ",
        b"&a ",
        b"*a",
        b"<<: ",
        b"---\n",
        b".nan",
        b"1e999",
        b"0x",
        b"null",
        b'"\\UFFFFFFFF"',
        b"\xff",
    ),
    *(b"survey:", b"area", b"[" * 40, b"9" * 5000, b"? ", b"\r", b"\xe2\x80\xa8", b"%YAML 1.2\n"),
]
JSON_TOKENS = [
    *(
        b"[",
        b"]",
        b"{",
        b"}",
        b",",
        b":",
        b'"',
        b"null",
        b"true",
        b"NaN",
        b"Infinity",
        b"-1e999",
        b"9" * 5000,
        b"\\ud800",
    ),
    *(
        b'"type"',
        b'"coordinates"',
        b'"Polygon"',
        b'"features"',
        b"[" * 500,
        b"1e308",
        b"-0.0",
        b"\xff",
        b'"radius"',
    ),
]
KML_TOKENS = [
    *(
        b"<",
        b">",
        b"</",
        b"&amp;",
        b"&#x10ffff;",
        b"<![CDATA[",
        b"<!DOCTYPE a [<!ENTITY b 'c'>]>",
        b"<!--",
        b"]]>",
    ),
    *(
        b"<Polygon>",
        b"</Polygon>",
        b"<coordinates>",
        b"nan,inf",
        b"<a:b>",
        b"<LineString>",
        b"\x00",
        b"\xff\xfe",
    ),
    *(b"<a>" * 60, b"1e999,0", b'encoding="utf-16"', b'encoding="punycode"', b"9" * 5000),
]
NUMBER_TOKENS = [
    b"nan",
    b"inf",
    b"-1e999",
    b"1e308",
    b"0",
    b"-9999",
    b"9" * 400,
    b"\n",
    b" ",
    b"NCOLS",
    b"\xc3",
    b"1_0",
    b"0x1",
]


NETCDF_TOKENS = [
    *(
        b"CDF\x01",
        b"CDF\x02",
        b"CDF\x05",
        b"\x89HDF\r\n\x1a\n",
        b"OHDR",
        b"FRHP",
        b"BTHD",
        b"OCHK",
        b"TREE",
        b"SNOD",
    ),
    *(b"\xff" * 8, bytes(8), b"\x00\x00\x00\x0c", b"_FillValue", b"scale_factor", b"days since 0000-00-00"),
]


def bridged() -> list[BridgeConfiguration]:
    """Bridges for each of the three shapes of a line."""
    link, values = (
        {"endpoint": "udpout:127.0.0.1:14560"},
        {"field": 2, "response_s": 2.0, "response": "sharpen"},
    )
    shapes: list[tuple[dict[str, Any], dict[str, Any]]] = [
        ({"columns": 4}, values),
        ({"pattern": r"t1=\s*(?P<t>-?\d+\.\d{4}),(?P<rest>.*)*"}, values | {"field": "t"}),
        ({"sentence": "MTW", "decimal": ","}, values | {"field": 1}),
    ]
    return [
        BridgeConfiguration.model_validate(
            {
                "instrument": {"endpoint": "serial:/dev/ttyUSB0:9600", "data_bits": 7 + number % 2},
                "line": line,
                "values": {"SALT": value},
                "mavlink": link,
            }
        )
        for number, (line, value) in enumerate(shapes)
    ]


def read_lines(data: bytes) -> None:
    """As a bridge does, cut in two, as a port might hand it over."""
    for configuration in bridged():
        splitter, translator = LineSplitter(is_stream=True), Translator(configuration)
        for piece in (b"\n", data[: len(data) // 2], data[len(data) // 2 :]):
            for line in splitter.add(piece):
                translator.take(0.0, line)


def lines() -> list[bytes]:
    return [
        b"17.1234,  4.21345,    1.052,  33.5124\r\n17.1235,  4.21346,    1.053,  33.5125\r\n",
        b"t1= 23.7658, c1= 0.00019, s1= 0.0084\r\n",
        b"$YXMTW,17,75,C*5D\r\n$GPGLL,4916.45,N,12311.12,W,225444,A*31\r\n",
    ]


def read_recording(data: bytes) -> None:
    path = scratch("raw.ndjson")
    path.write_bytes(data)
    for _ in read_recorded(path):
        pass


def wire_decoder(topic: Topic) -> Decoder:
    return Decoder(
        lambda data: wire.decode(topic, data), lambda: [payload(topic)], (wire.WireError,), CBOR_TOKENS
    )


DECODERS: dict[str, Decoder] = {
    "mavlink": Decoder(
        read_stream, lambda: [b"".join(FRAMES), *FRAMES], (), [b"\xfd", b"\xfe", b"\xfd\xff\x01"]
    ),
    "mavlink signed": Decoder(read_signed, signed_frames, (), [b"\xfd", b"\xff" * 6], signed),
    "core": Decoder(
        Listener().read,
        payloads,
        (),
        [b"\xff" * 4, bytes(4), b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"],
        checked_frame,
    ),
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
    "configuration": Decoder(
        reader_of("boat.yaml", lambda path: config.load(path, {})),
        shipped_configuration,
        (ConfigurationError,),
        YAML_TOKENS,
    ),
    "bridge": Decoder(
        reader_of("bridge.yaml", load_bridge),
        lambda: [file.read_bytes() for file in sorted((ROOT / "config" / "bridge").glob("*.yaml"))],
        (ConfigurationError,),
        YAML_TOKENS,
    ),
    "lines": Decoder(
        read_lines, lines, (), [b"\r", b"\n", b",", b"*", b"$", b"t1=", b"9" * 400, b"e999", b"\xff"], cost=10
    ),
    "recorded lines": Decoder(
        read_recording,
        lambda: [b'{"bridge": "0.1"}\n{"host_s": 1.5, "line": "33.5, 1"}\n', *lines()],
        (RecordingError,),
        JSON_TOKENS,
    ),
    "geojson": Decoder(polygons("a.geojson", "land"), geojson, (SurveyError,), JSON_TOKENS),
    "plan area": Decoder(polygons("a.plan", "area"), qgc_plans, (SurveyError,), JSON_TOKENS),
    "plan keep-out": Decoder(polygons("b.plan", "keep_out"), qgc_plans, (SurveyError,), JSON_TOKENS),
    "kml": Decoder(polygons("a.kml", "area"), kml, (SurveyError,), KML_TOKENS),
    "kmz": Decoder(polygons("a.kmz", "area"), kml, (SurveyError,), KML_TOKENS, kmz_of),
    "depth": Decoder(reader_of("depth.asc", read_depths), depth_grid, (SurveyError,), NUMBER_TOKENS),
    "netcdf": Decoder(reader_of("damaged.nc", open_netcdf), netcdf, (FieldError,), NETCDF_TOKENS, cost=50),
    "key": Decoder(read_key, lambda: [b"a phrase\n", b"ab" * 32, bytes(32)], (), [b"\n", b"\r\n"]),
}
