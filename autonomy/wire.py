"""What people ashore receive: the published values, their keys and their CBOR form; see docs/wire.md."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import cbor2
import numpy as np

from autonomy import plain_cbor
from autonomy.effects import Topic
from autonomy.learning import snapshot
from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.field_model import FieldModel
from autonomy.plain_cbor import OBJECT_TAGS
from autonomy.wire_rules import (
    FLOAT64_TAG,
    MAXIMUM_KERNEL,
    MAXIMUM_LINE,
    MAXIMUM_OBSERVATIONS,
    MAXIMUM_REASON,
    MAXIMUM_REJECTED,
    PARALLEL,
    UINT8_TAG,
    VEHICLE_NAME,
    VersionError,
    WireError,
    brief,
    checked,
)

__all__ = [
    "MAXIMUM_BYTES",
    "MAXIMUM_OBSERVATIONS",
    "OBJECT_TAGS",
    "VEHICLE_NAME",
    "VERSION",
    "HealthNotice",
    "LogNotice",
    "ModelSnapshot",
    "ObservationNotice",
    "Payload",
    "PlanNotice",
    "Received",
    "VersionError",
    "WireError",
    "alive_key",
    "decode",
    "encode",
    "key",
    "schema",
    "split_key",
]

VERSION = 2
MAXIMUM_BYTES = 16 * 2**20

_MAXIMUM_ITEMS = 10_000


@dataclass(frozen=True, eq=False)
class ModelSnapshot:
    """The belief about the field at one moment, with all that is needed to draw it on a chart.

    Attributes:
        vehicle: who believes it.
        sequence: counts the snapshots of one run of the vehicle's software.
        software_version: version of that software.
        variable: what is measured (CF standard name).
        units: units of the variable.
        model: the posterior; its positions are local metres of the frame below.
        model_time_s: the moment that the map is of, by the vehicle's own clock.
        utc_s: the same moment in seconds since 1970, None while the vehicle doesn't know it.
        samples: readings learnt so far.
        rho: share of the basis vectors added since the last re-estimate.
        replans: plans made so far.
        calibration: how the newest readings agreed with what the model said of each just before learning it.
        ahead: the same of readings far from what the model that predicts them knew: whether to trust the map.
        origin_lat_deg: latitude of the survey frame's origin.
        origin_lon_deg: longitude of the survey frame's origin.
        bounds_m: x minimum, y minimum, x maximum, y maximum of the survey area, local metres.
    """

    vehicle: str
    sequence: int
    software_version: str
    variable: str
    units: str
    model: FieldModel
    model_time_s: float
    utc_s: float | None
    samples: int
    rho: float
    replans: int
    calibration: CalibrationFigures
    ahead: CalibrationFigures
    origin_lat_deg: float
    origin_lon_deg: float
    bounds_m: tuple[float, float, float, float]


@dataclass(frozen=True)
class PlanNotice:
    """A new plan.

    Attributes:
        sequence: counts the plans of one run.
        start_deg: latitude, longitude where the route begins.
        route_deg: latitude, longitude of every corner in sailing order, the start excluded.
        is_spot: which corners are sampling spots; as long as `route_deg`.
        mutual_information: of the spots, in nats; None if unknown.
        planner: name of the planner.
        reason: why there is a new plan, for a person.
        objective_before: the planner's objective, a cost, had the rest of the previous plan been sailed instead.
        objective_after: the same of this plan.
        expected_rmse: of the map once the plan has been sailed, in the units that the model is Gaussian in.
        rejected: names and objectives of candidates that lost, the best first.
        seed: of the planner's random choices.
        model_version: readings that the model knew that was planned with.
    """

    sequence: int
    start_deg: tuple[float, float]
    route_deg: tuple[tuple[float, float], ...]
    is_spot: tuple[bool, ...]
    mutual_information: float | None
    planner: str
    reason: str
    objective_before: float | None = None
    objective_after: float | None = None
    expected_rmse: float | None = None
    rejected: tuple[tuple[str, float], ...] = ()
    seed: int | None = None
    model_version: int | None = None


@dataclass(frozen=True)
class ObservationNotice:
    """One reading of the probe, in the variable's units, at a position and a time of the vehicle's clock.

    `value` is NaN where the probe sent no finite number. `flag` is QARTOD's: 1 good, 2 not evaluated, 3 suspect,
    4 fail, 9 missing; `checks` the flags of the single tests, in the order of `autonomy.quality.Check`.
    """

    model_time_s: float
    lat_deg: float
    lon_deg: float
    value: float
    flag: int
    checks: tuple[int, ...]


@dataclass(frozen=True)
class HealthNotice:
    """How the vehicle and its software are. None (or NaN) stands for a number that isn't known.

    `quality` counts the readings flagged 1, 2, 3, 4 and 9 by each test, by its name, and as `aggregate`;
    `state` is the exploration's state and `reason` why it is in it; `mode` the autopilot's mode by name; `kernel` what
    the field is believed to be like, in words; `calibration` and `ahead` as in `ModelSnapshot`; `repairs` how often
    the model had to be rebuilt because rounding had broken it;
    `distance_m` what has been sailed; `clock_rate` vehicle seconds per second of this process; `link_ok`
    whether the autopilot is heard; `worker_busy` whether a job runs; `dropped` messages for the shore that
    were thrown away for want of a listener or of room; `journal` what is wrong with the recording of the run, empty
    if nothing is; `security` what was refused on the link to the vehicle, and why; `shore` what is wrong with the way
    ashore.
    """

    state: str
    reason: str
    mode: str
    armed: bool
    lat_deg: float | None
    lon_deg: float | None
    heading_deg: float | None
    groundspeed_mps: float | None
    model_time_s: float | None
    samples: int
    basis_size: int
    rho: float | None
    rho0: float | None
    replans: int
    kernel: str
    calibration: CalibrationFigures
    ahead: CalibrationFigures
    repairs: int
    distance_m: float | None
    clock_rate: float | None
    link_ok: bool
    worker_busy: bool
    dropped: int
    journal: str
    quality: Mapping[str, tuple[int, ...]]
    security: str = ""
    shore: str = ""


@dataclass(frozen=True)
class LogNotice:
    """A line of the vehicle's log; `level` is debug, info, warning or error."""

    level: str
    text: str


Payload = (
    ModelSnapshot | PlanNotice | ObservationNotice | tuple[ObservationNotice, ...] | HealthNotice | LogNotice
)
Received = ModelSnapshot | PlanNotice | tuple[ObservationNotice, ...] | HealthNotice | LogNotice


def key(vehicle: str, topic: Topic) -> str:
    """The zenoh key of a vehicle's topic."""
    return f"usv/{vehicle}/{topic.value}"


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


def _as_map(value: Payload) -> tuple[Topic, dict[str, Any]]:
    if isinstance(value, ObservationNotice):
        value = (value,)
    if isinstance(value, tuple):
        names = ("model_time_s", "lat_deg", "lon_deg")
        content: dict[str, Any] = {name: _float64([getattr(one, name) for one in value]) for name in names}
        content["value"] = _float64([one.value if math.isfinite(one.value) else math.nan for one in value])
        content["flag"] = cbor2.CBORTag(UINT8_TAG, bytes(one.flag for one in value))
        content["checks"] = cbor2.CBORTag(UINT8_TAG, bytes(flag for one in value for flag in one.checks))
        return Topic.OBSERVATIONS, content
    content = _fields(value)
    match value:
        case ModelSnapshot():
            content["model"] = _encode_model(value.model)
            content["bounds_m"] = _float64(value.bounds_m)
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
        case LogNotice():
            content["text"] = _cut(value.text, MAXIMUM_LINE)
            return Topic.LOG, content


def encode(value: Payload) -> bytes:
    """The CBOR form of a published value (one observation, or a tuple of them, makes a batch).

    Raises:
        WireError: a field is outside the bounds that `decode` accepts; names topic, field and bound.
    """
    topic, content = _as_map(value)
    checked(topic, content)
    try:
        return cbor2.dumps({"v": VERSION, **content})
    except UnicodeEncodeError as error:
        raise WireError(f"{topic.value}: a text cannot be written as UTF-8: {error.reason}") from None


def decode(topic: Topic, payload: bytes) -> Received:
    """The value in received bytes, which may come from anybody.

    Raises:
        VersionError: a map of another version.
        WireError: not CBOR, too large, a field missing, of a wrong type or out of bounds.
    """
    content = _parse(topic, payload)
    if content.get("v") != VERSION:
        raise VersionError(
            f"{topic.value}: v: must be {VERSION} (got {brief(content.get('v'))}): "
            "the software on board and ashore must be of the same version; update the older"
        )
    values = checked(topic, content)
    match topic:
        case Topic.MODEL:
            return ModelSnapshot(**{**values, "model": _decode_model(values["model"])})
        case Topic.PLAN:
            return PlanNotice(**values)
        case Topic.OBSERVATIONS:
            columns = [values[name] for name in PARALLEL[topic]]
            return tuple(ObservationNotice(*row) for row in zip(*columns, strict=True))
        case Topic.HEALTH:
            return HealthNotice(**values)
        case Topic.LOG:
            return LogNotice(**values)


def _parse(topic: Topic, payload: bytes) -> dict[str, Any]:
    try:
        content = plain_cbor.load(
            payload, maximum_bytes=MAXIMUM_BYTES, maximum_items=_MAXIMUM_ITEMS, maximum_depth=4
        )
    except plain_cbor.CBORError as error:
        raise WireError(f"{topic.value}: {error}") from None
    if not isinstance(content, dict):
        raise WireError(f"{topic.value}: must be a map (got {brief(content)})")
    return content


def _encode_model(model: FieldModel) -> bytes:
    try:
        return snapshot.encode(model)
    except ValueError as error:
        raise WireError(f"model: model: {error}") from None


def _decode_model(blob: bytes) -> FieldModel:
    try:
        model = snapshot.decode(blob)
    except ValueError as error:
        raise WireError(f"model: model: {error}") from None
    if model.kernel.dimensions != 2:
        raise WireError(f"model: model: must have two axes (got {model.kernel.dimensions})")
    return model
