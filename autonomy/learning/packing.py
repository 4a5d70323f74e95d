"""Whole numbers <-> few bytes. Everything here reads bytes from anybody.

`pack_fixed` gives every number the same width. `pack` is for numbers of very different size, most of them small: the
bit lengths (0 to 15) are Huffman-coded by zlib, two to a byte; sign and what follows the leading one go as they are.
That is within some percent of the entropy for anything that falls off smoothly (exponential-Golomb codes, Teuhola 1978,
with a code for the lengths that is made to measure).
"""

import zlib

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

LARGEST = 2**15 - 1
"""The largest magnitude that `pack` takes."""
WIDEST = 32


class PackingError(ValueError):
    """The bytes are not so many packed numbers; says why."""


def width_of(numbers: Integers) -> int:
    """The least width for `pack_fixed`; 0 if all are 0."""
    return int(np.abs(numbers).max(initial=0)).bit_length() + 1 if numbers.any() else 0


def pack_fixed(numbers: Integers, width: int) -> bytes:
    """`numbers` (n,) in `width` bits each, at most 32, two's complement. ValueError for one that does not fit."""
    if not 0 <= width <= WIDEST or width_of(numbers) > width:
        raise ValueError(f"numbers of {width_of(numbers)} bits do not fit {width} of at most {WIDEST}")
    return _spill(numbers & ((1 << width) - 1), np.full(len(numbers), width))


def unpack_fixed(data: bytes, width: int, count: int) -> Integers:
    """The `count` numbers in `data`. Raises PackingError if there are not exactly so many of `width` bits."""
    if not 0 <= width <= WIDEST:
        raise PackingError(f"a width of {width} bits is not from 0 to {WIDEST}")
    codes = _gather(data, np.full(count, width))
    return np.where(codes >> max(width - 1, 0), codes - (1 << width), codes) if width else codes


def pack(numbers: Integers) -> tuple[bytes, bytes]:
    """`numbers` (n,): their lengths, compressed, and their bits. ValueError for magnitudes above `LARGEST`."""
    size = np.abs(numbers)
    if size.max(initial=0) > LARGEST:
        raise ValueError(f"{int(size.max())} is more than {LARGEST}")
    lengths = np.frexp(size.astype(np.float64))[1].astype(np.int64)
    leading = np.where(size > 0, 1 << np.maximum(lengths - 1, 0), 0)
    # Where the leading one was, which everybody knows to be one, is room for the sign.
    bits = _spill(size - leading + np.where(numbers < 0, leading, 0), lengths)
    pairs = np.append(lengths, 0)[: len(lengths) + len(lengths) % 2].reshape(-1, 2).astype(np.uint8)
    coder = zlib.compressobj(9, zlib.DEFLATED, -15, 9, zlib.Z_HUFFMAN_ONLY)
    return coder.compress((pairs[:, 0] << 4 | pairs[:, 1]).tobytes()) + coder.flush(), bits


def unpack(lengths: bytes, bits: bytes, count: int) -> Integers:
    """The `count` numbers. Raises PackingError if the two parts are not of exactly so many."""
    pairs = np.frombuffer(_inflated(lengths, (count + 1) // 2), dtype=np.uint8)
    sizes = np.stack([pairs >> 4, pairs & 15], axis=-1).ravel()[:count].astype(np.int64)
    codes = _gather(bits, sizes)
    leading = np.where(sizes > 0, 1 << np.maximum(sizes - 1, 0), 0)
    return np.where(codes & leading, -codes, codes + leading)


def _inflated(data: bytes, size: int) -> bytes:
    """Exactly `size` bytes; never more memory than that."""
    decoder = zlib.decompressobj(-15)
    try:
        plain = decoder.decompress(data, size + 1)
    except zlib.error as error:
        raise PackingError(f"lengths: {error}") from None
    if len(plain) != size or not decoder.eof or decoder.unused_data:
        raise PackingError(f"lengths: these are not of {size} pairs of numbers")
    return plain


def _spill(codes: Integers, lengths: Integers) -> bytes:
    """The last `lengths` bits of each code, one after the other, the highest first."""
    ends = np.cumsum(lengths)
    bits = np.zeros(int(lengths.sum()), dtype=np.uint8)
    for place in range(int(lengths.max(initial=0))):
        has = lengths > place
        bits[ends[has] - 1 - place] = codes[has] >> place & 1
    return np.packbits(bits).tobytes()


def _gather(data: bytes, lengths: Integers) -> Integers:
    total = int(lengths.sum())
    if len(data) != (total + 7) // 8:
        raise PackingError(f"bits: {len(data)} bytes are not {total} bits")
    bits = np.unpackbits(np.frombuffer(data, dtype=np.uint8), count=total)
    ends = np.cumsum(lengths)
    codes = np.zeros(len(lengths), dtype=np.int64)
    for place in range(int(lengths.max(initial=0))):
        has = lengths > place
        codes[has] |= bits[ends[has] - 1 - place].astype(np.int64) << place
    return codes
