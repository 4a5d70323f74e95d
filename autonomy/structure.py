"""Values of this project as plain CBOR and back, without pickle: numbers bit for bit, arrays with their layout.

Anything may be written, for a digest; only the classes named in `READABLE` are made again from bytes. A class is
written as what it would be pickled as (dataclasses: their fields), so what follows from the rest is left out.
"""

import dataclasses
import hashlib
import math
import re
from collections.abc import Mapping
from enum import Enum
from typing import Any, Literal, get_args

import cbor2
import numpy as np

from autonomy import jobs, plain_cbor
from autonomy.events import Event
from autonomy.learning.choice import Choice
from autonomy.learning.fitting import Fit
from autonomy.learning.kernel import Component, Group, Kernel
from autonomy.learning.members import Members
from autonomy.learning.rebuild import Reestimate
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import SPATIAL
from autonomy.learning.state import WhitenedState
from autonomy.learning.temporal import TEMPORAL
from autonomy.planning.plan import Plan

MAXIMUM_BYTES = 32 * 2**20
_MAXIMUM_ITEMS = 200_000
_DEPTH = 40

# CBOR tags of our own, from the range that anybody may use.
# Of these an enumeration's member is only ever written.
_TUPLE, _ARRAY, _SCALAR, _OBJECT, _MAP, _ENUM = range(70_000, 70_006)
_KINDS = frozenset("biuf")
_DTYPE = re.compile(r"[<>|=]?[biuf]\d{1,2}")

READABLE: dict[str, type] = {
    each.__name__: each
    for each in (
        *get_args(Event),
        jobs.ExploreResult,
        Reestimate,
        Choice,
        Fit,
        Kernel,
        Component,
        Group,
        *SPATIAL.values(),
        *TEMPORAL.values(),
        SparseOnlineGP,
        WhitenedState,
        Members,
        Plan,
    )
}


class StructureError(ValueError):
    """Bytes that are not a value of this project; says why."""


def encode(value: Any) -> bytes:
    """The CBOR form of a value.

    Raises:
        TypeError: something in it has no form here.
    """
    return cbor2.dumps(_tree(value))


def decode(data: bytes) -> Any:
    """The value in bytes that `encode` made; they may also come from anybody.

    Raises:
        StructureError: they are not such a value, or one of a class that is not in `READABLE`.
    """
    return _value(load_plain(data))


@dataclasses.dataclass(frozen=True)
class Fingerprint:
    """What tells a value from others.

    Attributes:
        exact: digest of all of it, 8 bytes.
        outline: digest of all but its numbers, on which computers agree even where these differ a little.
        numbers: the numbers; of an array its sum and the sum of its magnitudes.
    """

    exact: bytes
    outline: bytes = dataclasses.field(compare=False)
    # Compared they would differ where one is NaN.
    numbers: tuple[float, ...] = dataclasses.field(compare=False)


def fingerprint(value: Any) -> Fingerprint:
    """What tells a value from others. TypeError as `encode`."""
    numbers: list[float] = []
    tree = _tree(value)
    skeleton = _skeleton(tree, numbers)
    return Fingerprint(_digest(tree), _digest(skeleton), tuple(numbers))


def deviation(a: Any, b: Any) -> float:
    """The largest difference of two values' numbers, each relative to the larger of the two magnitudes.

    Of an array, relative to its largest entry. Infinite if they differ in more than numbers. TypeError as `encode`.
    """
    return _deviation(_tree(a), _tree(b))


def _digest(tree: Any) -> bytes:
    return hashlib.blake2b(cbor2.dumps(tree), digest_size=8).digest()


def _deviation(a: Any, b: Any) -> float:
    if isinstance(a, cbor2.CBORTag) and isinstance(b, cbor2.CBORTag) and a.tag == b.tag:
        if a.tag in (_ARRAY, _SCALAR):
            return _apart(_value(a), _value(b))
        return _deviation(a.value, b.value)
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        return max(map(_deviation, a, b), default=0.0)
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        return max((_deviation(a[name], b[name]) for name in a), default=0.0)
    if isinstance(a, float) and isinstance(b, float):
        return _apart(a, b)
    return 0.0 if type(a) is type(b) and a == b else math.inf


def _apart(a: Any, b: Any) -> float:
    if np.shape(a) != np.shape(b):
        return math.inf
    if np.array_equal(a, b, equal_nan=np.asarray(a).dtype.kind == "f"):
        return 0.0
    difference = float(np.max(np.abs(np.subtract(a, b, dtype=float))))
    scale = max(float(np.max(np.abs(a))), float(np.max(np.abs(b))))
    return difference / scale if math.isfinite(difference) and scale > 0.0 else math.inf


def load_plain(data: bytes) -> Any:
    """CBOR of bounded size and depth, its tags left as they are.

    Raises:
        StructureError: it is anything else, or has a tag that stands for an object of CBOR's own.
    """
    try:
        return plain_cbor.load(
            data, maximum_bytes=MAXIMUM_BYTES, maximum_items=_MAXIMUM_ITEMS, maximum_depth=_DEPTH
        )
    except plain_cbor.CBORError as error:
        raise StructureError(str(error)) from None


def _tree(value: Any) -> Any:
    """What CBOR can hold of a value."""
    if isinstance(value, np.generic):
        return cbor2.CBORTag(_SCALAR, [value.dtype.str, value.tobytes()])
    if isinstance(value, Enum):
        return cbor2.CBORTag(_ENUM, [type(value).__name__, value.name])
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return value
    if isinstance(value, list):
        return [_tree(each) for each in value]
    if isinstance(value, tuple):
        return cbor2.CBORTag(_TUPLE, [_tree(each) for each in value])
    if isinstance(value, np.ndarray):
        return _array_tree(value)
    if isinstance(value, Mapping):
        return cbor2.CBORTag(_MAP, [[_tree(key), _tree(each)] for key, each in value.items()])
    if isinstance(value, bytearray | memoryview):
        return bytes(value)
    return _object_tree(value)


def _array_tree(array: np.ndarray[Any, Any]) -> cbor2.CBORTag:
    if array.dtype.kind not in _KINDS:
        raise TypeError(f"an array of {array.dtype} has no form here")
    # Sums depend on the order of their terms: what is stored by columns stays so.
    order: Literal["C", "F"] = "F" if array.flags.f_contiguous and not array.flags.c_contiguous else "C"
    return cbor2.CBORTag(_ARRAY, [array.dtype.str, list(array.shape), order, array.tobytes(order)])


def _object_tree(value: Any) -> cbor2.CBORTag:
    kind = type(value)
    if kind.__module__.partition(".")[0] != "autonomy":
        raise TypeError(f"a {kind.__qualname__} has no form here")
    if "__getstate__" in vars(kind):
        state = value.__getstate__()
    elif dataclasses.is_dataclass(kind):
        state = {field.name: getattr(value, field.name) for field in dataclasses.fields(kind)}
    else:
        state = vars(value)
    return cbor2.CBORTag(_OBJECT, [kind.__name__, {name: _tree(each) for name, each in state.items()}])


def _skeleton(tree: Any, numbers: list[float]) -> Any:
    if isinstance(tree, float):
        numbers.append(tree)
        return 0.0
    if isinstance(tree, list):
        return [_skeleton(each, numbers) for each in tree]
    if isinstance(tree, dict):
        return {name: _skeleton(each, numbers) for name, each in tree.items()}
    if not isinstance(tree, cbor2.CBORTag):
        return tree
    if tree.tag == _SCALAR:
        numbers.append(float(_value(tree)))
        return tree.value[0]
    if tree.tag == _ARRAY and np.dtype(tree.value[0]).kind == "f":
        array = _value(tree)
        numbers += [float(array.sum()), float(np.abs(array).sum())]
        return tree.value[:2]
    return cbor2.CBORTag(tree.tag, _skeleton(tree.value, numbers))


def _value(tree: Any) -> Any:
    """The value of a tree as CBOR gave it back. Raises StructureError."""
    if isinstance(tree, list | tuple):  # what hangs below a tag comes as tuples
        return [_value(each) for each in tree]
    if not isinstance(tree, cbor2.CBORTag):
        if tree is None or isinstance(tree, bool | int | float | str | bytes):
            return tree
        raise StructureError(f"a bare {type(tree).__name__} has no place here")
    try:
        return _VALUES[tree.tag](tree.value)
    except StructureError:
        raise
    except KeyError:
        raise StructureError(f"unknown tag {tree.tag}") from None
    except (TypeError, ValueError, AttributeError, OverflowError, MemoryError) as error:
        raise StructureError(f"not what its tag {tree.tag} promises: {error}") from None


def _dtype(name: Any) -> np.dtype[Any]:
    # Of anything else NumPy makes sense in its own way, or Python's: it parses what looks like a list of types.
    if not isinstance(name, str) or not _DTYPE.fullmatch(name):
        raise StructureError("no type of numbers")
    return np.dtype(name)


def _array(content: Any) -> np.ndarray[Any, Any]:
    name, shape, order, data = content
    dtype = _dtype(name)
    if not all(isinstance(side, int) and side >= 0 for side in shape) or order not in ("C", "F"):
        raise StructureError("an array of no shape")
    if not isinstance(data, bytes) or math.prod(shape) * dtype.itemsize != len(data):
        raise StructureError(f"{len(data)} bytes do not fill an array of shape {shape}")
    return np.frombuffer(data, dtype).reshape(shape, order=order).copy(order=order)


def _scalar(content: Any) -> Any:
    name, data = content
    return np.frombuffer(data, _dtype(name), count=1)[0]


def _map(content: Any) -> dict[Any, Any]:
    return {_value(key): _value(each) for key, each in content}


def _object(content: Any) -> Any:
    name, fields = content
    kind = READABLE.get(name)
    if kind is None:
        raise StructureError(f"the class {str(name)[:40]!r} is not one that is read")
    state = {field: _value(each) for field, each in fields.items()}
    if dataclasses.is_dataclass(kind):
        return kind(**state)
    made: Any = object.__new__(kind)
    restore = getattr(made, "__setstate__", None)
    if restore is None:
        vars(made).update(state)
    else:
        restore(state)
    return made


_VALUES = {
    _TUPLE: lambda content: tuple(_value(each) for each in content),
    _ARRAY: _array,
    _SCALAR: _scalar,
    _OBJECT: _object,
    _MAP: _map,
}
