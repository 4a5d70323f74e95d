"""Every reader of bytes from outside, fed with damaged and hostile ones: it answers, or raises its own error.

HALOCLINE_FUZZ: how many inputs for each; without it a hundred. Then the costliest input is told, too, and must have
taken less than a second and all of them together less than 100 MB.
"""

import ctypes
import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from .decoders import DECODERS, Decoder

INPUTS = int(os.environ.get("HALOCLINE_FUZZ", "0"))
SEED = int(os.environ.get("HALOCLINE_SEED", "1"))
SHORT = 100
LARGEST_BYTES = 64 * 1024
MOST_SECONDS = 1.0
MOST_BYTES = 100 * 2**20
BATCH = 10_000
NUMBERS = [0, 1, -1, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**63, 2**64 - 1]


class Mutator:
    """Damages inputs at random, the same way every time."""

    def __init__(self, seed: int, seeds: Sequence[bytes], tokens: Sequence[bytes]) -> None:
        self._rng = np.random.default_rng(seed)
        self._seeds = seeds
        self._tokens = tokens

    def input(self) -> bytes:
        """Now and then mere noise, otherwise a sound input that a few things have been done to."""
        rng = self._rng
        if rng.random() < 0.05:
            return rng.bytes(int(rng.integers(0, 200)))
        data = bytearray(self._seeds[rng.integers(len(self._seeds))])
        for _ in range(int(rng.geometric(0.4))):
            self._mutate(data)
        return bytes(data[:LARGEST_BYTES])

    def chance(self) -> bool:
        return bool(self._rng.random() < 0.5)

    def _mutate(self, data: bytearray) -> None:
        rng = self._rng
        at, end = sorted(rng.integers(0, len(data) + 1, 2).tolist())
        match rng.integers(9):
            case 0 if data:
                data[at % len(data)] ^= 1 << int(rng.integers(8))
            case 1 if data:
                data[at % len(data)] = int(rng.integers(256))
            case 2:
                del data[at : min(end, at + int(rng.integers(1, 30)))]
            case 3:
                data[at:at] = rng.bytes(int(rng.integers(1, 12)))
            case 4 if self._tokens:
                token = self._tokens[rng.integers(len(self._tokens))]
                data[at : at + len(token) * int(rng.integers(2))] = token
            case 5:
                width = 1 << int(rng.integers(4))
                number = NUMBERS[rng.integers(len(NUMBERS))] % 256**width
                data[at : at + width] = number.to_bytes(width, "little" if rng.random() < 0.5 else "big")
            case 6:
                other = self._seeds[rng.integers(len(self._seeds))]
                begin, stop = sorted(rng.integers(0, len(other) + 1, 2).tolist())
                data[at:end] = other[begin:stop]
            case 7:
                del data[at:]
            case 8:
                piece = bytes(data[at : at + int(rng.integers(1, 40))])
                most = LARGEST_BYTES // (len(piece) + 1) if rng.random() < 0.1 else 20
                data[at:at] = piece * int(rng.integers(1, most + 2))


def feed(name: str, decoder: Decoder, inputs: int) -> tuple[float, bytes, int]:
    """Feed it; returns the CPU time that the costliest input took, that input, and the most memory, in bytes."""
    mutator = Mutator(SEED, decoder.seeds(), decoder.tokens)
    slowest, culprit, most = 0.0, b"", 0
    for number in range(inputs):
        if number % BATCH == 0:
            most = max(most, peak_bytes())
            forget_peak()
        data = mutator.input()
        if decoder.seal is not None and mutator.chance():
            data = decoder.seal(data)
        begun = time.process_time()
        try:
            decoder.read(data)
        except decoder.errors:
            pass
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            raise AssertionError(f"{name}, input {number} of seed {SEED}: {told}: {data[:2000]!r}") from error
        took = time.process_time() - begun
        if took > slowest:
            slowest, culprit = took, data
    return slowest, culprit, max(most, peak_bytes())


def peak_bytes() -> int:
    """The most memory that this process has had since `forget_peak`."""
    words = Path("/proc/self/status").read_text().split()
    return 1024 * int(words[words.index("VmHWM:") + 1])


def forget_peak() -> None:
    """Gives back what is free, too: the holes between small pieces grow over many inputs, and are no leak."""
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")


@pytest.mark.parametrize("name", DECODERS)
def test_sound_inputs_are_read(name: str) -> None:
    """Else what is damaged below would never get far."""
    decoder = DECODERS[name]
    for data in decoder.seeds():
        decoder.read(data if decoder.seal is None or name == "mavlink signed" else decoder.seal(data))


@pytest.mark.parametrize("name", DECODERS)
def test_anything_else_is_read_or_refused(name: str) -> None:
    decoder = DECODERS[name]
    feed(name, decoder, SHORT)
    if not INPUTS:
        return
    forget_peak()
    before = peak_bytes()
    slowest, culprit, most = feed(name, decoder, INPUTS)
    grown = most - before
    print(
        f"\n{name}: {INPUTS} inputs, slowest {1e3 * slowest:.0f} ms of {len(culprit)} bytes, {grown / 1e6:.0f} MB"
    )
    assert slowest < MOST_SECONDS, culprit[:2000]
    assert grown < MOST_BYTES
