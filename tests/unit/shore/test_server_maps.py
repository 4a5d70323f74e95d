"""Maps against the model itself, asked cell by cell, and land against shapely."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.geometry import LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.spatial import Matern32, SquaredExponential
from autonomy.learning.transform import Log
from autonomy.shore.server import maps
from autonomy.shore.server.land import inside
from autonomy.shore.server.maps import Extent, bounds_deg, evaluate, is_outside, predict

sys.path.insert(0, str(Path(__file__).parents[2] / "process"))
from shore_helpers import field, model_snapshot

SMOOTH = Kernel((Component(0.5, SquaredExponential((1500.0, 1200.0))),), 1e-3)
TWO = Kernel(
    (
        Component(0.5, SquaredExponential((3000.0, 2500.0))),
        Component(0.1, SquaredExponential((900.0, 900.0))),
    ),
    1e-3,
)
ROUGH = Kernel((Component(0.5, Matern32((2500.0, 2200.0))),), 1e-3)


def learnt(kernel, transform=None):
    rng = np.random.default_rng(3)
    gp = SparseOnlineGP(kernel, 50, prior_mean=33.0)
    for point in np.cumsum(rng.normal(0, 400, (250, 2)), axis=0) % [12_000, 9_000]:
        gp.update(point, field(point) + rng.normal(0, 0.03))
    model = gp.model()
    return model_snapshot(model if transform is None else replace(model, transform=transform))


@pytest.fixture(scope="module")
def smooth():
    return learnt(SMOOTH)


def whole(snapshot, rows=90, columns=100):
    return Extent(*bounds_deg(snapshot), rows, columns)


def truth(snapshot, extent):
    """Mean and standard deviation by the model's own words, at the centre of every cell."""
    lat = extent.north - (np.arange(extent.rows) + 0.5) * (extent.north - extent.south) / extent.rows
    lon = extent.west + (np.arange(extent.columns) + 0.5) * (extent.east - extent.west) / extent.columns
    frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
    points = frame.to_local(*np.meshgrid(lat, lon, indexing="ij"))
    prediction = snapshot.model.predict(points.reshape(-1, 2))
    x_min, y_min, x_max, y_max = snapshot.bounds_m
    x, y = points[..., 0], points[..., 1]
    outside = (x < x_min) | (x > x_max) | (y < y_min) | (y > y_max)
    shape = extent.rows, extent.columns
    mean, sd = prediction.mean.reshape(shape), np.sqrt(prediction.variance).reshape(shape)
    return np.where(outside, np.nan, mean), np.where(outside, np.nan, sd)


def assert_true(snapshot, extent):
    made = evaluate(snapshot, extent)
    mean, sd = truth(snapshot, extent)
    assert (np.isnan(made.mean) == np.isnan(mean)).all()
    # Single precision of salinities around 33 is 4e-6; of the deviation a thousandth is more than anybody sees.
    np.testing.assert_allclose(made.mean, mean, rtol=0, atol=1e-5)
    np.testing.assert_allclose(made.sd, sd, rtol=1e-3)
    return made


@pytest.mark.parametrize("kernel", [SMOOTH, TWO, ROUGH], ids=["smooth", "two", "rough"])
def test_a_map_is_what_the_model_says_of_every_cell(kernel):
    snapshot = learnt(kernel)
    made = assert_true(snapshot, whole(snapshot))
    assert np.isfinite(made.mean).mean() > 0.95


def test_a_field_that_is_learnt_through_a_logarithm():
    prior = FieldModel.prior(Kernel((Component(0.04, SquaredExponential((3000.0, 3000.0))),), 1e-3), 3.0)
    snapshot = model_snapshot(replace(prior, transform=Log()))
    assert_true(snapshot, whole(snapshot, 12, 12))
    snapshot = learnt(SMOOTH, Log())
    made = evaluate(snapshot, whole(snapshot))
    mean, sd = truth(snapshot, whole(snapshot))
    np.testing.assert_allclose(made.mean, mean, rtol=1e-5)
    np.testing.assert_allclose(made.sd, sd, rtol=1e-3)


def test_smooth_maps_ask_the_model_for_few_places_only(smooth, monkeypatch):
    asked = []
    predict_all = FieldModel.predict
    monkeypatch.setattr(
        FieldModel, "predict", lambda self, points: asked.append(len(points)) or predict_all(self, points)
    )
    evaluate(smooth, whole(smooth, 351, 391))
    assert sum(asked) < 351 * 391 / 30


def test_where_few_places_do_not_do_all_are_asked(smooth, monkeypatch):
    monkeypatch.setattr(maps, "_counts", lambda *_: (9, 9))
    assert_true(smooth, whole(smooth))


@pytest.mark.parametrize("cells", [(1, 1), (1, 40), (40, 1), (2, 3)])
def test_maps_of_few_cells(smooth, cells):
    assert_true(smooth, whole(smooth, *cells))


@settings(max_examples=15)
@given(
    south=st.floats(34.3, 34.5),
    west=st.floats(-120.6, -120.3),
    height=st.floats(1e-4, 0.4),
    width=st.floats(1e-4, 0.4),
)
def test_any_window_shows_the_same_field(smooth, south, west, height, width):
    assert_true(smooth, Extent(south, west, south + height, west + width, 40, 37))


def test_elsewhere_there_is_nothing(smooth):
    made = evaluate(smooth, Extent(10.0, 10.0, 11.0, 11.0, 20, 20))
    assert np.isnan(made.mean).all()
    assert np.isnan(made.sd).all()


def test_land_is_left_out(smooth):
    extent = whole(smooth)
    land = np.zeros((extent.rows, extent.columns), dtype=bool)
    land[10:20, 30:50] = True
    bare, made = evaluate(smooth, extent), evaluate(smooth, extent, land)
    assert (np.isnan(made.mean) == (land | np.isnan(bare.mean))).all()
    assert (np.isnan(made.sd) == np.isnan(made.mean)).all()
    np.testing.assert_array_equal(made.mean[~land], bare.mean[~land])


def test_a_place_is_what_the_map_shows_there(smooth):
    extent = whole(smooth)
    made = evaluate(smooth, extent)
    mean, sd = predict(smooth, float(extent.latitudes[40]), float(extent.longitudes[60]))
    assert mean == pytest.approx(made.mean[40, 60], abs=1e-5)
    assert sd == pytest.approx(made.sd[40, 60], rel=1e-4)


def test_outside_is_where_the_map_has_no_value(smooth):
    south, west, north, east = bounds_deg(smooth)
    lat_deg, lon_deg = (north - south) / 5.0, (east - west) / 5.0
    extent = Extent(south - lat_deg, west - lon_deg, north + lat_deg, east + lon_deg, 14, 14)
    outside = [[is_outside(smooth, lat, lon) for lon in extent.longitudes] for lat in extent.latitudes]
    np.testing.assert_array_equal(outside, np.isnan(evaluate(smooth, extent).mean))
    assert is_outside(smooth, 0.0, 0.0)
    # On the other side of the earth.
    assert is_outside(smooth, -smooth.origin_lat_deg, smooth.origin_lon_deg + 180.0)


def ring_around(rng):
    """A ring that doesn't cross itself: corners in the order of their bearing."""
    count = int(rng.integers(3, 40))
    bearing, distance = np.sort(rng.uniform(0, 2 * np.pi, count)), rng.uniform(0.05, 0.5, count)
    return rng.uniform(0.2, 0.8, 2) + np.stack(
        [distance * np.cos(bearing), distance * np.sin(bearing)], axis=-1
    )


@given(seed=st.integers(0, 10**9), rows=st.integers(1, 40), columns=st.integers(1, 40))
def test_land_is_what_lies_in_an_odd_number_of_rings_as_shapely_says(seed, rows, columns):
    rng = np.random.default_rng(seed)
    rings = [ring_around(rng) for _ in range(3)]
    lat, lon = Extent(0.0, 0.0, 1.0, 1.0, rows, columns).latitudes, (np.arange(columns) + 0.5) / columns
    polygons = [shapely.make_valid(shapely.Polygon(ring[:, ::-1])) for ring in rings]
    x, y = np.meshgrid(lon, lat)
    expected = sum(shapely.contains_xy(polygon, x, y).astype(int) for polygon in polygons) % 2 == 1
    # A random place is never on a side, where the two might round differently.
    assert (inside([ring.tolist() for ring in rings], lat, lon) == expected).all()


def test_a_lake_on_an_island_is_water_and_islands_are_land():
    def square(low, high):
        return [(low, low), (low, high), (high, high), (high, low)]

    lat = lon = np.arange(10) + 0.5
    mask = inside([square(1, 6), square(2, 4), square(7, 9)], lat[::-1], lon)
    expected = np.zeros((10, 10), dtype=bool)
    expected[1:6, 1:6], expected[2:4, 2:4], expected[7:9, 7:9] = True, False, True
    assert (mask == expected[::-1]).all()


def test_without_rings_there_is_no_land():
    assert not inside([], np.arange(3.0), np.arange(4.0)).any()
