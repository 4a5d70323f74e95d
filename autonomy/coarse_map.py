"""A map in some hundred bytes: the low frequencies of its cosine transform.

Its mean is a float32, for it may be a thousand times its range. The other coefficients (DCT-II, orthonormal) come in
bands of equal frequency over ground, all rounded to one step, each band Rice-coded with a parameter of its own (Rice &
Plaunt 1971). The step is as fine as the room allows: so the bits go where the map has its variance, and the error is
the same in all frequencies that are kept.
"""

import math
import struct
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import dctn

from autonomy.geometry import FloatArray
from autonomy.learning.packing import Integers

LARGEST_SIDE = 128
"""Rows and columns of a map that is taken in: far more than any band tells."""
_BANDS = 20
_SILENT = 15
# Steps are powers of 2^(1/4): 255 of them from 2^-40 to 2^24.
_STEPS_PER_OCTAVE, _LOWEST_OCTAVE = 4, -40
_HEAD = struct.Struct("<4Bf")
# A longer unary part means a step that is finer than numbers of 14 bits need; so it gets bits that fit no room.
_LONGEST = 32
_TOO_MANY = 8192


class CoarseMapError(ValueError):
    """The bytes are no map; says why."""


@dataclass(frozen=True, eq=False)
class CoarseMap:
    """Cosine coefficients (rows, columns) of a map; those that were not sent are 0."""

    coefficients: FloatArray

    @classmethod
    def of(cls, values: ArrayLike) -> "CoarseMap":
        """Of the map `values` (rows, columns), at most 128 each. ValueError for another shape, or if not all finite."""
        array = np.asarray(values, dtype=np.float64)
        if array.ndim != 2 or not 1 <= min(array.shape) <= max(array.shape) <= LARGEST_SIDE:
            raise ValueError(f"a map has two axes of 1 to {LARGEST_SIDE} cells, not {array.shape}")
        if not np.isfinite(array).all():
            raise ValueError("a map must be finite everywhere, land too")
        return cls(dctn(array, norm="ortho"))

    def at(self, rows: int, columns: int) -> FloatArray:
        """The map (rows, columns) at the centres of so many cells, whatever it was made of."""
        north, east = (
            _cosines(count, cells)
            for count, cells in zip(self.coefficients.shape, (rows, columns), strict=True)
        )
        result: FloatArray = north @ self.coefficients @ east.T
        return result

    @cached_property
    def _bands(self) -> list[FloatArray]:
        return [self.coefficients[band] for band in _bands(*self.coefficients.shape)]

    @property
    def _mean(self) -> float:
        return float(self.coefficients[0, 0]) / math.sqrt(self.coefficients.size)

    def encoded(self, room: int) -> bytes:
        """At most `room` bytes. ValueError if even the coarsest step does not fit: for values beyond 1e9 or so."""
        lowest, highest = 0, 255
        # The finest step that fits: a finer one takes more.
        while lowest < highest:
            middle = (lowest + highest) // 2
            fits = len(self._with_step(middle)) <= room
            lowest, highest = (lowest, middle) if fits else (middle + 1, highest)
        data = self._with_step(lowest)
        if len(data) > room:
            raise ValueError(f"the map does not fit {room} bytes")
        return data

    def _with_step(self, number: int) -> bytes:
        step = _step(number)
        bands = [np.rint((band / step).clip(-(2.0**40), 2.0**40)).astype(np.int64) for band in self._bands]
        while bands and not bands[-1].any():
            bands.pop()
        parameters, bits = [], []
        for band in bands:
            parameter, code = _rice(band)
            parameters.append(parameter)
            bits.append(code)
        heads = np.array(parameters + [0] * (len(parameters) % 2), dtype=np.uint8).reshape(-1, 2)
        body = np.packbits(np.concatenate([np.zeros(0, np.uint8), *bits])).tobytes()
        rows, columns = self.coefficients.shape
        head = _HEAD.pack(rows, columns, number, len(bands), self._mean)
        return head + (heads[:, 0] << 4 | heads[:, 1]).tobytes() + body


def decoded(data: bytes) -> CoarseMap:
    """The map in `data`. Raises CoarseMapError for anything else."""
    if len(data) < _HEAD.size:
        raise CoarseMapError(f"{len(data)} bytes are no map")
    rows, columns, number, count, mean = _HEAD.unpack_from(data)
    if not math.isfinite(mean):
        raise CoarseMapError(f"its mean is {mean}")
    if not 1 <= min(rows, columns) <= max(rows, columns) <= LARGEST_SIDE or count > _BANDS:
        raise CoarseMapError(f"there is no map of {rows} × {columns} cells and {count} bands")
    heads = data[_HEAD.size : _HEAD.size + (count + 1) // 2]
    if len(heads) < (count + 1) // 2:
        raise CoarseMapError("it ends before its bands do")
    parameters = [nibble for byte in heads for nibble in (byte >> 4, byte & 15)][:count]
    bits = np.unpackbits(np.frombuffer(data[_HEAD.size + len(heads) :], dtype=np.uint8)).tolist()
    coefficients, position = np.zeros((rows, columns)), 0
    coefficients[0, 0] = mean * (rows * columns) ** 0.5
    for parameter, band in zip(parameters, _bands(rows, columns), strict=False):
        values, position = _unriced(bits, position, parameter, len(band[0]))
        coefficients[band] = np.array(values, dtype=np.float64) * _step(number)
    if len(bits) - position >= 8:
        raise CoarseMapError("it goes on after its last band")
    return CoarseMap(coefficients)


def _step(number: int) -> float:
    return float(2.0 ** (number / _STEPS_PER_OCTAVE + _LOWEST_OCTAVE))


def _cosines(count: int, cells: int) -> FloatArray:
    """The first `count` cosines of the orthonormal DCT at the centres of `cells` cells: (cells, count)."""
    k, centre = np.arange(count), (np.arange(cells) + 0.5) / cells
    scale = np.where(k == 0, 1.0, 2.0**0.5) / count**0.5
    return np.asarray(scale * np.cos(np.pi * np.outer(centre, k)))


@lru_cache(maxsize=8)
def _bands(rows: int, columns: int) -> tuple[tuple[Integers, Integers], ...]:
    """Row and column numbers of the coefficients, band after band, by frequency over ground if cells are square.

    Whole numbers only: both ends must agree. Band b holds 2b + 3 coefficients; the mean is in none.
    """
    north, east = (axis.ravel() for axis in np.indices((rows, columns)))
    order = np.lexsort((east, north, (north * columns) ** 2 + (east * rows) ** 2))
    ends = [min((b + 2) ** 2, rows * columns) for b in range(_BANDS)]
    return tuple(
        (north[order[start:end]], east[order[start:end]])
        for start, end in zip([1, *ends], ends, strict=False)
    )


def _rice(values: Integers) -> tuple[int, Integers]:
    """The best parameter and the bits: unary quotient, remainder, of 2|v| − (v < 0)."""
    if not values.any():
        return _SILENT, np.zeros(0, dtype=np.uint8)
    folded = np.where(values < 0, -2 * values - 1, 2 * values)
    parameter = min(range(_SILENT), key=lambda p: int((folded >> p).sum()) + p * len(folded))
    if int(folded.max()) >> parameter > _LONGEST:
        return parameter, np.ones(_TOO_MANY, dtype=np.uint8)
    bits: list[int] = []
    for value in folded.tolist():
        bits += [1] * (value >> parameter) + [0]
        bits += [value >> place & 1 for place in reversed(range(parameter))]
    return parameter, np.array(bits, dtype=np.uint8)


def _unriced(bits: list[int], position: int, parameter: int, count: int) -> tuple[list[int], int]:
    """So many values, and where the next band begins. Raises CoarseMapError."""
    if parameter == _SILENT:
        return [0] * count, position
    values = []
    for _ in range(count):
        quotient = 0
        while position < len(bits) and bits[position]:
            quotient, position = quotient + 1, position + 1
        if position + 1 + parameter > len(bits):
            raise CoarseMapError("it ends before its bands do")
        folded = quotient
        for bit in bits[position + 1 : position + 1 + parameter]:
            folded = folded << 1 | bit
        position += 1 + parameter
        values.append(-(folded + 1 >> 1) if folded & 1 else folded >> 1)
    return values, position
