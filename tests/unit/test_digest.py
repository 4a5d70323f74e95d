import contextlib
import dataclasses
import itertools
import math
import struct
import zlib

import numpy as np
import pytest
from scipy import ndimage

from autonomy import digest
from autonomy.coarse_map import CoarseMap, CoarseMapError, decoded
from autonomy.digest import MAXIMUM_BYTES, STATES, Digest, DigestError, charted, decode, encode, thinned_route
from autonomy.digest_parts import SPACES, TIMES
from autonomy.geometry import LocalFrame
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import SPATIAL, Matern32, SquaredExponential
from autonomy.learning.temporal import TEMPORAL, MaternMotion, OrnsteinUhlenbeck
from autonomy.situation import State

FRAME = LocalFrame(34.4, -120.5)
BOUNDS = (34.3, -120.6, 34.5, -120.4)
KERNEL = Kernel(
    (
        Component(1.5, SquaredExponential((4000.0, 5000.0))),
        Component(0.3, Matern32((1500.0, 1500.0)), OrnsteinUhlenbeck(3600.0)),
        Component(0.1, Matern32((900.0, 900.0)), MaternMotion(7200.0)),
    ),
    0.02,
)


def learnt():
    gp = SparseOnlineGP(KERNEL, 60, prior_mean=33.5)
    for x, y in np.random.default_rng(0).uniform(-9000, 9000, (300, 2)):
        gp.update((x, y), 33.5 + np.sin(x / 3000) * np.cos(y / 4000))
    return gp.model()


def waves(rows=40, columns=26):
    """A field with detail at all scales, somewhere near 33."""
    noise = np.random.default_rng(1).normal(size=(rows, columns))
    return 33.0 + 5.0 * ndimage.gaussian_filter(noise, 4.0) + ndimage.gaussian_filter(noise, 1.5)


def full(**changes):
    coarse, mean_sd = charted(learnt(), FRAME, BOUNDS)
    values = {
        "vehicle": "boat1",
        "utc_s": 1_790_000_000,
        "lat_deg": 34.41234567,
        "lon_deg": -120.51234567,
        "heading_deg": 87.3,
        "groundspeed_mps": 1.53,
        "state": "exploring",
        "mode": "AUTO",
        "armed": True,
        "link_ok": True,
        "fault": False,
        "battery": 0.83,
        "range_m": 12_345.0,
        "distance_m": 34_567.4,
        "samples": 1234,
        "basis_size": 60,
        "rho": 0.25,
        "plans": 7,
        "units": "1e-3",
        "kernel": KERNEL,
        "prior_mean": 33.5,
        "route_deg": tuple((34.35 + 0.01 * i, -120.55 + 0.013 * i) for i in range(8)),
        "bounds_deg": BOUNDS,
        "mean_sd": mean_sd,
        "coarse": coarse,
    }
    return Digest(**(values | changes))


def test_all_comes_back_to_the_resolution_that_is_promised():
    one = full()
    data = encode(one)
    assert len(data) <= MAXIMUM_BYTES
    two = decode(data)
    same = (
        "vehicle",
        "utc_s",
        "state",
        "mode",
        "armed",
        "link_ok",
        "fault",
        "samples",
        "basis_size",
        "plans",
        "units",
    )
    assert {name: getattr(two, name) for name in same} == {name: getattr(one, name) for name in same}
    limits = {
        "lat_deg": 5e-8,
        "lon_deg": 5e-8,
        "heading_deg": 0.71,
        "groundspeed_mps": 0.05,
        "battery": 0.005,
    }
    limits |= {
        "range_m": 50.0,
        "distance_m": 0.5,
        "rho": 0.0025,
        "prior_mean": 1e-5,
        "mean_sd": 1e-3 * one.mean_sd,
    }
    for name, limit in limits.items():
        assert getattr(two, name) == pytest.approx(getattr(one, name), abs=limit * 1.0001), name
    np.testing.assert_allclose(two.route_deg, one.route_deg, atol=3e-6)
    np.testing.assert_allclose(two.bounds_deg, one.bounds_deg, atol=1e-5)
    for mine, theirs in zip(one.kernel.components, two.kernel.components, strict=True):
        assert (mine.space.name, mine.time.name) == (theirs.space.name, theirs.time.name)
        assert theirs.variance == pytest.approx(mine.variance, rel=1e-3)
        assert theirs.space.lengthscales_m == pytest.approx(mine.space.lengthscales_m, rel=1e-3)
        assert theirs.time.timescale_s == pytest.approx(mine.time.timescale_s, rel=1e-3)
    assert two.kernel.noise_variance == pytest.approx(0.02, rel=1e-3)


def test_the_map_is_that_of_the_model_within_a_percent_of_its_range():
    model, two = learnt(), decode(encode(full()))
    south, west, north, east = BOUNDS
    lat = south + (north - south) * (np.arange(50) + 0.5) / 50
    lon = west + (east - west) * (np.arange(45) + 0.5) / 45
    lons, lats = np.meshgrid(lon, lat)
    truth = model.predict(FRAME.to_local(lats.ravel(), lons.ravel())).mean.reshape(50, 45)
    error = two.map(50, 45) - truth
    assert np.sqrt((error**2).mean()) < 0.01 * np.ptp(truth)
    assert np.abs(error).max() < 0.05 * np.ptp(truth)


def test_what_is_not_known_stays_unknown():
    one = Digest("boat1")
    two = decode(encode(one))
    for each in dataclasses.fields(Digest):
        assert getattr(two, each.name) == getattr(one, each.name), each.name
    with pytest.raises(ValueError, match="no map: the vehicle had no model yet"):
        two.map(10, 10)


def test_what_is_too_large_is_cut():
    one = full(
        vehicle="a-vehicle-of-a-very-long-name",
        mode="ÜÜÜÜÜÜÜÜ",
        units="mol m-3 s-1 and so on",
        groundspeed_mps=99.0,
        range_m=1e9,
        samples=2**40,
        basis_size=10**6,
        rho=3.0,
        route_deg=tuple((34.3 + 0.001 * i, -120.5) for i in range(50)),
    )
    data = encode(one)
    assert len(data) <= MAXIMUM_BYTES
    two = decode(data)
    assert two.vehicle == "a-vehicle-of-a-v"
    assert two.mode == "ÜÜÜÜÜ"
    assert two.units == "mol m-3 s-"
    assert two.groundspeed_mps == 25.4
    assert two.range_m == 6_553_400.0
    assert two.samples == 2**32 - 2
    assert len(two.route_deg) == digest.MAXIMUM_CORNERS
    assert two.route_deg[-1][0] == pytest.approx(one.route_deg[-1][0], abs=1e-5)
    assert two.coarse is not None


def test_a_kernel_of_more_components_keeps_the_strongest():
    many = tuple(Component(variance, Matern32((100.0, 100.0))) for variance in (0.1, 5.0, 3.0, 0.2, 4.0, 6.0))
    kernel = decode(encode(Digest("boat1", kernel=Kernel(many, 0.01)))).kernel
    assert [round(one.variance) for one in kernel.components] == [5, 3, 4, 6]


def test_the_names_are_those_of_the_service():
    assert tuple(state.value for state in State) == STATES
    assert set(SPACES) == set(SPATIAL)
    assert set(TIMES) == set(TEMPORAL)


def test_a_route_is_thinned_from_its_far_end():
    route = [(float(i), 0.0) for i in range(30)]
    thin = [round(lat) for lat, _ in thinned_route(route)]
    assert thin[:4] == [0, 1, 2, 3]
    assert thin[-1] == 29
    assert len(thin) == 8
    assert thinned_route(route[:8]) == tuple(route[:8])


def test_a_route_over_the_date_line_comes_back():
    route = ((-17.0, 179.99), (-17.01, -179.98), (-17.0, -179.99))
    two = decode(encode(Digest("boat1", lat_deg=-17.0, lon_deg=190.0, route_deg=route)))
    np.testing.assert_allclose(two.route_deg, route, atol=1e-6)
    assert two.lon_deg == -170.0


@pytest.mark.parametrize(
    "changes",
    [{"lat_deg": 91.0}, {"lon_deg": math.nan}, {"rho": math.nan}, {"bounds_deg": (1.0, 0.0, 0.0, 1.0)}],
)
def test_what_has_no_bytes_is_an_error(changes):
    with pytest.raises(ValueError, match=r"position|NaN|map from"):
        encode(full(**changes))


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"prior_mean": 1e39}, "prior mean of 1e\\+39"),
        ({"prior_mean": math.nan}, "prior mean of nan"),
        ({"coarse": CoarseMap.of(np.full((8, 8), 1e39))}, "no digest of this: .*too large"),
        ({"kernel": Kernel((Component(1.0, Matern32((1.0,))),), 0.1)}, "no digest of this: .*4 items"),
    ],
)
def test_what_no_bytes_hold_is_a_digest_error(changes, complaint):
    with pytest.raises(DigestError, match=complaint):
        encode(full(**changes))


def sealed(body):
    return body + struct.pack("<I", zlib.crc32(body))


def test_damage_is_seen():
    data = encode(full())
    for i in range(len(data)):
        damaged = bytearray(data)
        damaged[i] ^= 1 << (i % 8)
        with pytest.raises(DigestError):
            decode(bytes(damaged))
        with pytest.raises(DigestError):
            decode(data[:i])
        with contextlib.suppress(DigestError):
            # Without its map it is a whole digest again.
            assert decode(sealed(data[: min(i, len(data) - 5)])).coarse is None


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        (b"\x02" + bytes(60), "version 2 is not 1"),
        (b"\x01" + bytes(400), "at most 340"),
        (b"\x01", "ends"),
    ],
)
def test_what_is_wrong_is_said(body, complaint):
    with pytest.raises(DigestError, match=complaint):
        decode(sealed(body))


def test_a_map_gets_better_with_room():
    truth = waves()
    errors = []
    for room in (30, 60, 120, 240, 480):
        data = CoarseMap.of(truth).encoded(room)
        assert len(data) <= room
        errors.append(float(np.abs(decoded(data).at(*truth.shape) - truth).std()))
    assert all(after < before for before, after in itertools.pairwise(errors))
    assert errors[-1] < 0.2 * errors[0]


@pytest.mark.parametrize("shape", [(1, 1), (1, 30), (30, 1), (8, 128), (33, 31)])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_maps_of_all_shapes_and_scales_come_back(shape, scale):
    truth = scale * np.add.outer(np.sin(np.arange(shape[0]) / 9.0), np.cos(np.arange(shape[1]) / 11.0))
    map_ = decoded(CoarseMap.of(truth).encoded(200)).at(*shape)
    assert np.abs(map_ - truth).max() < 0.05 * scale


def test_the_series_agrees_with_the_transform_at_its_own_cells():
    truth = waves()
    np.testing.assert_allclose(CoarseMap.of(truth).at(*truth.shape), truth, atol=1e-12)


def test_a_flat_map_takes_next_to_nothing():
    data = CoarseMap.of(np.full((30, 30), 33.0)).encoded(200)
    assert len(data) <= 12
    np.testing.assert_allclose(decoded(data).at(5, 5), 33.0, rtol=1e-3)


def test_maps_that_are_none_are_refused():
    for values in (np.zeros((2, 2, 2)), np.zeros((0, 3)), np.zeros((129, 3)), np.full((3, 3), np.nan)):
        with pytest.raises(ValueError, match="map"):
            CoarseMap.of(values)
    with pytest.raises(ValueError, match="does not fit"):
        CoarseMap.of(1e20 * waves()).encoded(100)
    for head in (b"", bytes(4), bytes([3, 3, 9, 21]), bytes([3, 3, 9, 2]), bytes([3, 3, 9, 0])):
        for mean in (b"", bytes(4) + b"x", b"\x00\x00\xc0\x7f"):
            with pytest.raises(CoarseMapError):
                decoded(head + mean)
