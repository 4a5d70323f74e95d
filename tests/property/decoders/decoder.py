"""One reader of bytes from outside, and what several of them need."""

import functools
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zstandard

ROOT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Decoder:
    """One reader of bytes.

    Attributes:
        read: reads them.
        seeds: sound inputs; of sealed ones, what is inside.
        errors: what it may raise, for anything.
        tokens: what inputs are made of.
        seal: puts mutated content in a frame whose checksum agrees; None: there is none.
    """

    read: Callable[[bytes], Any]
    seeds: Callable[[], Sequence[bytes]]
    errors: tuple[type[Exception], ...] = ()
    tokens: Sequence[bytes] = ()
    seal: Callable[[bytes], bytes] | None = None


CBOR_TOKENS = [
    bytes([byte]) for byte in (0x00, 0x20, 0x40, 0x60, 0x80, 0xA0, 0xC0, 0xE0, 0xF4, 0xF6, 0xF7, 0x9F, 0xFF)
] + [
    *(b"\xd9" + tag.to_bytes(2, "big") for tag in (28, 35, 64, 85, 86, 258)),
    *(b"\xda" + tag.to_bytes(4, "big") for tag in range(70_000, 70_006)),
    *(b"\xc2", b"\xc4\x82\x3a\x7f\xff\xff\xff\x01", b"\xf9\x7e\x00", b"\xf9\x7c\x00", b"\x1b" + b"\xff" * 8),
    *(b"\x9a\x7f\xff\xff\xff", b"\x9b" + b"\xff" * 8, b"\xba\x7f\xff\xff\xff", b"\x5a\x7f\xff\xff\xff"),
    *(b"\x81" * 50, b"\x61a", b"\xfb\x7f\xf0" + bytes(6), b"\xfb" + b"\xff" * 8),
]


JSON_TOKENS = [
    *rb'[ ] { } , : " null true NaN Infinity -1e999 1e308 -0.0 \ud800 "type" "coordinates" "radius"'.split(),
    *(b'"Polygon"', b'"features"', b"9" * 5000, b"[" * 500, b"\xff"),
]

YAML_TOKENS = [
    *(bytes([byte]) for byte in b"-[]{},:#&*!|>'\"%@`\t\n\\? "),
    *rb'*a .nan 1e999 0x null "\UFFFFFFFF" survey: area'.split(),
    *(b"!!binary ", b"&a ", b"<<: ", b"---\n", b"? ", b"\r", b"%YAML 1.2\n"),
    *(b"[" * 40, b"9" * 5000, b"\xff", b"\xe2\x80\xa8"),
]


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


def unpacked(data: bytes) -> bytes:
    return zstandard.ZstdDecompressor().decompress(data)
