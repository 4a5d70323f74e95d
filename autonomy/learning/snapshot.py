"""FieldModel <-> versioned bytes, the same for the disk and for the shore.

CBOR with typed arrays (RFC 8746, little-endian), compressed with zstd, which also carries a checksum:

    {"schema": "halocline/field-model", "version": 2,
     "components": [{"variance": number, "space": name, "lengthscales_m": [number per axis],
                     "time": name, "timescale_s": number, infinite for what is static}, …],
     "noise_variance", "prior_mean", "jitter": numbers,
     "transform": {"name": name, its numbers},
     "basis": float64 (m·d), row by row,
     "mean": float32 (n), n = m × groups: the components that move alike are one group (see `kernel`),
     "gain": float32 (n(n + 1)/2), the lower triangle of I − S, row by row,
     "metadata": {name: text, number or truth value}}

The state travels whitened by the Cholesky factors that both ends compute from the basis: its entries are
bounded by one, so float32 costs less than a millionth of σf. (alpha and C are sums of huge, cancelling numbers; they
would not survive it.) The basis travels exactly, because the factors depend on it far more sharply than the
map does.

What travels is the nowcast: of a group whose state has a rate of change only the field itself. The model that
is read predicts the same now, but, `advanced`, it knows no rates.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import cbor2
import numpy as np
import zstandard
from scipy.linalg import solve_triangular

from autonomy import plain_cbor
from autonomy.learning.basis import prior_factors
from autonomy.learning.field_model import FieldModel, field_coordinates
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.numbers import FloatArray
from autonomy.learning.spatial import SPATIAL
from autonomy.learning.temporal import TEMPORAL, Static, TemporalKernel
from autonomy.learning.transform import TRANSFORMS, Transform

SCHEMA = "halocline/field-model"
VERSION = 2
# A thousand coordinates take 2 MB; anything beyond this is not a model.
MAXIMUM_BYTES = 16 * 1024 * 1024
MAXIMUM_STATES = 2000
_MAXIMUM_ITEMS = 10_000
_MAXIMUM_DEPTH = 8
_MAXIMUM_COMPONENTS = 8
_MAXIMUM_DIMENSIONS = 8
# How far eigenvalues of I − S may leave [0, 1]: rounding takes a hundredth of it.
_SLACK = 1e-3
# Beyond these nothing is measured, and squares begin to overflow: metres, and whatever the variable is measured in.
_PLACES_M = 1e9
_SCALES_M = (1e-3, 1e12)
_VALUES = 1e30

_FLOAT32_LE, _FLOAT64_LE = 85, 86
_DTYPES: dict[int, np.dtype[Any]] = {_FLOAT32_LE: np.dtype("<f4"), _FLOAT64_LE: np.dtype("<f8")}

Scalar = str | int | float | bool


class SnapshotError(ValueError):
    """The bytes are not a snapshot, or a damaged one; the message says what is wrong, and where."""


@dataclass(frozen=True)
class Snapshot:
    """A model and what its sender noted beside it."""

    model: FieldModel
    metadata: Mapping[str, Scalar]


def encode(model: FieldModel, metadata: Mapping[str, Scalar] | None = None) -> bytes:
    """The nowcast as bytes, about 20 kB for a hundred basis vectors and one group; `metadata` goes with it.

    ValueError for metadata of other types, and for a model too large to be read.
    """
    notes = dict(metadata or {})
    for name, value in notes.items():
        if not isinstance(name, str) or not isinstance(value, str | int | float | bool):
            raise ValueError(f"metadata[{name!r}] must be text, a number or a truth value, not {value!r}")
    size = len(model) * model.kernel.states
    if size > MAXIMUM_STATES:
        raise ValueError(f"a snapshot holds at most {MAXIMUM_STATES} coordinates of the state, not {size}")
    mean, gain = _whitened(model)
    document = {
        "schema": SCHEMA,
        "version": VERSION,
        "components": [_component_map(component) for component in model.kernel.components],
        "noise_variance": model.kernel.noise_variance,
        "prior_mean": model.prior_mean,
        "jitter": model.jitter,
        "transform": {"name": model.transform.name, **asdict(model.transform)},
        "basis": _typed(model.basis.ravel(), _FLOAT64_LE),
        "mean": _typed(mean, _FLOAT32_LE),
        "gain": _typed(gain[np.tril_indices(len(mean))], _FLOAT32_LE),
        "metadata": notes,
    }
    return zstandard.ZstdCompressor(level=3, write_checksum=True).compress(cbor2.dumps(document))


def decode(data: bytes) -> FieldModel:
    """The model in `data`. Raises SnapshotError for anything else."""
    return read(data).model


def read(data: bytes) -> Snapshot:
    """The model in `data` and the metadata sent with it. Raises SnapshotError for anything else."""
    document = _unpack(data)
    schema, version = document.get("schema"), document.get("version")
    if schema != SCHEMA:
        raise SnapshotError(f"schema: {schema!r:.60} is not {SCHEMA!r}")
    if version != VERSION:
        raise SnapshotError(
            f"version: {version!r:.60} is not {VERSION}, which this program reads: "
            "the programs that write and read must be of the same version; update the older"
        )
    return Snapshot(_model(document), _metadata(document.get("metadata")))


def _whitened(model: FieldModel) -> tuple[FloatArray, FloatArray]:
    """μ and I − S of the field, with respect to the factors that the other end will compute from the basis."""
    m, field = len(model), field_coordinates(model.kernel, len(model))
    mean = model.whitened_mean[field]
    gain = np.eye(len(field)) - model.whitened_covariance[np.ix_(field, field)]
    if m:
        for g, fresh in enumerate(prior_factors(model.basis, model.kernel, model.jitter)):
            block = slice(g * m, (g + 1) * m)
            change = solve_triangular(fresh, model.factors[g], lower=True)
            mean[block] = change @ mean[block]
            gain[block] = change @ gain[block]
            gain[:, block] = gain[:, block] @ change.T
    return mean, gain


def _component_map(component: Component) -> dict[str, Any]:
    return {
        "variance": component.variance,
        "space": component.space.name,
        "lengthscales_m": list(component.space.lengthscales_m),
        "time": component.time.name,
        "timescale_s": component.time.timescale_s,
    }


def _typed(values: FloatArray, tag: int) -> cbor2.CBORTag:
    return cbor2.CBORTag(tag, values.astype(_DTYPES[tag]).tobytes())


def _unpack(data: bytes) -> dict[str, Any]:
    if len(data) > MAXIMUM_BYTES:
        raise SnapshotError(f"compressed frame: {len(data)} bytes exceed the limit of {MAXIMUM_BYTES}")
    try:
        size = zstandard.frame_content_size(data)
        # The size written in a frame overrides max_output_size, so a bomb has to be told by it first.
        if size > MAXIMUM_BYTES:
            raise SnapshotError(f"compressed frame: it claims {size} bytes; the limit is {MAXIMUM_BYTES}")
        plain = zstandard.ZstdDecompressor(max_window_size=MAXIMUM_BYTES).decompress(
            data, max_output_size=MAXIMUM_BYTES, allow_extra_data=False
        )
    except zstandard.ZstdError as error:
        raise SnapshotError(f"compressed frame: {error}") from error
    try:
        document = plain_cbor.load(
            plain, maximum_bytes=MAXIMUM_BYTES, maximum_items=_MAXIMUM_ITEMS, maximum_depth=_MAXIMUM_DEPTH
        )
    except plain_cbor.CBORError as error:
        raise SnapshotError(f"CBOR: {error}") from error
    if not isinstance(document, dict):
        raise SnapshotError(f"CBOR: a map was expected, not {type(document).__name__}")
    return document


def _model(document: dict[str, Any]) -> FieldModel:
    kernel, transform = _kernel(document), _transform(document.get("transform"))
    jitter, prior_mean = _number(document, "jitter"), _number(document, "prior_mean")
    if not 0 < jitter <= 1e-2:
        raise SnapshotError(f"jitter: {jitter!r} is not in (0, 0.01]")
    if not abs(prior_mean) <= _VALUES:
        raise SnapshotError(f"prior_mean: {prior_mean!r} is not within ±{_VALUES:g}")
    coordinates = _array(document, "basis", _FLOAT64_LE)
    m, rest = divmod(len(coordinates), kernel.dimensions)
    if rest or m * kernel.states > MAXIMUM_STATES:
        raise SnapshotError(
            f"basis: {len(coordinates)} numbers are not places of {kernel.dimensions} axes "
            f"within the limit of {MAXIMUM_STATES // kernel.states} places"
        )
    if m and np.abs(coordinates).max() > _PLACES_M:
        raise SnapshotError(f"basis: it reaches farther than {_PLACES_M:g} m")
    basis = coordinates.reshape(m, kernel.dimensions)
    mean, covariance = _state(document, kernel, m)
    try:
        factors = prior_factors(basis, kernel, jitter)
    except np.linalg.LinAlgError as error:
        raise SnapshotError(f"basis: its covariance is singular ({error})") from error
    return FieldModel(kernel, prior_mean, jitter, basis, factors, mean, covariance, transform)


def _state(document: dict[str, Any], kernel: Kernel, m: int) -> tuple[FloatArray, FloatArray]:
    """μ (D,) and S (D, D), the rates of change as the prior has them."""
    field = field_coordinates(kernel, m)
    n, size = len(field), m * kernel.states
    mean, covariance = np.zeros(size), np.eye(size)
    mean[field] = _array(document, "mean", _FLOAT32_LE, n)
    gain = np.zeros((n, n))
    gain[np.tril_indices(n)] = _array(document, "gain", _FLOAT32_LE, n * (n + 1) // 2)
    gain += np.tril(gain, -1).T
    try:
        for positive in (gain, np.eye(n) - gain):
            np.linalg.cholesky(positive + _SLACK * np.eye(n))
    except np.linalg.LinAlgError as error:
        raise SnapshotError("gain: it leaves the range that a covariance allows") from error
    covariance[np.ix_(field, field)] -= gain
    return mean, covariance


def _kernel(document: dict[str, Any]) -> Kernel:
    items = document.get("components")
    if not isinstance(items, list) or not 1 <= len(items) <= _MAXIMUM_COMPONENTS:
        raise SnapshotError(f"components: a list of 1 to {_MAXIMUM_COMPONENTS} maps was expected")
    components = []
    for i, item in enumerate(items):
        try:
            components.append(_component(item))
        except (ValueError, OverflowError) as error:
            raise SnapshotError(f"components[{i}]: {error}") from error
    noise = _bounded(document, "noise_variance")
    try:
        return Kernel(tuple(components), noise)
    except ValueError as error:
        raise SnapshotError(f"kernel: {error}") from error


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
    return Component(_bounded(item, "variance"), space, _time(item))


def _time(item: dict[str, Any]) -> TemporalKernel:
    kind, timescale_s = TEMPORAL[_name(item, "time", TEMPORAL)], _number(item, "timescale_s")
    if not issubclass(kind, Static):
        return kind(timescale_s)
    if timescale_s != math.inf:
        raise SnapshotError(f"timescale_s: {timescale_s!r}, but what is static has an infinite one")
    return Static()


def _transform(item: object) -> Transform:
    if not isinstance(item, dict):
        raise SnapshotError(f"transform: a map was expected, not {item!r:.60}")
    try:
        kind = TRANSFORMS[_name(item, "name", TRANSFORMS)]
        return kind(**{field.name: _number(item, field.name) for field in fields(kind)})
    except ValueError as error:
        raise SnapshotError(f"transform: {error}") from error


def _name(item: dict[str, Any], key: str, known: Mapping[str, object]) -> str:
    value = item.get(key)
    if not isinstance(value, str) or value not in known:
        raise SnapshotError(f"{key}: {value!r:.60} is none of {', '.join(known)}")
    return value


def _number(document: dict[str, Any], name: str) -> float:
    value = document.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SnapshotError(f"{name}: a number was expected, not {value!r:.60}")
    try:
        return float(value)
    except OverflowError as error:
        raise SnapshotError(f"{name}: {error}") from error


def _bounded(document: dict[str, Any], name: str) -> float:
    """A variance; whether it is positive is for the kernel to say."""
    value = _number(document, name)
    if not abs(value) <= _VALUES:
        raise SnapshotError(f"{name}: {value!r} is more than {_VALUES:g}")
    return value


def _array(document: dict[str, Any], name: str, tag: int, length: int | None = None) -> FloatArray:
    value = document.get(name)
    if not isinstance(value, cbor2.CBORTag) or value.tag != tag or not isinstance(value.value, bytes):
        raise SnapshotError(f"{name}: a typed array (tag {tag}) was expected")
    dtype = _DTYPES[tag]
    count, rest = divmod(len(value.value), dtype.itemsize)
    if rest or (length is not None and count != length):
        wanted = "whole numbers" if length is None else f"{length} numbers"
        raise SnapshotError(f"{name}: {len(value.value)} bytes are not {wanted} of {dtype.itemsize} bytes")
    array = np.frombuffer(value.value, dtype=dtype)
    if not np.isfinite(array).all():
        raise SnapshotError(f"{name}[{int(np.argmin(np.isfinite(array)))}]: not finite")
    return array.astype(np.float64)


def _metadata(value: object) -> Mapping[str, Scalar]:
    if not isinstance(value, dict):
        raise SnapshotError("metadata: a map was expected")
    for name, entry in value.items():
        if not isinstance(name, str) or not isinstance(entry, str | int | float | bool):
            raise SnapshotError(
                f"metadata: {name!r:.60}: {entry!r:.60} is not text, a number or a truth value"
            )
    return value
