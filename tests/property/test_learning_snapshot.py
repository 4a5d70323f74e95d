"""Whatever arrives, the reader returns a model or says SnapshotError."""

import dataclasses

import cbor2
import numpy as np
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autonomy.learning import snapshot
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.snapshot import SnapshotError
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck
from autonomy.learning.transform import Logit

KERNEL = Kernel(
    (
        Component(1.0, SquaredExponential((30.0, 40.0))),
        Component(0.2, Matern32((10.0, 10.0))),
        Component(0.5, Matern32((20.0, 20.0)), OrnsteinUhlenbeck(600.0)),
        Component(0.1, SquaredExponential((20.0, 20.0)), MaternMotion(600.0)),
    ),
    0.01,
)


def small_model():
    gp = SparseOnlineGP(KERNEL, 6, prior_mean=1.5)
    for i in range(20):
        gp.advance(1.0)
        gp.update((17.0 * i % 60, 29.0 * i % 70), 1.5 + 0.1 * i)
    return dataclasses.replace(gp.model(), transform=Logit(0.0, 40.0))


WHOLE = snapshot.encode(small_model(), {"samples": 20})
DOCUMENT = cbor2.loads(zstandard.ZstdDecompressor().decompress(WHOLE))


def survives(data):
    try:
        model = snapshot.decode(data)
    except SnapshotError:
        return
    assert isinstance(model, FieldModel)
    assert not np.isnan(model.predict([[0.0, 0.0], [1e9, 0.0]]).mean).any()


@given(st.binary(max_size=300))
@example(b"")
def test_any_bytes(data):
    survives(data)


@given(st.binary(max_size=300))
def test_any_bytes_in_a_proper_frame(data):
    survives(zstandard.ZstdCompressor().compress(data))


@settings(max_examples=300)
@given(st.integers(0, len(WHOLE) - 1), st.integers(1, 255))
def test_a_flipped_byte_never_passes_for_another_model(position, flip):
    damaged = bytearray(WHOLE)
    damaged[position] ^= flip
    try:
        model = snapshot.decode(bytes(damaged))
    except SnapshotError:
        return
    np.testing.assert_array_equal(model.whitened_mean, snapshot.decode(WHOLE).whitened_mean)


@given(st.integers(0, len(WHOLE) - 1))
def test_a_truncated_snapshot_is_refused(length):
    try:
        snapshot.decode(WHOLE[:length])
    except SnapshotError:
        return
    raise AssertionError(f"{length} of {len(WHOLE)} bytes were taken for a snapshot")


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=24),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
tagged = st.builds(cbor2.CBORTag, st.sampled_from([40, 85, 86]), junk | st.binary(max_size=200))


@settings(max_examples=300)
@given(st.dictionaries(st.sampled_from(sorted(DOCUMENT)), junk | tagged, min_size=1, max_size=4))
def test_any_value_in_any_place(changes):
    survives(zstandard.ZstdCompressor().compress(cbor2.dumps(DOCUMENT | changes)))


@settings(max_examples=300)
@given(
    st.integers(0, 3),
    st.dictionaries(
        st.sampled_from(sorted(DOCUMENT["components"][0])), junk | tagged, min_size=1, max_size=3
    ),
)
def test_any_value_in_any_place_of_a_component(index, changes):
    components = [
        component | changes if i == index else component for i, component in enumerate(DOCUMENT["components"])
    ]
    survives(zstandard.ZstdCompressor().compress(cbor2.dumps(DOCUMENT | {"components": components})))


@settings(max_examples=200)
@given(st.dictionaries(st.sampled_from(["name", "lower", "upper", "offset", "x"]), junk, max_size=3))
def test_any_value_in_any_place_of_the_transform(changes):
    document = DOCUMENT | {"transform": DOCUMENT["transform"] | changes}
    survives(zstandard.ZstdCompressor().compress(cbor2.dumps(document)))


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.5))
def test_any_triangle_is_a_covariance_or_refused(seed, scale):
    values = scale * np.random.default_rng(seed).normal(size=171)
    values[np.cumsum(np.arange(1, 19)) - 1] += 0.5
    gain = cbor2.CBORTag(85, values.astype("<f4").tobytes())
    try:
        model = snapshot.decode(zstandard.ZstdCompressor().compress(cbor2.dumps(DOCUMENT | {"gain": gain})))
    except SnapshotError:
        return
    eigenvalues = np.linalg.eigvalsh(model.whitened_covariance)
    assert eigenvalues.min() > -2e-3
    assert eigenvalues.max() < 1 + 2e-3
