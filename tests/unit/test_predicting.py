"""Requests for predictions: answered as the model itself would, or refused with what is wrong."""

import sys
from pathlib import Path

import cbor2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.geometry import LocalFrame
from autonomy.predicting import answer
from autonomy.wire import WireError

sys.path.insert(0, str(Path(__file__).parents[1] / "process"))
from shore_helpers import learnt_model, model_snapshot

MODEL, _ = learnt_model()
SNAPSHOT = model_snapshot(MODEL, 7)
FRAME = LocalFrame(SNAPSHOT.origin_lat_deg, SNAPSHOT.origin_lon_deg)
GRID = {"south": 34.41, "west": -120.49, "north": 34.46, "east": -120.40, "rows": 3, "columns": 4}


def float64(numbers) -> cbor2.CBORTag:
    return cbor2.CBORTag(86, np.asarray(numbers, dtype="<f8").tobytes())


def asked(most=20_000, snapshot=SNAPSHOT, **content):
    content = cbor2.loads(answer(cbor2.dumps({"v": 3, **content}), snapshot, most))
    arrays = {name: np.frombuffer(content[name].value, "<f8") for name in ("mean", "sd")}
    return {**content, **arrays}


def test_points_are_answered_as_the_model_does():
    points_m = np.array([[100.0, 200.0], [9000.0, 4000.0], [-500.0, 30_000.0]])
    said = asked(points_deg=float64(FRAME.to_geodetic(points_m)))
    expected = MODEL.predict(points_m)
    np.testing.assert_allclose(said["mean"], expected.mean, rtol=1e-9)
    np.testing.assert_allclose(said["sd"], np.sqrt(expected.variance), rtol=1e-7)
    assert (said["units"], said["sequence"], said["utc_s"]) == ("1", 7, SNAPSHOT.utc_s)


def test_a_grid_begins_in_the_north_west():
    said = asked(grid=GRID)
    lat, lon = np.linspace(34.46, 34.41, 3), np.linspace(-120.49, -120.40, 4)
    points = [(a, b) for a in lat for b in lon]
    np.testing.assert_allclose(said["mean"], asked(points_deg=float64(points))["mean"])


def test_a_moment_to_come_is_less_certain_and_never_before_the_model():
    later = asked(grid=GRID, at_s=SNAPSHOT.utc_s + 3600.0)
    assert later["utc_s"] == SNAPSHOT.utc_s + 3600.0
    np.testing.assert_array_equal(later["mean"], asked(grid=GRID)["mean"], "a field that stands still")
    for at_s in (SNAPSHOT.utc_s - 1.0, "now", True, float("nan"), 1e300):
        with pytest.raises(WireError, match="at_s: must be from the model's time"):
            asked(grid=GRID, at_s=at_s)


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ({}, "either points_deg or grid"),
        ({"grid": GRID, "points_deg": float64([0.0, 0.0])}, "either points_deg or grid"),
        ({"points_deg": [1.0, 2.0]}, "must be an array of float64, tag 86"),
        ({"points_deg": float64([])}, "must have 1 to 20000 times 2 float64"),
        ({"points_deg": float64([1.0])}, "must have 1 to 20000 times 2 float64"),
        ({"points_deg": float64([91.0, 0.0])}, "must be latitudes from -90 to 90"),
        ({"points_deg": float64([np.nan, 0.0])}, "must be latitudes from -90 to 90"),
        ({"points_deg": float64(np.zeros(40_002))}, "must have 1 to 20000 times 2 float64"),
        ({"grid": 3}, "must be a map of south, west"),
        ({"grid": {**GRID, "rows": 0}}, "rows and columns must be whole numbers"),
        ({"grid": {**GRID, "rows": 10**9}}, "at most 20000 points"),
        ({"grid": {**GRID, "south": 35.0}}, "south <= north"),
        ({"grid": {**GRID, "east": float("inf")}}, "must be numbers"),
        ({"grid": GRID, "v": 2}, "v: must be 3"),
    ],
)
def test_what_cannot_be_answered_is_refused(content, complaint):
    with pytest.raises(WireError, match=complaint):
        asked(**content)


def test_without_a_model_or_on_a_thin_link_it_says_so():
    with pytest.raises(WireError, match="no model yet"):
        asked(snapshot=None, grid=GRID)
    with pytest.raises(WireError, match=r"at most 10 points \(got 3 x 4\)"):
        asked(most=10, grid=GRID)


@given(st.binary(max_size=200))
def test_noise_is_refused(noise):
    with pytest.raises(WireError):
        answer(noise, SNAPSHOT)
