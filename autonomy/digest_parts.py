"""What a digest is made of, each part as a few bytes and back.

What reads may get bytes from anybody: it raises DigestError, or another ValueError, or IndexError for a kind of kernel
that there isn't.
"""

import math
import struct
from collections.abc import Sequence
from typing import Any

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import SPATIAL
from autonomy.learning.temporal import TEMPORAL, Static

MAXIMUM_CORNERS = 8
"""Of the plan."""
SPACES = ("squared_exponential", "matern32")
TIMES = ("static", "ornstein_uhlenbeck", "matern32_motion")
"""Names of the kernels in the order of their numbers here: new ones go to the end."""

_MAXIMUM_COMPONENTS = 4
_DEGREE = 10_000_000
_NOWHERE = -(2**31)
_LARGEST_FLOAT32 = (2.0 - 2.0**-23) * 2.0**127
# Logarithms to base 2 in steps of 1/512 from 2^-64 to 2^64.
_LOG_STEPS, _LOG_OFFSET = 512, 64


class DigestError(ValueError):
    """The bytes are no digest, or a damaged one, or there is no digest of these values; says what is wrong."""


def kernel_bytes(kernel: Kernel | None, prior_mean: float) -> bytes:
    """The strongest components, of two axes. DigestError for a prior mean beyond float32, or none."""
    if kernel is None:
        return b"\0"
    if not abs(prior_mean) <= _LARGEST_FLOAT32:
        raise DigestError(f"a prior mean of {prior_mean:g} is no number of 4 bytes")
    strongest = sorted(kernel.components, key=lambda one: -one.variance)[:_MAXIMUM_COMPONENTS]
    kept = [component for component in kernel.components if component in strongest][:_MAXIMUM_COMPONENTS]
    data = bytes([len(kept)])
    for one in kept:
        numbers = (one.variance, *one.space.lengthscales_m, one.time.timescale_s)
        data += bytes([SPACES.index(one.space.name) << 4 | TIMES.index(one.time.name)])
        data += struct.pack("<4H", *map(logarithm, numbers))
    return data + struct.pack("<Hf", logarithm(kernel.noise_variance), prior_mean)


def kernel_from(reader: "Reader") -> tuple[Kernel | None, float]:
    """Kernel and prior mean; None and 0 if there was no model."""
    count = reader.byte()
    if not count:
        return None, 0.0
    if count > _MAXIMUM_COMPONENTS:
        raise DigestError(f"{count} components are too many")
    components = []
    for _ in range(count):
        kinds = reader.byte()
        variance, *scales, timescale = map(power, reader.unpack(struct.Struct("<4H")))
        time = TEMPORAL[TIMES[kinds & 15]]
        components.append(
            Component(
                _number(variance),
                SPATIAL[SPACES[kinds >> 4]](tuple(map(_number, scales))),
                Static() if issubclass(time, Static) else time(_number(timescale)),
            )
        )
    noise, prior_mean = reader.unpack(struct.Struct("<Hf"))
    return Kernel(tuple(components), _number(power(noise))), _finite(prior_mean)


def route_bytes(route_deg: Sequence[tuple[float, float]]) -> bytes:
    """The first corner, the length of a step in degrees, and how many steps the others are from the first."""
    data = bytes([len(route_deg)])
    if not route_deg:
        return data
    first = route_deg[0]
    offsets = [(lat - first[0], _wrapped(lon - first[1])) for lat, lon in route_deg[1:]]
    step = max((abs(value) for offset in offsets for value in offset), default=0.0) / 32767.0
    data += struct.pack("<iif", *place_numbers(*first), step)
    # What is written of the step is rounded.
    (step,) = struct.unpack("<f", data[-4:])
    steps = [
        0 if not step else min(max(round(value / step), -32767), 32767) for each in offsets for value in each
    ]
    return data + struct.pack(f"<{len(steps)}h", *steps)


def _rounded(lat_deg: float, step_deg: float) -> float:
    """A pole may come out beyond itself, by what the step is rounded."""
    return min(max(lat_deg, -90.0), 90.0) if abs(lat_deg) <= 90.0 + step_deg else lat_deg


def route_from(reader: "Reader") -> tuple[tuple[float, float], ...]:
    """The corners, latitude and longitude."""
    count = reader.byte()
    if not count:
        return ()
    if count > MAXIMUM_CORNERS:
        raise DigestError(f"{count} corners are too many")
    lat, lon, step = reader.unpack(struct.Struct("<iif"))
    first = place_from(lat, lon)
    if first is None or not 0.0 <= step <= 1.0:
        raise DigestError("a plan that is nowhere")
    steps = reader.unpack(struct.Struct(f"<{2 * count - 2}h"))
    others = [
        (_rounded(first[0] + step * north, step), _wrapped(first[1] + step * east))
        for north, east in zip(steps[::2], steps[1::2], strict=True)
    ]
    if not all(abs(each[0]) <= 90.001 for each in others):
        raise DigestError("a plan beyond the pole")
    return (first, *((max(-90.0, min(90.0, north)), east) for north, east in others))


def checked_bounds(south: float, west: float, north: float, east: float) -> tuple[float, float, float, float]:
    """The same, if they bound something; DigestError if not."""
    sane = all(map(math.isfinite, (south, west, north, east)))
    if not (sane and -90.0 <= south < north <= 90.0 and -360.0 <= west < east <= 540.0):
        raise DigestError(f"a map from {south:g}, {west:g} to {north:g}, {east:g} degrees")
    return south, west, north, east


def place_numbers(lat_deg: float | None, lon_deg: float | None) -> tuple[int, int]:
    """In units of 1e-7 degrees. ValueError for what is no position."""
    if lat_deg is None or lon_deg is None:
        return _NOWHERE, _NOWHERE
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 360.0):
        raise ValueError(f"latitude {lat_deg!r}, longitude {lon_deg!r} is no position")
    return round(lat_deg * _DEGREE), round(_wrapped(lon_deg) * _DEGREE)


def place_from(lat: int, lon: int) -> tuple[float, float] | None:
    """Latitude and longitude in degrees; None for one that was not known."""
    if lat == _NOWHERE:
        return None
    if abs(lat) > 90 * _DEGREE or abs(lon) > 180 * _DEGREE:
        raise DigestError(f"{lat / _DEGREE}, {lon / _DEGREE} is no position")
    return lat / _DEGREE, lon / _DEGREE


def _wrapped(lon_deg: float) -> float:
    """Between −180 and 180."""
    return (lon_deg + 180.0) % 360.0 - 180.0


def counted(value: float | None, bits: int, per_unit: float = 1.0) -> int:
    """A number that is not negative, in so many bits; all of them set: not known. ValueError for NaN."""
    unknown: int = 2**bits - 1
    return unknown if value is None else round(min(max(value * per_unit, 0.0), unknown - 1.0))


def known(number: int, bits: int, per_unit: float) -> float | None:
    """What `counted` was given; None if that was not known."""
    return None if number == 2**bits - 1 else number / per_unit


def logarithm(value: float | None) -> int:
    """Of a positive number, in 16 bits; 0 for one that is not known, or infinite."""
    if value is None or value <= 0.0 or math.isinf(value):
        return 0
    return min(max(round((math.log2(value) + _LOG_OFFSET) * _LOG_STEPS), 1), 2**16 - 1)


def power(number: int) -> float | None:
    """What `logarithm` was given, to 0.07 %."""
    return None if not number else 2.0 ** (number / _LOG_STEPS - _LOG_OFFSET)


def _number(value: float | None) -> float:
    if value is None:
        raise DigestError("a number of the kernel is missing")
    return value


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise DigestError(f"{value} is no prior mean")
    return value


class Reader:
    """Walks through bytes; DigestError where they end."""

    def __init__(self, data: bytes, position: int) -> None:
        self._data, self._position = data, position

    @property
    def left(self) -> int:
        """Bytes that have not been read."""
        return len(self._data) - self._position

    def take(self, count: int) -> bytes:
        """The next `count` bytes."""
        if count > self.left:
            raise DigestError(f"it ends {count - self.left} bytes early")
        self._position += count
        return self._data[self._position - count : self._position]

    def byte(self) -> int:
        """The next byte."""
        return self.take(1)[0]

    def unpack(self, layout: struct.Struct) -> tuple[Any, ...]:
        """The next bytes as numbers."""
        return layout.unpack(self.take(layout.size))

    def text(self, most: int) -> str:
        """A text of at most so many bytes."""
        size = self.byte()
        if size > most:
            raise DigestError(f"a text of {size} bytes, where {most} fit")
        return self.take(size).decode()
