import dataclasses
import math
import struct

import cbor2
import numpy as np
import pytest
import zstandard

from autonomy.learning import snapshot
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.snapshot import SnapshotError
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck
from autonomy.learning.transform import Identity, Log, Logit


def learnt(seed=0, capacity=100, jitter=1e-8, scale=1.0, lengthscale=30.0, novelty=1e-4, timescale=math.inf):
    rng = np.random.default_rng(seed)
    h = Hyperparameters(2.0 * scale**2, 0.02 * scale**2, (lengthscale, 1.3 * lengthscale), timescale)
    gp = SparseOnlineGP(h, capacity, novelty, jitter, prior_mean=33.5 * scale)
    for point in rng.uniform(0, 300, (600, 2)):
        gp.update(point, scale * (33.5 + np.sin(point[0] / 40) + np.cos(point[1] / 30) + 0.1 * rng.normal()))
    return gp.model()


KERNELS = {
    "long and short": Kernel(
        (Component(1.0, SquaredExponential((60.0, 70.0))), Component(0.3, Matern32((20.0, 20.0)))), 0.02
    ),
    "forgetting": Kernel((Component(1.0, Matern32((60.0, 60.0)), OrnsteinUhlenbeck(900.0)),), 0.02),
    "static and moving": Kernel(
        (
            Component(1.0, Matern32((90.0, 90.0))),
            Component(0.3, Matern32((30.0, 30.0)), OrnsteinUhlenbeck(900.0)),
        ),
        0.02,
    ),
    "static and smoothly moving": Kernel(
        (
            Component(1.0, Matern32((90.0, 90.0))),
            Component(0.3, Matern32((30.0, 30.0)), MaternMotion(400.0)),
            Component(0.1, SquaredExponential((50.0, 50.0)), MaternMotion(400.0)),
        ),
        0.02,
    ),
}


def learnt_under(kernel, capacity=60, readings=600):
    rng = np.random.default_rng(4)
    gp = SparseOnlineGP(kernel, capacity, prior_mean=33.5)
    for point in rng.uniform(0, 300, (readings, 2)):
        gp.advance(1.0)
        gp.update(point, 33.5 + np.sin(point[0] / 40) + np.cos(point[1] / 30) + 0.1 * rng.normal())
    return gp.model()


@pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
def test_sums_of_components_travel_within_a_millionth_of_the_signal(kernel):
    model = learnt_under(kernel)
    other = snapshot.decode(snapshot.encode(model))
    assert other.kernel == model.kernel
    axis = np.linspace(-20, 320, 50)
    one, two = model.predict_grid(axis, axis), other.predict_grid(axis, axis)
    signal = math.sqrt(kernel.signal_variance)
    # Entries of the whitened state are bounded by one and rounded to 6e-8; few of them add up anywhere.
    np.testing.assert_allclose(two.mean, one.mean, rtol=0, atol=5e-7 * signal)
    np.testing.assert_allclose(np.sqrt(two.variance), np.sqrt(one.variance), rtol=0, atol=1e-6 * signal)
    points = np.random.default_rng(1).uniform(0, 300, (30, 2))
    np.testing.assert_allclose(other.covariance(points), model.covariance(points), atol=5e-7 * signal**2)


def test_what_has_no_rates_of_change_can_be_advanced_ashore():
    model = learnt_under(KERNELS["static and moving"])
    later, other = model.advanced(500.0), snapshot.decode(snapshot.encode(model)).advanced(500.0)
    points = np.random.default_rng(1).uniform(0, 300, (30, 2))
    np.testing.assert_allclose(other.predict(points).mean, later.predict(points).mean, atol=1e-6)
    np.testing.assert_allclose(other.predict(points).variance, later.predict(points).variance, atol=1e-6)


def test_rates_of_change_stay_on_board():
    kernel = KERNELS["static and smoothly moving"]
    model = learnt_under(kernel)
    m = len(model)
    other = snapshot.decode(snapshot.encode(model))
    assert unpacked(snapshot.encode(model))["mean"].value == struct.pack(
        f"<{2 * m}f", *other.whitened_mean[: 2 * m]
    )
    np.testing.assert_array_equal(other.whitened_mean[2 * m :], 0.0)
    np.testing.assert_array_equal(other.whitened_covariance[2 * m :], np.eye(3 * m)[2 * m :])


@pytest.mark.parametrize("transform", [Identity(), Log(0.25), Logit(0.0, 40.0)], ids=repr)
def test_the_transform_travels(transform):
    model = dataclasses.replace(learnt(capacity=5), transform=transform)
    other = snapshot.decode(snapshot.encode(model))
    assert other.transform == transform
    np.testing.assert_allclose(other.predict([[30.0, 40.0]]).mean, model.predict([[30.0, 40.0]]).mean)


def test_two_groups_at_the_largest_capacity_stay_below_a_megabyte():
    model = learnt_under(KERNELS["static and moving"], capacity=300, readings=500)
    assert len(model) == 300
    size = len(snapshot.encode(model))
    print(f"{size} bytes")
    # 600 numbers squared, halved, four bytes each, of which the compressor saves a fiftieth.
    assert size < 740_000


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


COMPONENT = {
    "variance": 2.0,
    "space": "squared_exponential",
    "lengthscales_m": [30.0, 39.0],
    "time": "static",
    "timescale_s": math.inf,
}


def components(**changes):
    return {"components": [COMPONENT | changes]}


def typed(*values, tag=85, code="f"):
    return cbor2.CBORTag(tag, struct.pack(f"<{len(values)}{code}", *values))


DAMAGES = {
    "schema": ({"schema": "another/thing"}, "schema"),
    "version": ({"version": 99}, "version"),
    "text for a number": ({"jitter": "a"}, "jitter"),
    "truth for a number": ({"prior_mean": True}, "prior_mean"),
    "huge number": ({"prior_mean": 10**400}, "CBOR: is not CBOR"),
    "large number": ({"prior_mean": -1e31}, "prior_mean: -1e\\+31 is not within"),
    "large variance": (components(variance=1e31), "variance: 1e\\+31 is more than"),
    "tiny scale": (components(lengthscales_m=[1.0, 1e-9]), "lengthscales_m: 1e-09 is not from"),
    "nan": ({"prior_mean": math.nan}, "prior_mean"),
    "jitter": ({"jitter": 0.0}, "jitter"),
    "no components": ({"components": []}, "components"),
    "components": ({"components": 3}, "components"),
    "component": ({"components": [COMPONENT, 3]}, r"components\[1\]"),
    "too many components": ({"components": [COMPONENT] * 9}, "components"),
    "axes that differ": ({"components": [COMPONENT, COMPONENT | {"lengthscales_m": [1.0]}]}, "axes"),
    "negative variance": (components(variance=-1.0), r"components\[0\]: variance"),
    "negative noise": ({"noise_variance": -1.0}, "noise_variance"),
    "unknown space": (components(space="cubic"), r"space: 'cubic' is none of squared_exponential, matern32"),
    "no space": (components(space=None), "space"),
    "list for a name": (components(space=["squared_exponential"]), "space"),
    "unknown time": (components(time="periodic"), r"time: 'periodic' is none of static"),
    "static with a time-scale": (components(timescale_s=5.0), "timescale_s: 5.0, but what is static"),
    "motion without a time-scale": (components(time="ornstein_uhlenbeck"), "timescale_s must be positive"),
    "time-scale": (components(time="matern32_motion", timescale_s=-3.0), "timescale_s"),
    "scales": (components(lengthscales_m=3.0), "lengthscales_m"),
    "no scales": (components(lengthscales_m=[]), "lengthscales_m"),
    "scale": (components(lengthscales_m=[1.0, "b"]), "lengthscales_m"),
    "huge scale": (components(lengthscales_m=[1.0, 10**400]), "CBOR: is not CBOR"),
    "no transform": ({"transform": None}, "transform"),
    "unknown transform": (
        {"transform": {"name": "sqrt"}},
        "transform: name: 'sqrt' is none of none, log, logit",
    ),
    "transform without its number": ({"transform": {"name": "log"}}, "transform: offset"),
    "transform upside down": (
        {"transform": {"name": "logit", "lower": 2.0, "upper": 1.0}},
        "transform: lower",
    ),
    "plain bytes": ({"mean": b"1234"}, "mean"),
    "wrong tag": ({"mean": typed(1.0, tag=86, code="d")}, "mean"),
    "tagged text": ({"mean": cbor2.CBORTag(85, "abcd")}, "mean"),
    "odd length": ({"mean": cbor2.CBORTag(85, b"12345")}, "mean"),
    "too short": ({"basis": typed(1.0, 2.0, tag=86, code="d")}, "mean: 12 bytes are not 1 numbers"),
    "half a place": (
        {"basis": typed(1.0, 2.0, 3.0, tag=86, code="d")},
        "basis: 3 numbers are not places of 2",
    ),
    "infinite": ({"mean": typed(1.0, math.inf, 1.0)}, r"mean\[1\]"),
    "gain": ({"gain": typed(*[7.0] * 6)}, "gain"),
    "gain of no covariance": ({"gain": typed(0.5, 0.9, 0.5, 0.0, 0.0, 0.5)}, "gain: it leaves the range"),
    "negative gain": ({"gain": typed(-0.5, 0.0, 0.5, 0.0, 0.0, 0.5)}, "gain: it leaves the range"),
    "metadata": ({"metadata": 3}, "metadata"),
    "nested metadata": ({"metadata": {"a": {}}}, "metadata"),
    "too many": ({"basis": typed(*[0.0] * 4002, tag=86, code="d")}, "limit of 2000 places"),
}


@pytest.mark.parametrize(("change", "complaint"), DAMAGES.values(), ids=DAMAGES)
def test_what_is_wrong_and_where_is_said(change, complaint):
    document = unpacked(snapshot.encode(learnt(capacity=3))) | change
    with pytest.raises(SnapshotError, match=complaint):
        snapshot.decode(packed(document))


@pytest.mark.parametrize(
    "name",
    [
        *("schema", "version", "components", "noise_variance", "prior_mean", "jitter", "transform", "basis"),
        *("mean", "gain", "metadata"),
    ],
)
def test_what_is_missing_is_named(name):
    document = unpacked(snapshot.encode(learnt(capacity=3)))
    del document[name]
    with pytest.raises(SnapshotError, match=name):
        snapshot.decode(packed(document))


@pytest.mark.parametrize("name", COMPONENT)
def test_what_is_missing_of_a_component_is_named(name):
    document = unpacked(snapshot.encode(learnt(capacity=3)))
    del document["components"][0][name]
    with pytest.raises(SnapshotError, match=rf"components\[0\]: {name}"):
        snapshot.decode(packed(document))


def test_the_first_version_is_refused_with_what_to_do():
    document = unpacked(snapshot.encode(learnt(capacity=3))) | {"version": 1}
    with pytest.raises(SnapshotError, match=r"version: 1 is not 2, which .* update the older"):
        snapshot.decode(packed(document))


def test_a_model_too_large_to_be_read_is_not_written():
    kernel = KERNELS["static and moving"]
    m = 1001
    model = FieldModel(
        kernel, 0.0, 1e-8, np.zeros((m, 2)), (np.eye(m), np.eye(m)), np.zeros(2 * m), np.eye(2 * m)
    )
    with pytest.raises(ValueError, match="at most 2000 coordinates of the state, not 2002"):
        snapshot.encode(model)


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
