"""Speed of ways over water, part by part: ratios in the same run."""

import numpy as np
import pytest
import shapely
from scipy.sparse.csgraph import dijkstra
from shapely.geometry import box

from autonomy.geometry import LocalFrame
from autonomy.planning.passage import Passage
from autonomy.planning.raster import Raster
from autonomy.planning.shore_cells import with_shore_cells
from autonomy.planning.survey import SurveyArea
from autonomy.planning.taut import Shoreline


@pytest.fixture(scope="module")
def archipelago():
    """Sixty islands in 15 km, with a stand-off: some 4000 corners."""
    rng = np.random.default_rng(1)
    islands = [shapely.Point(*rng.uniform(0, 15_000, 2)).buffer(rng.uniform(50, 900), 64) for _ in range(60)]
    return SurveyArea.from_geometry(
        LocalFrame(33, -119), box(0, 0, 15_000, 15_000), land=shapely.union_all(islands), standoff_m=60.0
    )


def spots(survey, passage, count):
    points = np.random.default_rng(2).uniform(0, 15_000, (40 * count, 2))
    points = points[survey.is_navigable(points)]
    return points[passage.reachable(points[0], points)][:count]


def test_building_a_passage(report, seconds, archipelago):
    raster = Raster.of(archipelago)
    graph = raster.graph()
    alone = seconds(lambda: Raster.of(archipelago).graph(), 3)
    water = Shoreline(archipelago.navigable, 75.0).water
    corners = len(shapely.get_coordinates(water))
    spent = seconds(lambda: with_shore_cells(water, raster, graph), 3)
    added = len(with_shore_cells(water, raster, graph)[0]) - len(raster.centres_m)
    report(f"{added} points in cells at the shore", spent, "the raster and its graph", alone)
    spent = seconds(lambda: Shoreline(archipelago.navigable, 75.0), 3)
    report("corners that jut into the water", spent, "the raster and its graph", alone, f"{corners} corners")


def test_ways_between_spots(report, seconds, archipelago):
    passage = Passage(archipelago)
    points = spots(archipelago, passage, 30)
    cells = passage.cells_of(points)
    alone = seconds(lambda: dijkstra(passage.graph, indices=cells, return_predecessors=True), 3)
    ways = passage.ways(points)
    bent = [path for i in range(30) for j in range(i) if len(path := ways.path(i, j)) > 2]
    shore = Shoreline(archipelago.navigable, 75.0)
    spent = seconds(lambda: passage.ways(points), 3)
    report(
        "all ways between 30 points, pulled tight", spent, "Dijkstra alone", alone, f"{len(bent)} round land"
    )
    spent = seconds(lambda: [shore.tightened(path) for path in bent], 3)
    report("of which a last look at the tight ones", spent, "Dijkstra alone", alone)
    starts, ends = (np.concatenate([path[k : len(path) - 1 + k] for path in bent]) for k in (0, 1))
    spent = seconds(lambda: archipelago.legs_are_clear(starts, ends), 3)
    report(f"checking {len(starts)} legs against the polygons", spent, "Dijkstra alone", alone)
