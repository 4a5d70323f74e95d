"""Local metres against the geodesic, and ways along polylines."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from autonomy.geometry import LocalFrame, advance_along, path_length_m

GEOD = Geod(ellps="WGS84")
near = st.floats(-20_000.0, 20_000.0)
routes = st.lists(st.tuples(near, near), min_size=1, max_size=8)


@given(st.floats(-80.0, 80.0), st.floats(-179.0, 179.0), near, near)
def test_there_and_back(lat_deg, lon_deg, x, y):
    frame = LocalFrame(lat_deg, lon_deg)
    back = frame.to_local(*frame.to_geodetic((x, y)))
    np.testing.assert_allclose(back, (x, y), atol=1e-4)


@given(st.floats(-80.0, 80.0), st.floats(-179.0, 179.0), near, near)
def test_distances_from_the_origin_are_the_geodesics(lat_deg, lon_deg, x, y):
    frame = LocalFrame(lat_deg, lon_deg)
    lat, lon = frame.to_geodetic((x, y))
    azimuth, _, distance = GEOD.inv(lon_deg, lat_deg, lon, lat)
    assert distance == pytest.approx(np.hypot(x, y), abs=1e-3)
    if distance > 1.0:
        assert np.sin(np.radians(azimuth)) * distance == pytest.approx(x, abs=1e-2)


def test_shapes_are_kept():
    frame = LocalFrame(33.0, -118.0)
    assert frame.to_local(np.full((3, 4), 33.1), np.full((3, 4), -118.1)).shape == (3, 4, 2)
    assert frame.to_geodetic(np.zeros((3, 4, 2))).shape == (3, 4, 2)
    assert frame.to_local(33.1, -118.1).shape == (2,)


def test_east_is_x_and_north_is_y():
    frame = LocalFrame(33.0, -118.0)
    assert frame.to_local(33.0, -117.99)[0] > 900.0
    assert frame.to_local(33.01, -118.0)[1] > 1100.0


def test_a_frame_goes_to_the_worker_and_back():
    frame = LocalFrame(33.0, -118.0)
    frame.to_local(33.1, -118.1)
    copy = pickle.loads(pickle.dumps(frame))
    assert copy == frame
    np.testing.assert_array_equal(copy.to_local(33.1, -118.1), frame.to_local(33.1, -118.1))


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg"), [(91.0, 0.0), (0.0, -181.0), (float("nan"), 0.0), (0.0, 361.0)]
)
def test_no_position_no_frame(lat_deg, lon_deg):
    with pytest.raises(ValueError, match="not a position"):
        LocalFrame(lat_deg, lon_deg)


@given(routes, st.floats(-100.0, 200_000.0))
def test_advancing_stays_on_the_way_and_goes_as_far_as_it_says(route, distance_m):
    points = np.array(route)
    there = advance_along(points, distance_m)
    wanted = min(max(0.0, distance_m), path_length_m(points))
    # Somewhere on the polyline, with that much of it behind.
    walked, best = 0.0, np.inf
    for a, b in pairwise(points):
        leg = np.hypot(*(b - a))
        part = np.clip(wanted - walked, 0.0, leg)
        best = min(best, np.hypot(*(a + (b - a) * (part / leg if leg else 0.0) - there)))
        walked += leg
    assert best < 1e-6 * max(1.0, walked) if len(points) > 1 else (there == points[0]).all()


def test_lengths():
    assert path_length_m([(0, 0), (3, 4), (3, 4), (3, 14)]) == pytest.approx(15.0)
    assert path_length_m([(1, 2)]) == 0.0
    np.testing.assert_allclose(advance_along([(0, 0), (0, 0), (10, 0)], 4.0), (4.0, 0.0))
    np.testing.assert_allclose(advance_along([(0, 0), (10, 0)], 40.0), (10.0, 0.0))
