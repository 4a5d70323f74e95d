"""All that matters in one short-burst message of a satellite modem: at most 340 bytes; see docs/snapshots.md.

Little-endian. Numbers that aren't known have a value of their own:

    version 1 byte, then the fixed part (`_FIXED`): flags, UTC, latitude and longitude, heading, speed, state,
    battery, range left, distance, samples, basis, ρ, plans
    vehicle, mode, units: length and UTF-8 each
    kernel: number of components; of each a byte for its kinds, variance, length-scales and time-scale as logarithms;
    then noise variance and prior mean
    plan: number of corners; the first as a position, the others as steps from it
    bounds of the map, mean standard deviation, the map (`coarse_map`): only if there is a model
    CRC-32 of all before it
"""

import math
import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from autonomy.coarse_map import CoarseMap, decoded
from autonomy.digest_parts import (
    MAXIMUM_CORNERS,
    DigestError,
    Reader,
    checked_bounds,
    counted,
    kernel_bytes,
    kernel_from,
    known,
    logarithm,
    place_from,
    place_numbers,
    power,
    route_bytes,
    route_from,
)
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Kernel

__all__ = [
    "MAXIMUM_BYTES",
    "MAXIMUM_CORNERS",
    "STATES",
    "Digest",
    "DigestError",
    "charted",
    "decode",
    "encode",
    "thinned_route",
]

MAXIMUM_BYTES = 340
VERSION = 1
STATES = ("waiting for vehicle", "exploring", "yielded", "returning", "finished", "observing", "paused")
"""What the service may be doing, as `autonomy.situation.State` says it, in the order of their numbers here."""

_TEXTS = (("vehicle", 16), ("mode", 10), ("units", 10))
_OTHER_STATE = 255
_FIXED = struct.Struct("<BIiiBBBBHIIHBH")
_BOUNDS = struct.Struct("<4fH")
_CELLS = 1024


@dataclass(frozen=True, eq=False)
class Digest:
    """What fits. None stands for what isn't known.

    Attributes:
        vehicle: its name, the first 16 bytes of it.
        utc_s: when this was so, whole seconds since 1970.
        lat_deg: latitude of the vehicle.
        lon_deg: longitude of the vehicle.
        heading_deg: to 1.4°.
        groundspeed_mps: to 0.1 m/s.
        state: what the service is doing: one of `STATES`, or "".
        mode: the autopilot's mode by name.
        armed: whether the vehicle is.
        link_ok: whether the autopilot is heard.
        fault: whether health has anything to complain of; what, it says on another link.
        battery: share of its charge that is left, to 1 %.
        range_m: how far the vessel can still sail, to 100 m.
        distance_m: what has been sailed.
        samples: readings learnt so far.
        basis_size: basis vectors of the model.
        rho: share of them that is new since the last re-estimate.
        plans: made so far.
        units: of the variable.
        kernel: what the field is believed to be like, its four strongest components, numbers to 0.1 %.
        prior_mean: of the field; in the units of the model's transform, as is `kernel`.
        route_deg: latitude, longitude of the next corners of the plan, thinned: see `thinned_route`.
        bounds_deg: south, west, north, east of the map.
        mean_sd: root of the mean variance over the map, in `units`.
        coarse: the mean over the map, in `units`; row 0 in the south. Only its low frequencies.
    """

    vehicle: str
    utc_s: int | None = None
    lat_deg: float | None = None
    lon_deg: float | None = None
    heading_deg: float | None = None
    groundspeed_mps: float | None = None
    state: str = ""
    mode: str = ""
    armed: bool = False
    link_ok: bool = False
    fault: bool = False
    battery: float | None = None
    range_m: float | None = None
    distance_m: float = 0.0
    samples: int = 0
    basis_size: int = 0
    rho: float | None = None
    plans: int = 0
    units: str = ""
    kernel: Kernel | None = None
    prior_mean: float = 0.0
    route_deg: tuple[tuple[float, float], ...] = ()
    bounds_deg: tuple[float, float, float, float] | None = None
    mean_sd: float | None = None
    coarse: CoarseMap | None = field(default=None, repr=False)

    def map(self, rows: int, columns: int) -> FloatArray:
        """The mean (rows, columns) at the centres of so many cells over `bounds_deg`, row 0 in the south.

        ValueError if the vehicle had no model yet.
        """
        if self.coarse is None:
            raise ValueError("this digest has no map: the vehicle had no model yet")
        return self.coarse.at(rows, columns)


def charted(
    model: FieldModel, frame: LocalFrame, bounds_deg: tuple[float, float, float, float]
) -> tuple[CoarseMap, float]:
    """`coarse` and `mean_sd` of a digest: the model's map over the box, on some thousand square cells."""
    south, west, north, east = bounds_deg
    aspect = (east - west) * math.cos(math.radians(0.5 * (south + north))) / (north - south)
    rows, columns = (
        int(np.clip(round(math.sqrt(_CELLS * share)), 8, 128)) for share in (1.0 / aspect, aspect)
    )
    lat = south + (north - south) * (np.arange(rows) + 0.5) / rows
    lon = west + (east - west) * (np.arange(columns) + 0.5) / columns
    lons, lats = np.meshgrid(lon, lat)
    prediction = model.predict(frame.to_local(lats.ravel(), lons.ravel()))
    sd = math.sqrt(max(float(prediction.variance.mean()), 0.0))
    return CoarseMap.of(prediction.mean.reshape(rows, columns)), sd


def thinned_route(route_deg: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """At most `MAXIMUM_CORNERS` of a route: the first four, and of the rest evenly spaced ones, the last among them."""
    if len(route_deg) <= MAXIMUM_CORNERS:
        return tuple(route_deg)
    near = MAXIMUM_CORNERS // 2
    far = np.linspace(near, len(route_deg) - 1, MAXIMUM_CORNERS - near).round().astype(int)
    return (*route_deg[:near], *(route_deg[i] for i in far))


def encode(digest: Digest) -> bytes:
    """At most 340 bytes; the map gets the room that the rest leaves.

    What is too large for its place is cut. DigestError for what has no bytes at all: positions that are none, NaN, a
    prior mean or a map beyond float32.
    """
    try:
        body = _written(digest)
    except DigestError:
        raise
    except (ValueError, OverflowError, struct.error) as error:
        raise DigestError(f"there is no digest of this: {error}") from error
    return body + struct.pack("<I", zlib.crc32(body))


def decode(data: bytes) -> Digest:
    """The digest in `data`, which may come from anybody. Raises DigestError for anything else."""
    if not 5 <= len(data) <= MAXIMUM_BYTES:
        raise DigestError(f"{len(data)} bytes are no digest, which has at most {MAXIMUM_BYTES}")
    if zlib.crc32(data[:-4]) != int.from_bytes(data[-4:], "little"):
        raise DigestError("damaged: its checksum is not of these bytes")
    if data[0] != VERSION:
        raise DigestError(f"version {data[0]} is not {VERSION}: the program on board is newer or older")
    try:
        return _read(data[:-4])
    except (IndexError, ValueError) as error:
        raise DigestError(f"not a digest: {error}") from None


def _written(digest: Digest) -> bytes:
    """All but the checksum."""
    head = bytes([VERSION]) + _fixed(digest)
    for name, most in _TEXTS:
        text = getattr(digest, name).encode()[:most].decode(errors="ignore").encode()
        head += bytes([len(text)]) + text
    head += kernel_bytes(digest.kernel, digest.prior_mean) + route_bytes(thinned_route(digest.route_deg))
    if digest.coarse is not None and digest.bounds_deg is not None:
        head += _BOUNDS.pack(*checked_bounds(*digest.bounds_deg), logarithm(digest.mean_sd))
        head += digest.coarse.encoded(MAXIMUM_BYTES - 4 - len(head))
    return head


def _fixed(digest: Digest) -> bytes:
    flags = (digest.armed, digest.link_ok, digest.fault)
    turn = None if digest.heading_deg is None else digest.heading_deg % 360.0 / 360.0
    return _FIXED.pack(
        sum(flag << number for number, flag in enumerate(flags)),
        counted(digest.utc_s, 32),
        *place_numbers(digest.lat_deg, digest.lon_deg),
        counted(turn, 8, 255),
        counted(digest.groundspeed_mps, 8, 10),
        STATES.index(digest.state) if digest.state in STATES else _OTHER_STATE,
        counted(digest.battery, 8, 100),
        counted(digest.range_m, 16, 0.01),
        counted(digest.distance_m, 32),
        counted(digest.samples, 32),
        counted(digest.basis_size, 16),
        counted(digest.rho, 8, 200),
        counted(digest.plans, 16),
    )


def _read(data: bytes) -> Digest:
    reader = Reader(data, 1)
    flags, utc, lat, lon, turn, speed, state, battery, reach, *rest = reader.unpack(_FIXED)
    distance, samples, basis, rho, plans = rest
    texts = {name: reader.text(most) for name, most in _TEXTS}
    kernel, prior_mean = kernel_from(reader)
    route = route_from(reader)
    bounds, mean_sd, coarse = None, None, None
    if reader.left:
        *bounds_deg, sd = reader.unpack(_BOUNDS)
        bounds, mean_sd = checked_bounds(*bounds_deg), power(sd)
        coarse = decoded(reader.take(reader.left))
    place = place_from(lat, lon)
    return Digest(
        **texts,
        utc_s=None if utc == 2**32 - 1 else utc,
        lat_deg=None if place is None else place[0],
        lon_deg=None if place is None else place[1],
        heading_deg=known(turn, 8, 255 / 360.0),
        groundspeed_mps=known(speed, 8, 10),
        state="" if state == _OTHER_STATE else STATES[state],
        armed=bool(flags & 1),
        link_ok=bool(flags & 2),
        fault=bool(flags & 4),
        battery=known(battery, 8, 100),
        range_m=known(reach, 16, 0.01),
        distance_m=float(distance),
        samples=samples,
        basis_size=basis,
        rho=known(rho, 8, 200),
        plans=plans,
        kernel=kernel,
        prior_mean=prior_mean,
        route_deg=route,
        bounds_deg=bounds,
        mean_sd=mean_sd,
        coarse=coarse,
    )
