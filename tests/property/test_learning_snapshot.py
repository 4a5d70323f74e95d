"""Whatever arrives, the reader returns a model or says SnapshotError."""

import dataclasses

import cbor2
import numpy as np
import zstandard
from hypothesis import example, given, settings
from hypothesis import strategies as st

from autonomy.learning import packing, snapshot
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.packing import pack
from autonomy.learning.positions import coarsest_step_m, grid_step_m, snapped
from autonomy.learning.snapshot import SnapshotError
from autonomy.learning.snapshot_parts import basis_from, basis_parts
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


WHOLES = {
    "lossless": snapshot.encode(small_model(), {"samples": 20}),
    "12 bit": snapshot.encode(small_model(), {"samples": 20}, "12 bit"),
    "8 bit, thinned": snapshot.encode(small_model(), {"samples": 20}, "8 bit", inducing=4),
}
DOCUMENTS = {
    name: cbor2.loads(zstandard.ZstdDecompressor().decompress(whole)) for name, whole in WHOLES.items()
}
wholes, documents = st.sampled_from(list(WHOLES.values())), st.sampled_from(list(DOCUMENTS.values()))


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


@settings(max_examples=150)
@given(wholes, st.floats(0, 1, exclude_max=True), st.integers(1, 255))
def test_a_flipped_byte_never_passes_for_another_model(whole, position, flip):
    damaged = bytearray(whole)
    damaged[int(position * len(whole))] ^= flip
    try:
        model = snapshot.decode(bytes(damaged))
    except SnapshotError:
        return
    np.testing.assert_array_equal(model.whitened_mean, snapshot.decode(whole).whitened_mean)


@given(wholes, st.floats(0, 1, exclude_max=True))
def test_a_truncated_snapshot_is_refused(whole, length):
    try:
        snapshot.decode(whole[: int(length * len(whole))])
    except SnapshotError:
        return
    raise AssertionError(f"{length} of {len(whole)} bytes were taken for a snapshot")


junk = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=24),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)
tagged = st.builds(cbor2.CBORTag, st.sampled_from([40, 85, 86]), junk | st.binary(max_size=200))


@st.composite
def changed(draw):
    """A snapshot with anything in any place of it."""
    document = dict(draw(documents))
    values = st.one_of(
        junk, tagged, st.lists(st.floats() | st.integers() | st.binary(max_size=40), max_size=4)
    )
    for name in draw(st.lists(st.sampled_from(sorted(document)), min_size=1, max_size=4)):
        kept = document[name]
        if isinstance(kept, list) and kept and draw(st.booleans()):
            place = draw(st.integers(0, len(kept) - 1))
            document[name] = [*kept[:place], draw(values), *kept[place + 1 :]]
        else:
            document[name] = draw(values)
    return document


@settings(max_examples=200)
@given(changed())
def test_any_value_in_any_place(document):
    survives(zstandard.ZstdCompressor().compress(cbor2.dumps(document)))


@settings(max_examples=150)
@given(
    documents,
    st.integers(0, 3),
    st.dictionaries(
        st.sampled_from(sorted(DOCUMENTS["lossless"]["components"][0])), junk | tagged, min_size=1, max_size=3
    ),
)
def test_any_value_in_any_place_of_a_component(document, index, changes):
    components = [
        component | changes if i == index else component for i, component in enumerate(document["components"])
    ]
    survives(zstandard.ZstdCompressor().compress(cbor2.dumps(document | {"components": components})))


@settings(max_examples=200)
@given(
    documents, st.dictionaries(st.sampled_from(["name", "lower", "upper", "offset", "x"]), junk, max_size=3)
)
def test_any_value_in_any_place_of_the_transform(document, changes):
    document = document | {"transform": document["transform"] | changes}
    survives(zstandard.ZstdCompressor().compress(cbor2.dumps(document)))


def assert_posterior(model):
    eigenvalues = np.linalg.eigvalsh(model.whitened_covariance)
    assert eigenvalues.min() > -1e-6
    assert eigenvalues.max() < 1 + 1e-6
    variance = model.predict(np.random.default_rng(0).uniform(-10, 80, (50, 2))).latent_variance
    assert variance.min() > -1e-6 * model.kernel.signal_variance


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.5))
def test_any_triangle_is_a_covariance_or_refused(seed, scale):
    document = DOCUMENTS["lossless"]
    count = len(document["covariance"].value) // 8
    size = int((2 * count) ** 0.5)
    values = scale / size * np.random.default_rng(seed).normal(size=count)
    values[np.cumsum(np.arange(1, size + 1)) - 1] += 0.5
    covariance = cbor2.CBORTag(86, values.astype("<f8").tobytes())
    try:
        model = snapshot.decode(
            zstandard.ZstdCompressor().compress(cbor2.dumps(document | {"covariance": covariance}))
        )
    except SnapshotError:
        return
    assert_posterior(model)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2047))
def test_any_root_is_a_covariance(seed, largest):
    document = DOCUMENTS["12 bit"]
    n = 18
    root = np.random.default_rng(seed).integers(-largest, largest, n * (n + 1) // 2, endpoint=True)
    model = snapshot.decode(
        zstandard.ZstdCompressor().compress(cbor2.dumps(document | {"root": list(pack(root))}))
    )
    assert_posterior(model)


@given(st.lists(st.integers(-packing.LARGEST, packing.LARGEST), max_size=200))
def test_whole_numbers_come_back(numbers):
    lengths, bits = pack(np.array(numbers, dtype=np.int64))
    assert packing.unpack(lengths, bits, len(numbers)).tolist() == numbers


@given(st.lists(st.integers(1 - 2**31, 2**31 - 1), max_size=100))
def test_whole_numbers_of_one_width_come_back(numbers):
    array = np.array(numbers, dtype=np.int64)
    width = packing.width_of(array)
    assert packing.unpack_fixed(packing.pack_fixed(array, width), width, len(numbers)).tolist() == numbers


@given(st.binary(max_size=60), st.binary(max_size=60), st.integers(0, 300))
def test_any_bytes_are_numbers_or_refused(lengths, bits, count):
    try:
        numbers = packing.unpack(lengths, bits, count)
    except packing.PackingError:
        return
    assert len(numbers) == count
    assert np.abs(numbers).max(initial=0) <= packing.LARGEST


@given(st.floats(1e-3, 1e7), st.integers(0, 2**32 - 1))
def test_snapped_places_travel_exactly_and_are_near(span_m, seed):
    points = np.random.default_rng(seed).uniform(-span_m, span_m, (20, 2))
    step_m = grid_step_m(span_m)
    near = snapped(points, step_m)
    assert np.abs(near - points).max() <= 0.5 * step_m
    assert coarsest_step_m(near) >= step_m
    np.testing.assert_array_equal(snapped(near, step_m), near)
    parts = cbor2.loads(cbor2.dumps(basis_parts(near)))
    np.testing.assert_array_equal(basis_from({"basis": parts}, 2, 100), near)
