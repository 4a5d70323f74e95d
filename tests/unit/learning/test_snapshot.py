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
from autonomy.learning.packing import pack
from autonomy.learning.positions import grid_step_m, snapped
from autonomy.learning.snapshot import SnapshotError
from autonomy.learning.snapshot_parts import basis_from, basis_parts
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck
from autonomy.learning.transform import Identity, Log, Logit

NOTES = {
    "vehicle": "boat1",
    "survey": "bay-2026",
    "utc_s": 1.79e9,
    "software_version": "0.9.0",
    "configuration_hash": "a1b2c3d4e5f60718",
    "capacity": 100,
    "rho": 0.25,
}


def learnt(seed=0, capacity=100, jitter=1e-8, scale=1.0, lengthscale=30.0, novelty=1e-4, snap=False):
    rng = np.random.default_rng(seed)
    h = Hyperparameters(2.0 * scale**2, 0.02 * scale**2, (lengthscale, 1.3 * lengthscale))
    gp = SparseOnlineGP(h, capacity, novelty, jitter, prior_mean=33.5 * scale)
    points = rng.uniform(0, 300, (600, 2))
    for point in snapped(points, grid_step_m(300.0)) if snap else points:
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


def assert_same_model(other, model):
    """Every number of it."""
    assert other.kernel == model.kernel
    assert (other.prior_mean, other.jitter, other.transform) == (
        model.prior_mean,
        model.jitter,
        model.transform,
    )
    np.testing.assert_array_equal(other.basis, model.basis)
    np.testing.assert_array_equal(other.whitened_mean, model.whitened_mean)
    np.testing.assert_array_equal(other.whitened_covariance, model.whitened_covariance)
    for one, two in zip(model.factors, other.factors, strict=True):
        np.testing.assert_array_equal(one, two)


def greatest_differences(one, two):
    """Of mean and standard deviation, as shares of σf."""
    axis = np.linspace(-20, 320, 60)
    signal = math.sqrt(one.kernel.signal_variance)
    maps = [model.predict_grid(axis, axis) for model in (one, two)]
    sd = [np.sqrt(np.maximum(each.latent_variance, 0.0)) for each in maps]
    return (
        np.abs(maps[0].latent_mean - maps[1].latent_mean).max() / signal,
        np.abs(sd[0] - sd[1]).max() / signal,
    )


@pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
def test_lossless_is_every_number_and_predicts_the_same(kernel):
    model = learnt_under(kernel)
    other = snapshot.decode(snapshot.encode(model))
    assert_same_model(other, model)
    for one, two in ((model, other), (model.advanced(500.0), other.advanced(500.0))):
        mean, sd = greatest_differences(one, two)
        assert mean <= 1e-12
        assert sd <= 1e-12


# By how much the entries of R may round, times what 60 or 120 columns of them may add up to: see the bound in
# `quantised`. Measured: a fifth of these.
LIMITS = {"16 bit": 3e-4, "12 bit": 4e-3, "8 bit": 3e-2}


@pytest.mark.parametrize("precision", LIMITS)
@pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
def test_fewer_bits_are_off_by_little_and_say_by_how_much(kernel, precision):
    model = learnt_under(kernel)
    read = snapshot.read(snapshot.encode(model, precision=precision))
    assert read.precision == precision
    assert read.kernel == read.model.kernel == model.kernel
    np.testing.assert_array_equal(read.model.basis, model.basis)
    mean, sd = greatest_differences(model, read.model)
    print(
        f"mean {mean:.1e}, stated {read.stated_error.mean:.1e}; sd {sd:.1e}, stated {read.stated_error.sd:.1e}"
    )
    assert mean < LIMITS[precision]
    assert sd < LIMITS[precision]
    # The stated error was found at other places of the same map.
    assert 0.5 * mean < read.stated_error.mean < 3 * mean
    assert 0.5 * sd < read.stated_error.sd < 3 * sd


@pytest.mark.parametrize("precision", LIMITS)
def test_where_the_map_is_good_its_deviation_is_as_right_as_anywhere(precision):
    """Rounding the covariance itself would turn a deviation of 1 % of σf into one of 0 to 5 %."""
    h = Hyperparameters(1.0, 1e-6, (60.0, 60.0))
    gp = SparseOnlineGP(h, 60)
    for point in np.random.default_rng(2).uniform(0, 300, (400, 2)):
        gp.update(point, float(np.sin(point[0] / 40)))
    model = gp.model()
    other = snapshot.decode(snapshot.encode(model, precision=precision))
    axis = np.linspace(50, 250, 40)
    one, two = (np.sqrt(each.predict_grid(axis, axis).variance) for each in (model, other))
    assert one.min() < 0.02
    assert np.abs(one - two).max() < LIMITS[precision]


def test_in_fewer_bits_rates_of_change_stay_on_board():
    kernel = KERNELS["static and smoothly moving"]
    model = learnt_under(kernel)
    m = len(model)
    other = snapshot.decode(snapshot.encode(model, precision="16 bit"))
    np.testing.assert_array_equal(other.whitened_mean[2 * m :], 0.0)
    np.testing.assert_array_equal(other.whitened_covariance[2 * m :], np.eye(3 * m)[2 * m :])


def test_what_has_no_rates_of_change_can_be_advanced_ashore_in_fewer_bits():
    model = learnt_under(KERNELS["static and moving"])
    later = model.advanced(500.0)
    other = snapshot.decode(snapshot.encode(model, precision="16 bit")).advanced(500.0)
    assert max(greatest_differences(later, other)) < 1e-4


@pytest.mark.parametrize("precision", snapshot.PRECISIONS)
@pytest.mark.parametrize("transform", [Identity(), Log(0.25), Logit(0.0, 40.0)], ids=repr)
def test_the_transform_travels(transform, precision):
    model = dataclasses.replace(learnt(capacity=5), transform=transform)
    other = snapshot.decode(snapshot.encode(model, precision=precision))
    assert other.transform == transform
    np.testing.assert_allclose(
        other.predict([[30.0, 40.0]]).median, model.predict([[30.0, 40.0]]).median, rtol=0.02
    )


@pytest.mark.parametrize("precision", snapshot.PRECISIONS)
@pytest.mark.parametrize(
    "keywords",
    [{}, {"jitter": 1e-12, "novelty": 0.0}, {"scale": 1e-6}, {"lengthscale": 500.0}, {"capacity": 3}],
    ids=["plain", "barely regular", "tiny units", "long", "small"],
)
def test_hard_models_travel_too(keywords, precision):
    model = learnt(**keywords)
    other = snapshot.decode(snapshot.encode(model, precision=precision))
    assert max(greatest_differences(model, other)) < LIMITS.get(precision, 1e-12)


def test_it_stays_exact_after_a_long_run_of_replacements():
    rng = np.random.default_rng(1)
    gp = SparseOnlineGP(Hyperparameters(1.0, 0.01, (30.0, 30.0)), 60)
    for point in np.cumsum(rng.normal(0, 3, (5000, 2)), axis=0):
        gp.update(point, float(np.sin(point[0] / 40)))
    assert gp.replacements > 300
    model = gp.model()
    assert_same_model(snapshot.decode(snapshot.encode(model)), model)
    axis = np.linspace(gp.basis.min(), gp.basis.max(), 40)
    one = model.predict_grid(axis, axis)
    two = snapshot.decode(snapshot.encode(model, precision="16 bit")).predict_grid(axis, axis)
    np.testing.assert_allclose(two.mean, one.mean, atol=1e-4)
    np.testing.assert_allclose(np.sqrt(two.variance), np.sqrt(one.variance), atol=1e-4)


@pytest.mark.parametrize("precision", snapshot.PRECISIONS)
def test_the_prior_travels_too(precision):
    prior = FieldModel.prior(Hyperparameters(1.0, 0.1, (5.0, 5.0), 7.0), 3.0)
    other = snapshot.decode(snapshot.encode(prior, precision=precision))
    assert len(other) == 0
    assert other.kernel == prior.kernel
    assert other.predict([[0.0, 0.0]]).mean[0] == 3.0


@pytest.mark.parametrize("precision", LIMITS)
def test_what_nothing_is_known_of_stays_the_prior(precision):
    """Half of S is 1 there, which rounding would exceed."""
    gp = SparseOnlineGP(Hyperparameters(1.0, 0.01, (30.0, 30.0)), 40)
    gp.start_basis(np.random.default_rng(0).uniform(0, 300, (40, 2)), np.zeros(40), np.ones(40))
    gp.project(np.array([10.0, 10.0]), 1.0, 0.01)
    other = snapshot.decode(snapshot.encode(gp.model(), precision=precision))
    eigenvalues = np.linalg.eigvalsh(other.whitened_covariance)
    assert eigenvalues.max() <= 1.0 + 1e-12
    assert eigenvalues.min() >= -1e-12
    assert max(greatest_differences(gp.model(), other)) < LIMITS[precision]


@pytest.mark.parametrize("kernel", KERNELS.values(), ids=KERNELS)
def test_several_groups_become_one(kernel):
    model = learnt_under(kernel)
    read = snapshot.read(snapshot.encode(model, precision="12 bit", inducing=200))
    assert len(read.model.kernel.groups) == 1
    assert read.kernel == model.kernel
    mean, sd = greatest_differences(model, read.model)
    # The places are chosen until nowhere on a lattice is more than 0.005 wrong.
    assert mean < 0.02
    assert sd < 0.02
    assert read.stated_error.mean < 0.02
    assert read.stated_error.sd < 0.02


def test_inducing_points_are_as_many_as_asked_for_at_most():
    model = learnt_under(KERNELS["long and short"])
    errors = []
    for most in (20, 40, 59):
        read = snapshot.read(snapshot.encode(model, precision="16 bit", inducing=most))
        assert len(read.model) == most
        mean, sd = greatest_differences(model, read.model)
        assert read.stated_error.mean > 0.5 * mean
        assert read.stated_error.sd > 0.5 * sd
        errors.append(max(mean, sd))
    assert errors == sorted(errors, reverse=True)
    same = snapshot.encode(model, precision="16 bit", inducing=60)
    assert same == snapshot.encode(model, precision="16 bit")


def test_a_hundred_basis_vectors_on_the_grid_take_less_than_four_and_a_half_kilobytes_at_12_bits():
    model = learnt(novelty=0.0, snap=True)
    assert len(model) == 100
    sizes = {precision: len(snapshot.encode(model, NOTES, precision)) for precision in snapshot.PRECISIONS}
    print(sizes)
    assert sizes["12 bit"] <= 4600
    assert sizes["16 bit"] <= 7000
    assert sizes["8 bit"] <= 2600


@pytest.mark.parametrize("count", range(1, 12))
@pytest.mark.parametrize("reach", [1, 3, 7])
def test_places_within_a_few_steps_of_each_other_come_back_and_no_other(count, reach):
    """So few bits each that in the last byte there would be room for one more."""
    axis = np.arange(-reach, reach + 1.0)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    places = np.random.default_rng(count).permutation(grid)[: min(count, len(grid))]
    assert np.array_equal(basis_from({"basis": basis_parts(places)}, 2, 100), places)


def test_two_groups_at_the_largest_capacity_fit():
    model = learnt_under(KERNELS["static and moving"], capacity=300, readings=500)
    assert len(model) == 300
    # 600 numbers squared, halved, and twice 300, eight bytes each.
    assert len(snapshot.encode(model)) < 2_250_000
    assert len(snapshot.encode(model, precision="8 bit", inducing=100)) < 6000


@pytest.mark.parametrize(
    ("keywords", "complaint"),
    [
        ({"precision": "10 bit"}, "precision must be one of lossless, 16 bit, 12 bit, 8 bit, not '10 bit'"),
        ({"inducing": 50}, "inducing points is not lossless"),
        ({"inducing": 0, "precision": "8 bit"}, "at least one place"),
        ({"metadata": {"a": [1]}}, r"metadata\['a'\] must be text"),
    ],
)
def test_what_cannot_be_encoded_is_said(keywords, complaint):
    with pytest.raises(ValueError, match=complaint):
        snapshot.encode(learnt(capacity=2), **keywords)


def packed(document):
    return zstandard.ZstdCompressor().compress(cbor2.dumps(document))


def unpacked(data):
    return cbor2.loads(zstandard.ZstdDecompressor().decompress(data))


def test_metadata_travels_with_the_model():
    notes = {"vehicle": "boat1", "samples": 12, "rmse": 0.5, "live": True}
    for precision in snapshot.PRECISIONS:
        read = snapshot.read(snapshot.encode(learnt(capacity=5), notes, precision))
        assert read.metadata == notes
        assert len(read.model) == 5


COMPONENT = {
    "variance": 2.0,
    "space": "squared_exponential",
    "lengthscales_m": [30.0, 39.0],
    "time": "static",
    "timescale_s": math.inf,
}


def components(**changes):
    return {"components": [COMPONENT | changes]}


def typed(*values, tag=86):
    return cbor2.CBORTag(tag, struct.pack(f"<{len(values)}d", *values))


DAMAGES = {
    "schema": ({"schema": "another/thing"}, "schema"),
    "version": ({"version": 99}, "version"),
    "text for a number": ({"jitter": "a"}, "jitter"),
    "truth for a number": ({"prior_mean": True}, "prior_mean"),
    "huge number": ({"prior_mean": 10**400}, "CBOR: is not CBOR"),
    "large number": ({"prior_mean": -1e31}, "prior_mean: -1e\\+31 is not within"),
    "large variance": (components(variance=1e31), "variance: 1e\\+31 is not within"),
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
    "precision": ({"precision": "10 bit"}, "precision: '10 bit' is none of lossless, 16 bit"),
    "no basis": ({"basis": 3}, "basis: a typed array"),
    "half a place": ({"basis": typed(1.0, 2.0, 3.0)}, "basis: 3 numbers are not places of 2"),
    "too many": ({"basis": typed(*[0.0] * 2402)}, "limit of 1200 places"),
    "far away": ({"basis": typed(*[1e10] * 6)}, "basis: it reaches farther"),
    "basis that is infinite": ({"basis": typed(*[math.inf] * 6)}, r"basis\[0\]: not finite"),
    "grid of nothing": ({"basis": [0.0, [0, 0], 8, bytes(6)]}, "basis: a grid of 0.0 m"),
    "grid without a corner": ({"basis": [1.0, [0], 8, bytes(6)]}, "basis: .* is not a corner"),
    "corner of halves": ({"basis": [1.0, [0, 0.5], 8, bytes(6)]}, "basis: .* is not a corner"),
    "width": ({"basis": [1.0, [0, 0], 33, bytes(6)]}, "basis: a width of 33"),
    "grid of three": ({"basis": [1.0, [0, 0], 8]}, "basis: a list of float, list, int, bytes"),
    "metadata": ({"metadata": 3}, "metadata"),
    "nested metadata": ({"metadata": {"a": {}}}, "metadata"),
}

LOSSLESS_DAMAGES = {
    "plain bytes": ({"mean": b"1234"}, "mean"),
    "wrong tag": ({"mean": typed(1.0, tag=85)}, "mean"),
    "tagged text": ({"mean": cbor2.CBORTag(86, "abcd")}, "mean"),
    "odd length": ({"mean": cbor2.CBORTag(86, b"12345")}, "mean: 5 bytes are not 3 numbers"),
    "too short": ({"basis": typed(1.0, 2.0)}, "mean: 24 bytes are not 1 numbers"),
    "infinite": ({"mean": typed(1.0, math.inf, 1.0)}, r"mean\[1\]"),
    "beyond the prior": ({"covariance": typed(7.0, 0.0, 0.1, 0.0, 0.0, 0.1)}, "covariance: .* above 1"),
    "no covariance": ({"covariance": typed(0.5, 0.9, 0.5, 0.0, 0.0, 0.5)}, "covariance: .* negative"),
    "negative": ({"covariance": typed(-0.5, 0.0, 0.5, 0.0, 0.0, 0.5)}, "covariance: .* negative"),
    "no factors": ({"factors": []}, "factors: a list of 1"),
    "factors of something else": (
        {"factors": [typed(1.0, 0.0, 1.0, 0.0, 0.0, 1.0)]},
        r"factors\[0\]: it does not",
    ),
}

ROOT = pack(np.array([4, 0, 4, 0, 0, 4]))
COARSE_DAMAGES = {
    "no truth": ({"thinned": 1}, "thinned: a truth value"),
    "no list": ({"mean": 3}, "mean: a list of float, int, bytes"),
    "no step": ({"mean": [0.0, 8, bytes(3)]}, "mean: 0.0 is no step"),
    "step that is no number": ({"mean": [math.nan, 8, bytes(3)]}, "mean: nan is no step"),
    "mean too short": ({"mean": [1.0, 8, bytes(2)]}, "mean: bits: 2 bytes are not 24 bits"),
    "negative width": ({"mean": [1.0, -1, bytes(2)]}, "mean: a width of -1"),
    "no root": ({"root": None}, "root: a list of bytes, bytes"),
    "no lengths": ({"root": [b"x", ROOT[1]]}, "root: lengths"),
    "more lengths": (
        {"root": [pack(np.zeros(20, int))[0], ROOT[1]]},
        "root: lengths: these are not of 3 pairs",
    ),
    "lengths and more": ({"root": [ROOT[0] + b"x", ROOT[1]]}, "root: lengths"),
    "less bits": ({"root": [ROOT[0], b""]}, "root: bits: 0 bytes"),
    "no error": ({"error": [0.0]}, "error: a list of float, float"),
    "error that is none": ({"error": [0.0, math.nan]}, "error: .* no shares"),
    "of another size": ({"basis": typed(1.0, 2.0)}, "mean: bits"),
}


@pytest.mark.parametrize(("change", "complaint"), DAMAGES.values(), ids=DAMAGES)
@pytest.mark.parametrize("precision", ["lossless", "12 bit"])
def test_what_is_wrong_and_where_is_said(change, complaint, precision):
    document = unpacked(snapshot.encode(learnt(capacity=3), precision=precision)) | change
    with pytest.raises(SnapshotError, match=complaint):
        snapshot.decode(packed(document))


@pytest.mark.parametrize(("change", "complaint"), LOSSLESS_DAMAGES.values(), ids=LOSSLESS_DAMAGES)
def test_what_is_wrong_in_a_lossless_one_is_said(change, complaint):
    document = unpacked(snapshot.encode(learnt(capacity=3))) | change
    with pytest.raises(SnapshotError, match=complaint):
        snapshot.decode(packed(document))


@pytest.mark.parametrize(("change", "complaint"), COARSE_DAMAGES.values(), ids=COARSE_DAMAGES)
def test_what_is_wrong_in_a_coarse_one_is_said(change, complaint):
    document = unpacked(snapshot.encode(learnt(capacity=3), precision="8 bit")) | change
    with pytest.raises(SnapshotError, match=complaint):
        snapshot.decode(packed(document))


@pytest.mark.parametrize("precision", ["lossless", "12 bit"])
def test_what_is_missing_is_named(precision):
    document = unpacked(snapshot.encode(learnt(capacity=3), precision=precision))
    for name in document:
        with pytest.raises(SnapshotError, match=name):
            snapshot.decode(packed({key: value for key, value in document.items() if key != name}))


@pytest.mark.parametrize("name", COMPONENT)
def test_what_is_missing_of_a_component_is_named(name):
    document = unpacked(snapshot.encode(learnt(capacity=3)))
    del document["components"][0][name]
    with pytest.raises(SnapshotError, match=rf"components\[0\]: {name}"):
        snapshot.decode(packed(document))


def test_another_version_is_refused_with_what_to_do():
    document = unpacked(snapshot.encode(learnt(capacity=3))) | {"version": 2}
    with pytest.raises(SnapshotError, match=r"version: 2 is not 3, which .* update the older"):
        snapshot.decode(packed(document))


def test_a_model_too_large_to_be_read_is_not_written():
    kernel = KERNELS["static and moving"]
    m = 601
    model = FieldModel(
        kernel, 0.0, 1e-8, np.zeros((m, 2)), (np.eye(m), np.eye(m)), np.zeros(2 * m), np.eye(2 * m)
    )
    with pytest.raises(ValueError, match="at most 1200 coordinates of the state, not 1202"):
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
