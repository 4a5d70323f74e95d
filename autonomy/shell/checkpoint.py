"""Checkpoints on disk: what the core knows, as bytes that tell whether they are whole, in two generations."""

from typing import Any

import cbor2
import numpy as np

from autonomy.memory import Memory


def _default(encoder: Any, value: Any) -> None:
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a {type(value).__name__} has no place in a checkpoint")
    order = "F" if value.flags.f_contiguous and not value.flags.c_contiguous else "C"
    encoder.encode(["array", value.dtype.str, order, list(value.shape), value.tobytes(order)])


def encode(memory: Memory) -> bytes:
    return cbor2.dumps(memory, default=_default)


def decode(data: bytes) -> Memory:
    return cbor2.loads(data)
