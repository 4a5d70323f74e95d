"""No leg touches land: over random coasts with islands, spits and diagonal gaps, and over a real one.

The check shares nothing with the code under test: every leg is intersected with the land polygons themselves
and, where the land came from a mask, looked up in the mask.
"""

from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, box

from autonomy.geometry import LocalFrame
from autonomy.planning.passage import Passage, Ways
from autonomy.planning.raster import Raster
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)


def synthetic_coast(seed):
    """A wavy mainland, islands, a needle-thin spit, and chequered rocks that touch at their corners."""
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 10_000, 400)
    shore = 1200 + 600 * np.sin(x / 900 + seed) + 250 * np.sin(x / 170)
    mainland = shapely.Polygon([(0, -500), *zip(x, shore, strict=True), (10_000, -500)])
    islands = [shapely.Point(*rng.uniform(2500, 9500, 2)).buffer(rng.uniform(80, 900)) for _ in range(10)]
    a, b = rng.uniform(2000, 9800, (2, 2))
    spit = LineString([a, b]).buffer(rng.uniform(0.2, 5.0), cap_style="flat")
    corner, side = rng.uniform(2000, 8000, 2), rng.uniform(50, 400)
    rocks = [box(*(corner + side * k), *(corner + side * (k + 1))) for k in range(4)]
    return shapely.union_all([mainland, *islands, spit, *rocks])


def touching(ways: Ways, land) -> list[tuple[int, int]]:
    shapely.prepare(land)
    return [
        (i, j)
        for i in range(len(ways.points_m))
        for j in range(i)
        if np.isfinite(ways.distances_m[i, j]) and land.intersects(LineString(ways.path(i, j)))
    ]


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000), st.sampled_from([40, 73, 150]), st.sampled_from([0.0, 60.0]))
def test_no_leg_touches_land_on_a_synthetic_coast(seed, passage_cells, standoff_m):
    land = synthetic_coast(seed)
    area = SurveyArea.from_geometry(
        FRAME, box(0, 0, 10_000, 10_000), land=land, standoff_m=standoff_m, passage_cells=passage_cells
    )
    points = np.random.default_rng(seed).uniform(0, 10_000, (30, 2))
    points = points[area.is_navigable(points)][:14]
    ways = Passage(area).ways(points)
    assert touching(ways, land) == []
    if standoff_m:
        i, j = np.nonzero(np.isfinite(ways.distances_m) & (ways.distances_m > 0))
        routes = [LineString(ways.path(a, b)) for a, b in zip(i, j, strict=True)]
        assert shapely.distance(routes, land).min(initial=np.inf) >= standoff_m - 0.01


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 10_000))
def test_ways_are_as_long_back_as_there_and_no_shorter_than_the_straight_line(seed):
    area = SurveyArea.from_geometry(
        FRAME, box(0, 0, 10_000, 10_000), land=synthetic_coast(seed), passage_cells=60
    )
    points = np.random.default_rng(seed).uniform(0, 10_000, (20, 2))
    points = points[area.is_navigable(points)][:10]
    D = Passage(area).distances(points)
    straight = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    assert np.array_equal(D, D.T)
    assert np.all(straight - 1e-6 <= D)


@settings(deadline=None, max_examples=200)
@given(st.integers(0, 2**32 - 1))
def test_the_line_test_touches_every_cell_that_the_line_touches(seed):
    """Against exact rectangle intersection, on lines that start and end on borders and corners as well."""
    rng = np.random.default_rng(seed)
    passable = rng.random((9, 7)) > 0.15
    raster = Raster(np.linspace(-30, 60, 10), np.linspace(5, 75, 8), passable)
    ends = rng.uniform([-30, 5], [60, 75], (40, 2, 2))
    snapped = rng.random(ends.shape) < 0.4
    ends[snapped] = np.round(ends[snapped] / 5) * 5
    column, row = np.nonzero(~passable)
    x, y = raster.x_edges_m, raster.y_edges_m
    blocked = shapely.union_all(shapely.box(x[column], y[row], x[column + 1], y[row + 1]))
    clear = raster.lines_are_clear(ends[:, 0], ends[:, 1])
    touches = shapely.dwithin(shapely.linestrings(ends), blocked, 1e-7)
    inside = np.all((ends > [-30, 5]) & (ends < [60, 75]), axis=(1, 2))
    assert not np.any(clear & touches)
    assert np.all(clear[inside & ~touches])
    assert not np.any(clear[~inside])


@pytest.fixture(scope="module")
def bight(real_data_dir):
    """The Southern California Bight: land cells of 0.01° as polygons, exactly the mask."""
    data = np.load(real_data_dir / "scb_mask.npz")
    land, lat, lon = data["land"], data["lat"], data["lon"]
    dlat, dlon = np.diff(lat).mean(), np.diff(lon).mean()
    row, column = np.nonzero(land)
    squares = shapely.box(
        lon[column] - dlon / 2, lat[row] - dlat / 2, lon[column] + dlon / 2, lat[row] + dlat / 2
    )
    frame = LocalFrame(float(lat.mean()), float(lon.mean()))

    def to_metres(positions):
        return frame.to_local(positions[:, 1], positions[:, 0])

    # Squares are projected corner by corner and grown by a metre: neighbours overlap instead of touching.
    coast = shapely.union_all(shapely.buffer(shapely.transform(squares, to_metres), 1.0, join_style="mitre"))
    corners = shapely.box(lon[0], lat[0], lon[-1], lat[-1])
    area = shapely.transform(shapely.segmentize(corners, 0.02), to_metres)
    return frame, area, coast, (land, lat, lon)


@pytest.mark.parametrize("standoff_m", [0.0, 2000.0])
def test_no_leg_touches_land_in_the_bight(bight, standoff_m):
    frame, area, coast, (land, lat, lon) = bight
    survey = SurveyArea.from_geometry(frame, area, land=coast, standoff_m=standoff_m)
    passage = Passage(survey)
    sites = survey.candidate_sites(40, 40)
    sites = sites[passage.reachable(frame.to_local(33.0, -119.0), sites)]
    points = np.random.default_rng(1).choice(sites, 40, replace=False)
    ways = passage.ways(points)
    assert np.isfinite(ways.distances_m).all()
    assert touching(ways, coast) == []
    legs = [ways.path(i, j) for i in range(40) for j in range(i)]
    bent = sum(len(leg) > 2 for leg in legs)
    assert bent > 0.1 * len(legs)
    for leg in legs:
        along = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(leg)])
        latitude, longitude = frame.to_geodetic(along).T
        row = np.rint((latitude - lat[0]) / np.diff(lat).mean()).astype(int)
        column = np.rint((longitude - lon[0]) / np.diff(lon).mean()).astype(int)
        assert not land[row, column].any()
