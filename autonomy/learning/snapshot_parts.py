"""What a snapshot is made of, each part as plain CBOR values and back: numbers, arrays, kernel, transform, integers.

What is read may come from anybody: everything here that reads raises SnapshotError, and nothing else.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

import cbor2
import numpy as np

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.numbers import FloatArray
from autonomy.learning.packing import PackingError, pack_fixed, unpack_fixed, width_of
from autonomy.learning.positions import coarsest_step_m
from autonomy.learning.spatial import SPATIAL
from autonomy.learning.temporal import TEMPORAL, Static, TemporalKernel
from autonomy.learning.transform import TRANSFORMS, Transform

_MAXIMUM_COMPONENTS = 8
_MAXIMUM_DIMENSIONS = 8
# Beyond these nothing is measured, and squares begin to overflow: metres, and whatever the variable is measured in.
_PLACES_M = 1e9
_SCALES_M = (1e-3, 1e12)
_VALUES = 1e30
_FLOAT64_LE = 86
_FLOAT64 = np.dtype("<f8")
# Steps of a grid from its corner: more would not be told apart from a float64.
_MOST_STEPS = 2**31

Document = dict[str, Any]


class SnapshotError(ValueError):
    """The bytes are not a snapshot, or a damaged one; the message says what is wrong, and where."""


# Numbers and arrays -----------------------------------------------------------------------------------------------


def number(document: Document, name: str) -> float:
    """The number of that name as a float; infinite or NaN only if it was that."""
    value = document.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SnapshotError(f"{name}: a number was expected, not {value!r:.60}")
    try:
        return float(value)
    except OverflowError as error:
        raise SnapshotError(f"{name}: {error}") from error


def bounded(document: Document, name: str, limit: float = _VALUES) -> float:
    """The number of that name, from −limit to limit."""
    value = number(document, name)
    if not abs(value) <= limit:
        raise SnapshotError(f"{name}: {value!r} is not within ±{limit:g}")
    return value


def list_of(document: Document, name: str, kinds: tuple[type, ...]) -> list[Any]:
    """The list of that name if its entries are of these `kinds`, one after the other."""
    value = document.get(name)
    if not isinstance(value, list) or tuple(map(type, value)) != kinds:
        wanted = ", ".join(kind.__name__ for kind in kinds)
        raise SnapshotError(f"{name}: a list of {wanted} was expected, not {value!r:.60}")
    return value


def typed(values: FloatArray) -> cbor2.CBORTag:
    """`values` (n,) as a typed array of RFC 8746."""
    return cbor2.CBORTag(_FLOAT64_LE, values.astype(_FLOAT64).tobytes())


def array(value: object, name: str, length: int | None = None) -> FloatArray:
    """The finite numbers of a typed array, (length,) if that is given."""
    if not isinstance(value, cbor2.CBORTag) or value.tag != _FLOAT64_LE or not isinstance(value.value, bytes):
        raise SnapshotError(f"{name}: a typed array (tag {_FLOAT64_LE}) was expected")
    count, rest = divmod(len(value.value), _FLOAT64.itemsize)
    if rest or (length is not None and count != length):
        wanted = "whole numbers" if length is None else f"{length} numbers"
        raise SnapshotError(f"{name}: {len(value.value)} bytes are not {wanted} of {_FLOAT64.itemsize} bytes")
    numbers = np.frombuffer(value.value, dtype=_FLOAT64).astype(np.float64)
    sane = np.abs(numbers) <= _VALUES
    if not sane.all():
        raise SnapshotError(f"{name}[{int(np.argmin(sane))}]: not finite, or beyond ±{_VALUES:g}")
    return numbers


def triangle(matrix: FloatArray) -> cbor2.CBORTag:
    """The lower triangle of `matrix` (n, n), row by row."""
    return typed(matrix[np.tril_indices(len(matrix))])


def from_triangle(value: object, name: str, size: int) -> FloatArray:
    """The matrix (size, size) with that lower triangle, and zeros above it."""
    matrix = np.zeros((size, size))
    matrix[np.tril_indices(size)] = array(value, name, size * (size + 1) // 2)
    return matrix


# Places -----------------------------------------------------------------------------------------------------------


def basis_parts(basis: FloatArray) -> Any:
    """Places (m, d), exactly: `[step_m, [corner, …], width, bytes]`, whole steps from a corner, if they are on a grid.

    Typed numbers otherwise.
    """
    step = coarsest_step_m(basis)
    if step is not None and len(basis):
        steps = np.rint(basis / step)
        corner = np.floor(0.5 * (steps.min(axis=0) + steps.max(axis=0)))
        if np.abs(steps - corner).max() < _MOST_STEPS and np.abs(corner).max() < 2.0**53:
            offsets = (steps - corner).astype(np.int64).ravel()
            # What is left of the last byte must be less than a place, or it would be read as one more.
            width = max(width_of(offsets), -(-8 // basis.shape[1]))
            return [step, [int(c) for c in corner], width, pack_fixed(offsets, width)]
    return typed(basis.ravel())


def basis_from(document: Document, dimensions: int, most: int) -> FloatArray:
    """The places (m, dimensions), m at most `most`."""
    value = document.get("basis")
    places = (_on_grid(document, dimensions) if isinstance(value, list) else array(value, "basis")).ravel()
    m, rest = divmod(len(places), dimensions)
    if rest or m > most:
        raise SnapshotError(
            f"basis: {len(places)} numbers are not places of {dimensions} axes within the limit of {most} places"
        )
    if m and np.abs(places).max() > _PLACES_M:
        raise SnapshotError(f"basis: it reaches farther than {_PLACES_M:g} m")
    return places.reshape(m, dimensions)


def _on_grid(document: Document, dimensions: int) -> FloatArray:
    step, corner, width, data = list_of(document, "basis", (float, list, int, bytes))
    if not 2.0**-30 <= step <= _PLACES_M:
        raise SnapshotError(f"basis: a grid of {step!r} m is no grid")
    if len(corner) != dimensions or not all(type(c) is int and abs(c) < 2**53 for c in corner):
        raise SnapshotError(f"basis: {corner!r:.60} is not a corner of {dimensions} whole numbers")
    count = len(data) * 8 // width if width > 0 else dimensions
    count -= count % dimensions
    try:
        offsets = unpack_fixed(data, width, count)
    except PackingError as error:
        raise SnapshotError(f"basis: {error}") from None
    places: FloatArray = (offsets.reshape(-1, dimensions) + np.array(corner)) * float(step)
    return places


# Kernel and transform -----------------------------------------------------------------------------------------------


def component_map(component: Component) -> Document:
    """A component as names and numbers."""
    return {
        "variance": component.variance,
        "space": component.space.name,
        "lengthscales_m": list(component.space.lengthscales_m),
        "time": component.time.name,
        "timescale_s": component.time.timescale_s,
    }


def kernel_from(document: Document) -> Kernel:
    """The kernel of `components` and `noise_variance`."""
    items = document.get("components")
    if not isinstance(items, list) or not 1 <= len(items) <= _MAXIMUM_COMPONENTS:
        raise SnapshotError(f"components: a list of 1 to {_MAXIMUM_COMPONENTS} maps was expected")
    components = []
    for i, item in enumerate(items):
        try:
            components.append(_component(item))
        except (ValueError, OverflowError) as error:
            raise SnapshotError(f"components[{i}]: {error}") from error
    noise = bounded(document, "noise_variance")
    try:
        return Kernel(tuple(components), noise)
    except ValueError as error:
        raise SnapshotError(f"kernel: {error}") from error


def transform_map(transform: Transform) -> Document:
    """A transform as its name and numbers."""
    return {"name": transform.name, **asdict(transform)}


def transform_from(item: object) -> Transform:
    """The transform with that name and those numbers."""
    if not isinstance(item, dict):
        raise SnapshotError(f"transform: a map was expected, not {item!r:.60}")
    try:
        kind = TRANSFORMS[_name(item, "name", TRANSFORMS)]
        return kind(**{field.name: number(item, field.name) for field in fields(kind)})
    except ValueError as error:
        raise SnapshotError(f"transform: {error}") from error


def _component(item: object) -> Component:
    if not isinstance(item, dict):
        raise SnapshotError(f"a map was expected, not {item!r:.60}")
    scales = item.get("lengthscales_m")
    if not isinstance(scales, list) or not 1 <= len(scales) <= _MAXIMUM_DIMENSIONS:
        raise SnapshotError(f"lengthscales_m: a list of 1 to {_MAXIMUM_DIMENSIONS} numbers was expected")
    for value in scales:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SnapshotError(f"lengthscales_m: {value!r:.60} is not a number")
        if not _SCALES_M[0] <= value <= _SCALES_M[1]:
            raise SnapshotError(
                f"lengthscales_m: {value!r:.60} is not from {_SCALES_M[0]:g} to {_SCALES_M[1]:g} m"
            )
    space = SPATIAL[_name(item, "space", SPATIAL)](tuple(scales))
    return Component(bounded(item, "variance"), space, _time(item))


def _time(item: Document) -> TemporalKernel:
    kind, timescale_s = TEMPORAL[_name(item, "time", TEMPORAL)], number(item, "timescale_s")
    if not issubclass(kind, Static):
        return kind(timescale_s)
    if timescale_s != math.inf:
        raise SnapshotError(f"timescale_s: {timescale_s!r}, but what is static has an infinite one")
    return Static()


def _name(item: Document, key: str, known: Mapping[str, object]) -> str:
    value = item.get(key)
    if not isinstance(value, str) or value not in known:
        raise SnapshotError(f"{key}: {value!r:.60} is none of {', '.join(known)}")
    return value
