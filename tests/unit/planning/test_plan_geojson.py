"""A plan on a chart: GeoJSON as RFC 7946 has it."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from autonomy.geometry import LocalFrame
from autonomy.planning.plan import Plan
from autonomy.planning.plan_geojson import plan_geojson

CORNERS = np.array([(1000.0, 0.0), (1000.0, 1000.0), (-2000.0, 1000.0)])


def made(frame=LocalFrame(33.5, -118.5), corners=CORNERS, **fields):  # noqa: B008 -- a frozen value
    is_spot = np.arange(len(corners)) != 1
    plan = Plan(
        np.zeros(2), corners, is_spot, **{"mutual_information": 1.5, "planner": "p", "reason": "r", **fields}
    )
    # Through the text, as whoever reads it will get it.
    return json.loads(json.dumps(plan_geojson(plan, frame, {"energy_wh": None}), allow_nan=False))


def test_the_route_is_a_line_and_the_spots_are_points():
    collection = made(seed=3, rejected=(("lawnmower", 0.5),), home_corners=1)
    assert collection["type"] == "FeatureCollection"
    assert "crs" not in collection
    route, *spots = collection["features"]
    assert {feature["type"] for feature in collection["features"]} == {"Feature"}
    line = shapely.geometry.shape(route["geometry"])
    assert line.geom_type == "LineString"
    frame = LocalFrame(33.5, -118.5)
    lon, lat = np.transpose(line.coords)
    np.testing.assert_allclose(frame.to_local(lat, lon), [(0, 0), *CORNERS], atol=0.02)
    assert [feature["geometry"]["coordinates"] for feature in spots] == [
        list(line.coords[1]),
        list(line.coords[3]),
    ]
    assert [feature["properties"]["along_km"] for feature in spots] == [1.0, 5.0]
    told = route["properties"]
    assert (told["length_km"], told["spots"], told["home_corners"], told["seed"]) == (5.0, 2, 1, 3)
    assert told["rejected"] == [["lawnmower", 0.5]]
    assert told["mutual_information"] == 1.5


@pytest.mark.parametrize("nats", [math.nan, 0.0])
def test_numbers_that_are_not_known_are_null(nats):
    told = made(mutual_information=nats, objective_after=math.inf, rejected=(("a", math.nan),))["features"][
        0
    ]["properties"]
    assert told["mutual_information"] is None
    assert told["objective_after"] is None
    assert told["rejected"] == [["a", None]]
    assert told["energy_wh"] is None


@pytest.mark.parametrize("origin_lon_deg", [180.0, -180.0, 179.995])
def test_a_route_across_the_antimeridian_is_cut_there(origin_lon_deg):
    frame = LocalFrame(-17.0, origin_lon_deg)
    route, *spots = made(frame, np.array([(1000.0, 300.0), (-1500.0, 300.0), (1200.0, 0.0)]))["features"]
    assert route["geometry"]["type"] == "MultiLineString"
    parts = route["geometry"]["coordinates"]
    for part in parts:
        assert len(part) >= 2
        lons = [lon for lon, _ in part]
        assert max(map(abs, lons)) <= 180.0
        assert max(lons) - min(lons) < 1.0
    for before, after in pairwise(parts):
        assert abs(before[-1][0]) == abs(after[0][0]) == 180.0
        assert before[-1][1] == after[0][1]
    # No metre is lost by the cuts.
    whole = sum(
        np.hypot(*np.diff(frame.to_local(*np.transpose([(lat, lon) for lon, lat in part])), axis=0).T).sum()
        for part in parts
    )
    assert whole == pytest.approx(np.hypot(1000, 300) + 2500 + np.hypot(2700, 300), abs=0.5)
    assert all(abs(spot["geometry"]["coordinates"][0]) <= 180.0 for spot in spots)
