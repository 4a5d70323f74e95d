"""What people ashore receive: the published values, their keys and their CBOR form; see docs/wire.md."""

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import cbor2
import numpy as np
import zstandard

from autonomy.effects import Topic
from autonomy.learning import snapshot
from autonomy.learning.calibration import CalibrationFigures
from autonomy.plain_cbor import OBJECT_TAGS
from autonomy.wire_kinds import FLOAT64_TAG, INT32_TAG, UINT8_TAG, VersionError, WireError, brief, opened
from autonomy.wire_rules import (
    MAXIMUM_KERNEL,
    MAXIMUM_LINE,
    MAXIMUM_OBSERVATIONS,
    MAXIMUM_REASON,
    MAXIMUM_REJECTED,
    PARALLEL,
    RING_UNITS_PER_DEG,
    VEHICLE_NAME,
    checked,
)
from autonomy.wire_values import (
    HealthNotice,
    LogBatch,
    LogNotice,
    Message,
    ModelSnapshot,
    Numbered,
    ObservationBatch,
    ObservationNotice,
    Payload,
    PlanNotice,
    Ring,
    StatusDigest,
    SurveyNotice,
)

__all__ = [
    "MAXIMUM_BYTES",
    "MAXIMUM_OBSERVATIONS",
    "OBJECT_TAGS",
    "VEHICLE_NAME",
    "VERSION",
    "HealthNotice",
    "LogBatch",
    "LogNotice",
    "Message",
    "ModelSnapshot",
    "Numbered",
    "ObservationBatch",
    "ObservationNotice",
    "Payload",
    "PlanNotice",
    "Ring",
    "StatusDigest",
    "SurveyNotice",
    "VersionError",
    "WireError",
    "alive_key",
    "decode",
    "encode",
    "key",
    "parse",
    "predict_key",
    "predict_schema",
    "schema",
    "split_key",
]

VERSION = 3
MAXIMUM_BYTES = 16 * 2**20

_MAXIMUM_ITEMS = 10_000


def key(vehicle: str, topic: Topic) -> str:
    """The zenoh key of a vehicle's topic."""
    return f"usv/{vehicle}/{topic.value}"


def predict_key(vehicle: str) -> str:
    """The key under which a vehicle is asked what its model says of places; see `autonomy.predicting`."""
    return f"usv/{vehicle}/predict"


def predict_schema() -> str:
    """Name of the schema of an answer under that key."""
    return f"halocline/predict/{VERSION}"


def alive_key(vehicle: str) -> str:
    """The key of the liveliness token that stands while the vehicle's software is connected."""
    return f"usv/{vehicle}/alive"


def split_key(text: str) -> tuple[str, str]:
    """Vehicle and last part of a received key; raises WireError if it isn't `usv/<vehicle>/<topic>`."""
    parts = text.split("/")
    if len(parts) != 3 or parts[0] != "usv" or not VEHICLE_NAME.fullmatch(parts[1]):
        raise WireError(f"key {text[:80]!r}: must be usv/<vehicle>/<topic>")
    return parts[1], parts[2]


def schema(topic: Topic) -> str:
    """Name of the payload's schema, for zenoh's encoding `application/cbor;<schema>`."""
    return f"halocline/{topic.value}/{VERSION}"


def _float64(numbers: Sequence[float] | Sequence[tuple[float, float]]) -> cbor2.CBORTag:
    return cbor2.CBORTag(FLOAT64_TAG, np.asarray(numbers, dtype="<f8").tobytes())


def _plain(value: Any) -> Any:
    """NaN and infinities become null, which only the rules of numbers that may be unknown accept."""
    if isinstance(value, CalibrationFigures):
        return _fields(value)
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _fields(value: Any) -> dict[str, Any]:
    return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}


def _cut(sentence: str, maximum: int) -> str:
    """A sentence for a person is better cut than lost."""
    return sentence if len(sentence) <= maximum else sentence[: maximum - 1] + "…"


def _as_map(value: Message, inducing: int | None) -> tuple[Topic, dict[str, Any]]:
    match value:
        case ObservationBatch():
            return Topic.OBSERVATIONS, _numbers_of(value) | _observation_columns(value.items)
        case LogBatch():
            lines = [[line.level, _cut(line.text, MAXIMUM_LINE), _plain(line.utc_s)] for line in value.items]
            return Topic.LOG, {**_numbers_of(value), "lines": lines}
    content = _fields(value)
    match value:
        case ModelSnapshot():
            content["model"] = _encode_model(value, inducing)
            content["bounds_m"] = _float64(value.bounds_m)
            # The byte string says these itself.
            del content["precision"], content["stated_error"], content["believed"]
            return Topic.MODEL, content
        case PlanNotice():
            content["start_deg"] = _float64(value.start_deg)
            content["route_deg"] = _float64(value.route_deg)
            content["is_spot"] = cbor2.CBORTag(UINT8_TAG, bytes(value.is_spot))
            content["reason"] = _cut(value.reason, MAXIMUM_REASON)
            content["rejected"] = [list(each) for each in value.rejected[:MAXIMUM_REJECTED]]
            return Topic.PLAN, content
        case HealthNotice():
            content["reason"] = _cut(value.reason, MAXIMUM_REASON)
            content["kernel"] = _cut(value.kernel, MAXIMUM_KERNEL)
            for name in ("journal", "security", "shore"):
                content[name] = _cut(content[name], MAXIMUM_REASON)
            return Topic.HEALTH, content
        case SurveyNotice():
            content["valid_range"] = [_plain(end) for end in value.valid_range]
            content["bounds_deg"] = _float64(value.bounds_deg)
            for name in ("area", "land", "keep_in", "keep_out", "fence"):
                content[name] = [_ring(ring) for ring in getattr(value, name)]
            return Topic.SURVEY, content
        case StatusDigest():
            return Topic.STATUS, content


def _numbers_of(batch: Numbered) -> dict[str, Any]:
    return {"run": batch.run, "first": batch.first, "oldest": batch.oldest, "end": batch.end}


def _observation_columns(notices: Sequence[ObservationNotice]) -> dict[str, Any]:
    names = ("model_time_s", "lat_deg", "lon_deg")
    content: dict[str, Any] = {name: _float64([getattr(one, name) for one in notices]) for name in names}
    content["value"] = _float64([one.value if math.isfinite(one.value) else math.nan for one in notices])
    content["flag"] = cbor2.CBORTag(UINT8_TAG, bytes(one.flag for one in notices))
    content["checks"] = cbor2.CBORTag(UINT8_TAG, bytes(flag for one in notices for flag in one.checks))
    return content


def _ring(ring: Ring) -> cbor2.CBORTag:
    rounded = np.rint(np.asarray(ring, dtype=float) * RING_UNITS_PER_DEG)
    return cbor2.CBORTag(INT32_TAG, rounded.astype("<i4").tobytes())


def encode(value: Message, *, packed: bool = False, inducing: int | None = None) -> bytes:
    """The CBOR form of a message.

    A sentence that is too long is cut, and of too many rejected candidates the best are told.

    Args:
        value: the message. A model goes with the precision that it names.
        packed: compressed by zstd, for thin links.
        inducing: of a model that is not to be lossless, the most places that it may be sent at; None: all.

    Raises:
        WireError: a field is outside the bounds that `decode` accepts; names topic, field and bound.
    """
    topic, content = _as_map(value, inducing)
    checked(topic, content)
    try:
        payload: bytes = cbor2.dumps({"v": VERSION, **content})
    except UnicodeEncodeError as error:
        raise WireError(f"{topic.value}: a text cannot be written as UTF-8: {error.reason}") from None
    return zstandard.ZstdCompressor(level=9).compress(payload) if packed else payload


def decode(topic: Topic, payload: bytes) -> Message:
    """The value in received bytes, which may come from anybody.

    Raises:
        VersionError: a map of another version.
        WireError: not CBOR, too large, a field missing, of a wrong type or out of bounds.
    """
    content = parse(topic, payload)
    if content.get("v") != VERSION:
        raise VersionError(
            f"{topic.value}: v: must be {VERSION} (got {brief(content.get('v'))}): "
            "the software on board and ashore must be of the same version; update the older"
        )
    values = checked(topic, content)
    match topic:
        case Topic.MODEL:
            read = _decode_model(values["model"])
            error = (read.stated_error.mean, read.stated_error.sd)
            known = {"model": read.model, "precision": read.precision, "stated_error": error}
            return ModelSnapshot(**{**values, **known, "believed": read.kernel})
        case Topic.PLAN:
            return PlanNotice(**values)
        case Topic.OBSERVATIONS:
            columns = [values.pop(name) for name in PARALLEL[topic]]
            notices = tuple(ObservationNotice(*row) for row in zip(*columns, strict=True))
            return ObservationBatch(**values, items=notices)
        case Topic.HEALTH:
            return HealthNotice(**values)
        case Topic.LOG:
            lines = tuple(LogNotice(*row) for row in values.pop("lines"))
            return LogBatch(**values, items=lines)
        case Topic.SURVEY:
            return SurveyNotice(**values)
        case Topic.STATUS:
            return StatusDigest(**values)


def parse(topic: Topic, payload: bytes) -> dict[str, Any]:
    """The map in a payload, before its version and its fields are looked at.

    Raises:
        WireError: it is none, or too large.
    """
    return opened(
        topic.value,
        _unpacked(topic, payload),
        maximum_bytes=MAXIMUM_BYTES,
        maximum_items=_MAXIMUM_ITEMS,
        maximum_depth=4,
    )


def _unpacked(topic: Topic, payload: bytes) -> bytes:
    """What was packed, which says before how large it is."""
    if not payload.startswith(zstandard.FRAME_HEADER):
        return payload
    try:
        size = zstandard.get_frame_parameters(payload).content_size
        if size > MAXIMUM_BYTES:
            raise WireError(f"{topic.value}: must have at most {MAXIMUM_BYTES} bytes unpacked")
        return zstandard.ZstdDecompressor().decompress(payload, max_output_size=MAXIMUM_BYTES)
    except zstandard.ZstdError as error:
        raise WireError(f"{topic.value}: {error}") from None


def _encode_model(value: ModelSnapshot, inducing: int | None) -> bytes:
    try:
        thinner = None if value.precision == "lossless" else inducing
        return snapshot.encode(value.model, precision=value.precision, inducing=thinner)
    except ValueError as error:
        raise WireError(f"model: model: {error}") from None


def _decode_model(blob: bytes) -> snapshot.Snapshot:
    try:
        read = snapshot.read(blob)
    except ValueError as error:
        raise WireError(f"model: model: {error}") from None
    if read.model.kernel.dimensions != 2:
        raise WireError(f"model: model: must have two axes (got {read.model.kernel.dimensions})")
    return read
