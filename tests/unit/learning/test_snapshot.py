import math
import struct

import cbor2
import numpy as np
import pytest
import zstandard

from autonomy.learning import snapshot
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.snapshot import SnapshotError
from autonomy.learning.sparse_gp import SparseOnlineGP


def learnt(seed=0, capacity=100, jitter=1e-8, scale=1.0, lengthscale=30.0, novelty=1e-4, timescale=math.inf):
    rng = np.random.default_rng(seed)
    h = Hyperparameters(2.0 * scale**2, 0.02 * scale**2, (lengthscale, 1.3 * lengthscale), timescale)
    gp = SparseOnlineGP(h, capacity, novelty, jitter, prior_mean=33.5 * scale)
    for point in rng.uniform(0, 300, (600, 2)):
        gp.update(point, scale * (33.5 + np.sin(point[0] / 40) + np.cos(point[1] / 30) + 0.1 * rng.normal()))
    return gp.model()


def packed(document):
    return zstandard.ZstdCompressor().compress(cbor2.dumps(document))


def unpacked(data):
    return cbor2.loads(zstandard.ZstdDecompressor().decompress(data))


@pytest.mark.parametrize(
    "keywords",
    [{}, {"jitter": 1e-12, "novelty": 0.0}, {"scale": 1e-6}, {"lengthscale": 500.0}, {"capacity": 3}],
    ids=["plain", "barely regular", "tiny units", "long", "small"],
)
def test_the_decoded_map_is_the_vehicles_to_half_a_percent_of_the_fields_deviation(keywords):
    model = learnt(**keywords)
    other = snapshot.decode(snapshot.encode(model))
    axis = np.linspace(-20, 320, 60)
    one, two = model.predict_grid(axis, axis), other.predict_grid(axis, axis)
    deviation = one.mean.std()
    mean_error = np.abs(one.mean - two.mean).max() / deviation
    sd_error = (
        np.abs(np.sqrt(np.maximum(one.variance, 0)) - np.sqrt(np.maximum(two.variance, 0))).max() / deviation
    )
    print(f"greatest error of mean {mean_error:.1e}, of standard deviation {sd_error:.1e} of the field's")
    assert mean_error < 0.005
    assert sd_error < 0.005
    assert other.kernel == model.kernel
    assert (other.prior_mean, other.jitter) == (model.prior_mean, model.jitter)
    np.testing.assert_array_equal(other.basis, model.basis)


def test_it_stays_exact_after_a_long_run_of_replacements():
    rng = np.random.default_rng(1)
    gp = SparseOnlineGP(Hyperparameters(1.0, 0.01, (30.0, 30.0)), 60)
    for point in np.cumsum(rng.normal(0, 3, (5000, 2)), axis=0):
        gp.update(point, float(np.sin(point[0] / 40)))
    assert gp.replacements > 300
    axis = np.linspace(gp.basis.min(), gp.basis.max(), 40)
    one, two = (
        gp.predict_grid(axis, axis),
        snapshot.decode(snapshot.encode(gp.model())).predict_grid(axis, axis),
    )
    np.testing.assert_allclose(two.mean, one.mean, atol=1e-5)
    np.testing.assert_allclose(two.variance, one.variance, atol=1e-5)


def test_a_hundred_basis_vectors_take_some_twenty_kilobytes():
    model = learnt(novelty=0.0)
    assert len(model) == 100
    assert len(snapshot.encode(model)) < 24_000


def test_the_prior_travels_too():
    prior = FieldModel.prior(Hyperparameters(1.0, 0.1, (5.0, 5.0), 7.0), 3.0)
    other = snapshot.decode(snapshot.encode(prior))
    assert len(other) == 0
    assert other.kernel == prior.kernel
    assert other.predict([[0.0, 0.0]]).mean[0] == 3.0


def test_metadata_travels_with_the_model():
    notes = {"vehicle": "boat1", "samples": 12, "rmse": 0.5, "live": True}
    read = snapshot.read(snapshot.encode(learnt(capacity=5), notes))
    assert read.metadata == notes
    assert len(read.model) == 5
    with pytest.raises(ValueError, match="metadata"):
        snapshot.encode(learnt(capacity=2), {"a": [1]})


def typed(*values, tag=85, code="f"):
    return cbor2.CBORTag(tag, struct.pack(f"<{len(values)}{code}", *values))


DAMAGES = {
    "schema": ({"schema": "another/thing"}, "schema"),
    "version": ({"version": 99}, "version"),
    "text for a number": ({"jitter": "a"}, "jitter"),
    "truth for a number": ({"prior_mean": True}, "prior_mean"),
    "huge number": ({"prior_mean": 10**400}, "prior_mean"),
    "nan": ({"prior_mean": math.nan}, "prior_mean"),
    "jitter": ({"jitter": 0.0}, "jitter"),
    "negative variance": ({"signal_variance": -1.0}, "signal_variance"),
    "scales": ({"lengthscales_m": 3.0}, "lengthscales_m"),
    "no scales": ({"lengthscales_m": []}, "lengthscales_m"),
    "scale": ({"lengthscales_m": [1.0, "b"]}, "lengthscales_m"),
    "huge scale": ({"lengthscales_m": [1.0, 10**400]}, "lengthscales_m"),
    "plain bytes": ({"mean": b"1234"}, "mean"),
    "wrong tag": ({"mean": typed(1.0, tag=86, code="d")}, "mean"),
    "tagged text": ({"mean": cbor2.CBORTag(85, "abcd")}, "mean"),
    "odd length": ({"mean": cbor2.CBORTag(85, b"12345")}, "mean"),
    "too short": ({"basis": typed(1.0, 2.0, tag=86, code="d")}, "basis"),
    "infinite": ({"mean": typed(1.0, math.inf, 1.0)}, r"mean\[1\]"),
    "gain": ({"gain": typed(*[7.0] * 6)}, "gain"),
    "metadata": ({"metadata": 3}, "metadata"),
    "nested metadata": ({"metadata": {"a": {}}}, "metadata"),
    "too many": ({"mean": typed(*[0.0] * 2001)}, "limit"),
}


@pytest.mark.parametrize(("change", "complaint"), DAMAGES.values(), ids=DAMAGES)
def test_what_is_wrong_and_where_is_said(change, complaint):
    document = unpacked(snapshot.encode(learnt(capacity=3))) | change
    with pytest.raises(SnapshotError, match=complaint):
        snapshot.decode(packed(document))


@pytest.mark.parametrize(
    "name", ["schema", "version", "jitter", "lengthscales_m", "basis", "mean", "gain", "metadata"]
)
def test_what_is_missing_is_named(name):
    document = unpacked(snapshot.encode(learnt(capacity=3)))
    del document[name]
    with pytest.raises(SnapshotError, match=name):
        snapshot.decode(packed(document))


def test_decompression_bombs_are_not_unpacked():
    bomb = zstandard.ZstdCompressor().compress(bytes(64 * 1024 * 1024))
    assert len(bomb) < 10_000
    with pytest.raises(SnapshotError, match="limit"):
        snapshot.decode(bomb)
    silent = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(64 * 1024 * 1024))
    with pytest.raises(SnapshotError, match="compressed frame"):
        snapshot.decode(silent)
    with pytest.raises(SnapshotError, match="exceed"):
        snapshot.decode(bytes(snapshot.MAXIMUM_BYTES + 1))


@pytest.mark.parametrize(
    "data", [b"", b"x", b"\x00" * 100, packed([1, 2]), packed(3), packed({}), packed({1: 2})]
)
def test_anything_else_is_no_snapshot(data):
    with pytest.raises(SnapshotError):
        snapshot.decode(data)


def test_nesting_and_references_do_not_break_the_reader():
    compress = zstandard.ZstdCompressor().compress
    for plain in (
        b"\x81" * 100_000,
        b"\xd8\x1d\x00",
        b"\xc1\xfb\x7f\xf0" + bytes(6),
        b"\xd8\x23\x61(",
        b"\x9b" + b"\xff" * 8,
    ):
        with pytest.raises(SnapshotError):
            snapshot.decode(compress(plain))
