"""FieldModel <-> versioned bytes, the same for the disk and for the shore.

CBOR with typed arrays (RFC 8746, little-endian), compressed with zstd, which also carries a checksum:

    {"schema": "halocline/field-model", "version": 1,
     "signal_variance", "noise_variance", "lengthscales_m", "timescale_s", "prior_mean", "jitter": numbers,
     "basis": float64 (m·d), row by row,
     "mean": float32 (m),
     "gain": float32 (m(m + 1)/2), the lower triangle of I − S, row by row,
     "metadata": {name: text, number or truth value}}

The state travels whitened by the Cholesky factor that both ends compute from the basis: its entries are
bounded by one, so float32 costs a millionth of σf. (alpha and C are sums of huge, cancelling numbers; they
would not survive it.) The basis travels exactly, because the factor depends on it far more sharply than the
map does.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cbor2
import numpy as np
import zstandard
from scipy.linalg import solve_triangular

from autonomy.learning.basis import prior_factors
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import FloatArray, Hyperparameters

SCHEMA = "halocline/field-model"
VERSION = 1
# A thousand basis vectors take 2 MB; anything beyond this is not a model.
MAXIMUM_BYTES = 16 * 1024 * 1024
MAXIMUM_BASIS = 2000
_MAXIMUM_DIMENSIONS = 8

_FLOAT32_LE, _FLOAT64_LE = 85, 86
_DTYPES: dict[int, np.dtype[Any]] = {_FLOAT32_LE: np.dtype("<f4"), _FLOAT64_LE: np.dtype("<f8")}
_NUMBERS = ("signal_variance", "noise_variance", "timescale_s", "prior_mean", "jitter")

Scalar = str | int | float | bool


class SnapshotError(ValueError):
    """The bytes are not a snapshot, or a damaged one; the message says what is wrong, and where."""


@dataclass(frozen=True)
class Snapshot:
    """A model and what its sender noted beside it."""

    model: FieldModel
    metadata: Mapping[str, Scalar]


def encode(model: FieldModel, metadata: Mapping[str, Scalar] | None = None) -> bytes:
    """The model as bytes: about 20 kB for a hundred basis vectors; `metadata` goes with it."""
    notes = dict(metadata or {})
    for name, value in notes.items():
        if not isinstance(name, str) or not isinstance(value, str | int | float | bool):
            raise ValueError(f"metadata[{name!r}] must be text, a number or a truth value, not {value!r}")
    m, h = len(model), model.kernel.hyperparameters
    if m > MAXIMUM_BASIS:
        raise ValueError(f"a snapshot holds at most {MAXIMUM_BASIS} basis vectors, not {m}")
    mean, gain = _whitened(model)
    document = {
        "schema": SCHEMA,
        "version": VERSION,
        "signal_variance": h.signal_variance,
        "noise_variance": h.noise_variance,
        "lengthscales_m": list(h.lengthscales_m),
        "timescale_s": h.timescale_s,
        "prior_mean": model.prior_mean,
        "jitter": model.jitter,
        "basis": _typed(model.basis.ravel(), _FLOAT64_LE),
        "mean": _typed(mean, _FLOAT32_LE),
        "gain": _typed(gain[np.tril_indices(m)], _FLOAT32_LE),
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
        raise SnapshotError(f"version: {version!r:.60} is unknown to this program, which reads {VERSION}")
    return Snapshot(_model(document), _metadata(document.get("metadata")))


def _whitened(model: FieldModel) -> tuple[FloatArray, FloatArray]:
    """μ and I − S, with respect to the factor that the other end will compute from the basis."""
    m = len(model)
    if m == 0:
        return np.zeros(0), np.zeros((0, 0))
    (fresh,) = prior_factors(model.basis, model.kernel, model.jitter)
    change = solve_triangular(fresh, model.factors[0], lower=True)
    gain = change @ (np.eye(m) - model.whitened_covariance) @ change.T
    return change @ model.whitened_mean, gain


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
        document = cbor2.loads(plain)
    except (cbor2.CBORDecodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise SnapshotError(f"CBOR: {error}") from error
    if not isinstance(document, dict):
        raise SnapshotError(f"CBOR: a map was expected, not {type(document).__name__}")
    return document


def _model(document: dict[str, Any]) -> FieldModel:
    h = _hyperparameters(document)
    jitter, prior_mean = _number(document, "jitter"), _number(document, "prior_mean")
    if not 0 < jitter <= 1e-2:
        raise SnapshotError(f"jitter: {jitter!r} is not in (0, 0.01]")
    if not math.isfinite(prior_mean):
        raise SnapshotError(f"prior_mean: {prior_mean!r} is not finite")
    mean = _array(document, "mean", _FLOAT32_LE)
    m = len(mean)
    if m > MAXIMUM_BASIS:
        raise SnapshotError(f"mean: {m} basis vectors exceed the limit of {MAXIMUM_BASIS}")
    basis = _array(document, "basis", _FLOAT64_LE, m * h.dimensions).reshape(m, h.dimensions)
    triangle = _array(document, "gain", _FLOAT32_LE, m * (m + 1) // 2)
    if m == 0:
        return FieldModel.prior(h, prior_mean, jitter)
    gain = np.zeros((m, m))
    gain[np.tril_indices(m)] = triangle
    gain += np.tril(gain, -1).T
    if float(np.abs(gain).max()) > 1.001 or float(np.diagonal(gain).min()) < -0.001:
        raise SnapshotError("gain: its entries leave the range that a covariance allows")
    try:
        factors = prior_factors(basis, h.kernel, jitter)
    except np.linalg.LinAlgError as error:
        raise SnapshotError(f"basis: its covariance is singular ({error})") from error
    return FieldModel(h.kernel, prior_mean, jitter, basis, factors, mean, np.eye(m) - gain)


def _hyperparameters(document: dict[str, Any]) -> Hyperparameters:
    scales = document.get("lengthscales_m")
    if not isinstance(scales, list) or not 1 <= len(scales) <= _MAXIMUM_DIMENSIONS:
        raise SnapshotError(f"lengthscales_m: a list of 1 to {_MAXIMUM_DIMENSIONS} numbers was expected")
    for value in scales:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SnapshotError(f"lengthscales_m: {value!r:.60} is not a number")
    signal, noise, timescale = (_number(document, name) for name in _NUMBERS[:3])
    try:
        return Hyperparameters(signal, noise, tuple(scales), timescale)
    except (ValueError, OverflowError) as error:
        raise SnapshotError(f"hyperparameters: {error}") from error


def _number(document: dict[str, Any], name: str) -> float:
    value = document.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise SnapshotError(f"{name}: a number was expected, not {value!r:.60}")
    try:
        return float(value)
    except OverflowError as error:
        raise SnapshotError(f"{name}: {error}") from error


def _array(document: dict[str, Any], name: str, tag: int, length: int | None = None) -> FloatArray:
    value = document.get(name)
    if not isinstance(value, cbor2.CBORTag) or value.tag != tag or not isinstance(value.value, bytes):
        raise SnapshotError(f"{name}: a typed array (tag {tag}) was expected")
    dtype = _DTYPES[tag]
    count, rest = divmod(len(value.value), dtype.itemsize)
    if rest or (length is not None and count != length):
        wanted = "whole numbers" if length is None else f"{length} numbers"
        raise SnapshotError(f"{name}: {len(value.value)} bytes are not {wanted} of {dtype.itemsize} bytes")
    array: FloatArray = np.frombuffer(value.value, dtype=dtype).astype(np.float64)
    if not np.isfinite(array).all():
        raise SnapshotError(f"{name}[{int(np.argmin(np.isfinite(array)))}]: not finite")
    return array


def _metadata(value: object) -> Mapping[str, Scalar]:
    if not isinstance(value, dict):
        raise SnapshotError("metadata: a map was expected")
    for name, entry in value.items():
        if not isinstance(name, str) or not isinstance(entry, str | int | float | bool):
            raise SnapshotError(
                f"metadata: {name!r:.60}: {entry!r:.60} is not text, a number or a truth value"
            )
    return value
