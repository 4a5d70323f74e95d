"""What was gathered before the boat leaves: plain values, from which the checks conclude."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from shapely.geometry import Polygon

from autonomy.config import Configuration
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.safeguards import NOT_READ, Safeguards
from autonomy.mavlink.vehicle import VehicleState
from autonomy.planning.survey import SurveyArea
from autonomy.preflight.conversation import Conversation
from autonomy.quality.location import Waters
from autonomy.quality.stream import QualityControl, Reading

_ANYWHERE_M = 1e9
_PREARM = mavlink.MAV_SYS_STATUS_PREARM_CHECK
_OFFICIAL = mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL
_UNKNOWN_UINT16 = 0xFFFF
_UNKNOWN_UINT8 = 0xFF


@dataclass(frozen=True)
class Link:
    """How the link was.

    Attributes:
        trouble: why it could not be opened, or was lost; empty if it was open to the end.
        seconds: for which it was listened to.
        bytes_in, messages, bad_frames: that came in.
        refused: what signing refused, in words; empty if nothing.
        systems: heartbeats of autopilots, by system.
    """

    trouble: str = ""
    seconds: float = 0.0
    bytes_in: int = 0
    messages: int = 0
    bad_frames: int = 0
    refused: str = ""
    systems: Mapping[int, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Fix:
    """What the receiver says of itself; None is unknown."""

    fix_type: int
    satellites: int | None
    hdop: float | None


@dataclass(frozen=True)
class Vehicle:
    """What the autopilot told.

    Attributes:
        state: as last heard.
        version: major, minor, patch, and whether it is an official release; None: not told.
        prearm_ok: whether it would let itself be armed, as far as it checks; None: not told.
        fix: None: no GPS_RAW_INT came.
        position_rate_hz: of GLOBAL_POSITION_INT.
        utc_ahead_s: its clock's date less the computer's; None: it has no date.
        safeguards: None: not read, for `unread`.
        texts: what it wrote to its operator, the newest last.
    """

    state: VehicleState
    version: tuple[int, int, int, bool] | None = None
    prearm_ok: bool | None = None
    fix: Fix | None = None
    position_rate_hz: float = 0.0
    utc_ahead_s: float | None = None
    safeguards: Safeguards | None = None
    unread: str = NOT_READ
    texts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Named:
    """Readings under one name: how many, how many a second, from which systems and which components of theirs."""

    count: int
    rate_hz: float
    systems: frozenset[int]
    components: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Probe:
    """What came from the instrument, and from others like it.

    Attributes:
        named: everything that was heard, by name.
        values: readings under the configured name, with a place, oldest first.
        flags: how many were flagged good, not evaluated, suspect, fail, missing, by test.
        dropped: readings without a place or a time, by reason.
    """

    named: Mapping[str, Named] = field(default_factory=dict)
    values: tuple[float, ...] = ()
    flags: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Folder:
    """Where something is kept: what, how much room there is, and why nothing can be written there, if so."""

    what: str
    path: Path
    free_mb: float
    trouble: str = ""


@dataclass(frozen=True)
class Facts:
    """Everything.

    Attributes:
        configuration, survey: as the service would read them.
        doubts: about these, in words.
        link: how it was.
        vehicle: None: no autopilot was heard that is ours.
        probe: what came from it.
        folders: on the computer.
        routers: why each could not be reached, empty if it could, by locator.
    """

    configuration: Configuration
    survey: SurveyArea
    doubts: tuple[str, ...] = ()
    link: Link = Link()
    vehicle: Vehicle | None = None
    probe: Probe = Probe()
    folders: tuple[Folder, ...] = ()
    routers: Mapping[str, str] = field(default_factory=dict)


def vehicle_of(conversation: Conversation, seconds: float, clock: tuple[float, float]) -> Vehicle | None:
    """What a conversation of so many seconds has told; `clock` is a protocol time and the computer's date then."""
    state, reading = conversation.state, conversation.safeguards
    if state is None:
        return None
    return Vehicle(
        state=state,
        version=_version(conversation.version),
        prearm_ok=_prearm(conversation),
        fix=_fix(conversation),
        position_rate_hz=conversation.counts["GLOBAL_POSITION_INT"] / max(seconds, 1e-9),
        utc_ahead_s=_utc_ahead_s(conversation, clock),
        safeguards=None if reading is None else reading.known,
        unread=NOT_READ if reading is None else reading.problem or "",
        texts=tuple(conversation.texts),
    )


def probe_of(conversation: Conversation, configuration: Configuration, survey: SurveyArea) -> Probe:
    """What a conversation has told of the instrument, its readings judged as the service will; but for the place."""
    named = {
        name: Named(each.count, each.rate_hz, frozenset(each.systems), frozenset(each.components))
        for name, each in conversation.named.items()
    }
    sensor = configuration.sensor
    quality = QualityControl[Observation](
        configuration.quality, (sensor.minimum, sensor.maximum), Waters(survey.ground, Polygon(), _ANYWHERE_M)
    )
    for each in conversation.observations:
        x_m, y_m = survey.frame.to_local(each.lat_deg, each.lon_deg).tolist()
        quality.add(Reading(each.model_time_s, x_m, y_m, each.value), each)
    quality.flush()
    values = tuple(each.value for each in conversation.observations)
    return Probe(named, values, quality.counts, dict(conversation.telemetry.dropped))


def _version(message: Any | None) -> tuple[int, int, int, bool] | None:
    if message is None:
        return None
    major, minor, patch, kind = int(message.flight_sw_version).to_bytes(4, "big")
    return major, minor, patch, kind == _OFFICIAL


def _prearm(conversation: Conversation) -> bool | None:
    _, message = conversation.newest.get("SYS_STATUS", (0.0, None))
    if message is None or not message.onboard_control_sensors_enabled & _PREARM:
        return None
    return bool(message.onboard_control_sensors_health & _PREARM)


def _fix(conversation: Conversation) -> Fix | None:
    _, message = conversation.newest.get("GPS_RAW_INT", (0.0, None))
    if message is None:
        return None
    satellites, eph = message.satellites_visible, message.eph
    return Fix(
        message.fix_type,
        None if satellites == _UNKNOWN_UINT8 else satellites,
        None if eph == _UNKNOWN_UINT16 else eph / 100.0,
    )


def _utc_ahead_s(conversation: Conversation, clock: tuple[float, float]) -> float | None:
    heard_s, message = conversation.newest.get("SYSTEM_TIME", (math.nan, None))
    if message is None or conversation.telemetry.utc_offset_s is None:
        return None
    now, utc_s = clock
    return float(message.time_unix_usec) / 1e6 - (utc_s + heard_s - now)
