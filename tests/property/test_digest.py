"""Whatever the vehicle knows fits 340 bytes and comes back; whatever arrives is a digest or refused."""

import math
import struct
import zlib

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.coarse_map import CoarseMap, CoarseMapError, decoded
from autonomy.digest import MAXIMUM_BYTES, STATES, Digest, DigestError, decode, encode
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static

sizes = st.floats(1e-6, 1e9)
places = st.tuples(st.floats(-90, 90), st.floats(-180, 180))
times = st.just(Static()) | st.builds(OrnsteinUhlenbeck, sizes) | st.builds(MaternMotion, sizes)
spaces = st.tuples(st.sampled_from([Matern32, SquaredExponential]), sizes, sizes).map(
    lambda it: it[0](it[1:])
)
kernels = st.builds(
    Kernel, st.lists(st.builds(Component, sizes, spaces, times), min_size=1, max_size=6).map(tuple), sizes
)
boxes = st.tuples(st.floats(-80, 80), st.floats(-180, 179), st.floats(0.01, 5), st.floats(0.01, 5)).map(
    lambda it: (it[0], it[1], it[0] + it[2], it[1] + it[3])
)


@st.composite
def maps(draw):
    rows, columns = draw(st.integers(1, 40)), draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    roughness = draw(st.floats(0, 3))
    frequency = np.add.outer(np.arange(rows), np.arange(columns)) + 1.0
    coefficients = rng.normal(size=(rows, columns)) / frequency**roughness
    return CoarseMap(draw(st.floats(1e-4, 1e4)) * coefficients)


def maybe(strategy):
    return st.none() | strategy


digests = st.builds(
    Digest,
    st.text(max_size=40),
    utc_s=maybe(st.integers(0, 2**32 - 2)),
    heading_deg=maybe(st.floats(0, 360)),
    groundspeed_mps=maybe(st.floats(0, 100)),
    state=st.sampled_from([*STATES, ""]),
    mode=st.text(max_size=20),
    armed=st.booleans(),
    link_ok=st.booleans(),
    fault=st.booleans(),
    battery=maybe(st.floats(0, 1)),
    range_m=maybe(st.floats(0, 1e7)),
    distance_m=st.floats(0, 1e8),
    samples=st.integers(0, 2**31),
    basis_size=st.integers(0, 300),
    rho=maybe(st.floats(0, 1)),
    plans=st.integers(0, 2**16 - 2),
    units=st.text(max_size=20),
    kernel=maybe(kernels),
    prior_mean=st.floats(-1e6, 1e6),
    route_deg=st.lists(places, max_size=30).map(tuple),
    bounds_deg=boxes,
    mean_sd=maybe(sizes),
    coarse=maps(),
)


@settings(max_examples=50, deadline=None)
@given(digests)
def test_whatever_is_known_fits_and_comes_back(told):
    data = encode(told)
    assert len(data) <= MAXIMUM_BYTES
    read = decode(data)
    assert told.vehicle.startswith(read.vehicle)
    assert (read.state, read.utc_s, read.samples) == (told.state, told.utc_s, told.samples)
    assert (read.armed, read.link_ok, read.fault) == (told.armed, told.link_ok, told.fault)
    assert (read.kernel is None) == (told.kernel is None)
    for name in ("battery", "rho", "range_m", "heading_deg", "groundspeed_mps", "mean_sd"):
        assert (getattr(read, name) is None) == (getattr(told, name) is None)
    if told.route_deg:
        assert abs(read.route_deg[0][0] - told.route_deg[0][0]) < 1e-6
    # No place is more wrong than the bounds' own float32, or the map than what it would be without details.
    truth = told.coarse.at(30, 30)
    assert np.abs(read.map(30, 30) - truth).std() <= truth.std() + 1e-6 * np.abs(truth).max()
    # And what has been read can be told again, as it is.
    assert decode(encode(read)).route_deg == read.route_deg


@given(st.binary(max_size=360))
def test_any_bytes(data):
    for content in (data, data + struct.pack("<I", zlib.crc32(data)), b"\x01" + data):
        try:
            read = decode(content)
        except DigestError:
            continue
        assert read.lat_deg is None or abs(read.lat_deg) <= 90


@settings(max_examples=200)
@given(
    st.integers(1, 128), st.integers(1, 128), st.integers(0, 255), st.integers(0, 20), st.binary(max_size=300)
)
def test_any_bytes_of_a_map(rows, columns, step, bands, rest):
    try:
        read = decoded(bytes([rows, columns, step, bands]) + struct.pack("<f", 3.0) + rest)
    except CoarseMapError:
        return
    assert read.coefficients.shape == (rows, columns)
    assert math.isfinite(float(read.at(3, 3).sum()))
