"""FieldModel <-> versioned bytes, the same for the disk and for the shore; see docs/snapshots.md.

CBOR, compressed with zstd, which also carries a checksum:

    {"schema": "halocline/field-model", "version": 3,
     "precision": "lossless", "16 bit", "12 bit" or "8 bit",
     "components": [{"variance": number, "space": name, "lengthscales_m": [number per axis],
                     "time": name, "timescale_s": number, infinite for what is static}, …],
     "noise_variance", "prior_mean", "jitter": numbers,
     "transform": {"name": name, its numbers},
     "basis": m places of d axes, exactly: see `snapshot_parts.basis_parts`,
     "metadata": {name: text, number or truth value}}

Lossless, D = m × the kernel's states, typed arrays (RFC 8746, float64, little-endian), triangles row by row:

     "factors": [lower triangle of L_g (m, m) for each group],
     "mean": μ (D), "covariance": lower triangle of S (D, D)

In so many bits: n = m × groups; what travels is the nowcast, of a group whose state has a rate of change only the
field itself. Both ends compute the factors from the basis, and the state is whitened by those: see `quantised`.

     "thinned": whether it is the marginal at inducing points: `components` all in one group then, see `inducing`
     "mean": [step, width, bytes], μ (n) in steps, so many bits each,
     "root": [lengths, bits], R (n(n + 1)/2) in steps of 2^(1 − its bits): see `packing`,
     "error": [of the mean, of the standard deviation], shares of σf: see `StatedError`
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import cbor2
import numpy as np
import zstandard

from autonomy import plain_cbor
from autonomy.learning.agreement import StatedError
from autonomy.learning.basis import prior_factors
from autonomy.learning.field_model import FieldModel
from autonomy.learning.inducing import standing, thinned
from autonomy.learning.kernel import Kernel
from autonomy.learning.quantised import Bits
from autonomy.learning.snapshot_parts import (
    Document,
    SnapshotError,
    basis_from,
    basis_parts,
    bounded,
    component_map,
    kernel_from,
    number,
    transform_from,
    transform_map,
)
from autonomy.learning.snapshot_state import (
    coarse_from,
    coarse_parts,
    lossless_from,
    lossless_parts,
    stated_from,
)

__all__ = [
    "MAXIMUM_BYTES",
    "MAXIMUM_STATES",
    "PRECISIONS",
    "Precision",
    "Snapshot",
    "SnapshotError",
    "StatedError",
    "decode",
    "encode",
    "read",
]

Precision = Literal["lossless", "16 bit", "12 bit", "8 bit"]
PRECISIONS: tuple[Precision, ...] = get_args(Precision)

SCHEMA = "halocline/field-model"
VERSION = 3
# The largest lossless model takes 12 MB; anything beyond this is not a model.
MAXIMUM_BYTES = 16 * 1024 * 1024
MAXIMUM_STATES = 1200
_MAXIMUM_ITEMS = 10_000
_MAXIMUM_DEPTH = 8
_BITS = {"16 bit": Bits(20, 14), "12 bit": Bits(16, 10), "8 bit": Bits(12, 7)}
Scalar = str | int | float | bool


@dataclass(frozen=True)
class Snapshot:
    """A model and what its sender says of it.

    Attributes:
        model: the posterior.
        metadata: what its sender noted beside it.
        precision: of the numbers.
        stated_error: how far the model is from the one on board.
        kernel: what is believed on board, which parts of the field move and how; the model's own stands still if
            it is one at inducing points.
    """

    model: FieldModel
    metadata: Mapping[str, Scalar]
    precision: Precision
    stated_error: StatedError
    kernel: Kernel


def encode(
    model: FieldModel,
    metadata: Mapping[str, Scalar] | None = None,
    precision: Precision = "lossless",
    inducing: int | None = None,
) -> bytes:
    """The belief as bytes, with `metadata` beside it.

    Args:
        model: what is believed.
        metadata: text, numbers and truth values by name.
        precision: "lossless" is all of `model`, to the last bit: 80 kB for 100 basis vectors. In so many bits
            it is the nowcast: some 5, 4 or 2 kB.
        inducing: the most places that the nowcast may be sent at; a model of more, or of several groups, goes as the
            marginal at so many. None: all of the basis, group by group. Not with "lossless".

    Raises:
        ValueError: metadata of other types, an unknown precision, or a model too large to be read.
    """
    notes = dict(metadata or {})
    for name, value in notes.items():
        if not isinstance(name, str) or not isinstance(value, str | int | float | bool):
            raise ValueError(f"metadata[{name!r}] must be text, a number or a truth value, not {value!r}")
    if precision not in PRECISIONS:
        raise ValueError(f"precision must be one of {', '.join(PRECISIONS)}, not {precision!r}")
    if precision == "lossless" and inducing is not None:
        raise ValueError("a model at inducing points is not lossless: choose another precision")
    small = model if inducing is None else thinned(model, inducing)
    size = len(small) * small.kernel.states
    if size > MAXIMUM_STATES:
        raise ValueError(f"a snapshot holds at most {MAXIMUM_STATES} coordinates of the state, not {size}")
    document = {
        "schema": SCHEMA,
        "version": VERSION,
        "precision": precision,
        "components": [component_map(component) for component in model.kernel.components],
        "noise_variance": model.kernel.noise_variance,
        "prior_mean": model.prior_mean,
        "jitter": model.jitter,
        "transform": transform_map(model.transform),
        "basis": basis_parts(small.basis),
        "metadata": notes,
        **(
            lossless_parts(model) if precision == "lossless" else coarse_parts(model, small, _BITS[precision])
        ),
    }
    return zstandard.ZstdCompressor(level=3, write_checksum=True).compress(cbor2.dumps(document))


def decode(data: bytes) -> FieldModel:
    """The model in `data`. Raises SnapshotError for anything else."""
    return read(data).model


def read(data: bytes) -> Snapshot:
    """The model in `data` and what was sent with it. Raises SnapshotError for anything else.

    The model is a posterior whatever the bytes: the eigenvalues of its covariance are between 0 and the prior's.
    """
    document = _unpacked(data)
    schema, version = document.get("schema"), document.get("version")
    if schema != SCHEMA:
        raise SnapshotError(f"schema: {schema!r:.60} is not {SCHEMA!r}")
    if version != VERSION:
        raise SnapshotError(
            f"version: {version!r:.60} is not {VERSION}, which this program reads: "
            "the programs that write and read must be of the same version; update the older"
        )
    precision = document.get("precision")
    if precision not in PRECISIONS:
        raise SnapshotError(f"precision: {precision!r:.60} is none of {', '.join(PRECISIONS)}")
    kernel = kernel_from(document)
    return Snapshot(
        _model(document, kernel, precision),
        _metadata(document.get("metadata")),
        precision,
        StatedError() if precision == "lossless" else stated_from(document),
        kernel,
    )


def _unpacked(data: bytes) -> Document:
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


def _model(document: Document, believed: Kernel, precision: Precision) -> FieldModel:
    kernel = believed if precision == "lossless" or not _flag(document, "thinned") else standing(believed)
    transform, jitter = transform_from(document.get("transform")), number(document, "jitter")
    if not 0 < jitter <= 1e-2:
        raise SnapshotError(f"jitter: {jitter!r} is not in (0, 0.01]")
    prior_mean = bounded(document, "prior_mean")
    basis = basis_from(document, kernel.dimensions, MAXIMUM_STATES // kernel.states)
    try:
        factors = prior_factors(basis, kernel, jitter)
    except np.linalg.LinAlgError as error:
        raise SnapshotError(f"basis: its covariance is singular ({error})") from error
    size = len(basis) * kernel.states
    blank = FieldModel(kernel, prior_mean, jitter, basis, factors, np.zeros(size), np.eye(size), transform)
    if precision == "lossless":
        return lossless_from(document, blank)
    return coarse_from(document, blank, _BITS[precision])


def _flag(document: Document, name: str) -> bool:
    value = document.get(name)
    if not isinstance(value, bool):
        raise SnapshotError(f"{name}: a truth value was expected, not {value!r:.60}")
    return value


def _metadata(value: Any) -> Mapping[str, Scalar]:
    if not isinstance(value, dict):
        raise SnapshotError("metadata: a map was expected")
    for name, entry in value.items():
        if not isinstance(name, str) or not isinstance(entry, str | int | float | bool):
            raise SnapshotError(
                f"metadata: {name!r:.60}: {entry!r:.60} is not text, a number or a truth value"
            )
    return value
