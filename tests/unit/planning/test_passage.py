"""Ways over water: clear of land, short, and honest about what cannot be reached."""

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, Polygon, box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.planning.passage import Passage, Unreachable, passage_of
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)


def survey(land=None, size=(1000, 1000), **given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, *size), land=land, **given)


def length(passage, a, b):
    return path_length_m(passage.path(a, b))


def test_in_open_water_the_way_is_straight():
    path = Passage(survey()).path((13, 17), (871, 655))
    assert path.tolist() == [[13, 17], [871, 655]]


def test_a_way_to_the_same_place():
    passage = Passage(survey())
    assert length(passage, (500, 500), (500, 500)) == 0.0
    assert passage.distances([(500, 500), (500, 500)]).tolist() == [[0, 0], [0, 0]]


def test_staying_outside_navigable_water_is_no_way_at_all():
    passage = Passage(survey(box(400, 300, 600, 500), standoff_m=50.0))
    harbour = (500.0, 520.0)
    assert length(passage, harbour, harbour) == 0.0
    assert length(passage, (-60.0, 100.0), (-60.0, 100.0)) == 0.0


def test_a_way_to_the_edge_of_the_stand_off_keeps_to_the_water():
    """Clipping leaves such ends a hair outside; they are no harbours, which are left and made for straight."""
    area = survey(shapely.Point(500, 500).buffer(150.0), standoff_m=60.0, passage_cells=40)
    ends = shapely.get_coordinates(
        area.navigable.interiors[0].interpolate(np.linspace(0.0, 1.0, 23), normalized=True)
    )
    assert not shapely.covers(area.navigable, shapely.points(ends)).all()
    for end in ends:
        way = passage_of(area).path((30.0, 40.0), end)
        assert area.legs_are_clear(way[:-1], way[1:]).all()


def test_around_a_wall_the_way_is_nearly_the_shortest():
    wall = box(480, 0, 520, 800)
    passage = Passage(survey(wall, passage_cells=200))
    path = passage.path((100, 100), (900, 100))
    shortest = 2 * np.hypot(380, 700) + 40
    assert not LineString(path).intersects(wall)
    assert shortest <= path_length_m(path) <= 1.01 * shortest
    assert len(path) <= 6


def test_ways_are_the_same_in_both_directions():
    passage = Passage(survey(box(480, 0, 520, 800)))
    there, back = passage.path((100, 100), (900, 100)), passage.path((900, 100), (100, 100))
    assert path_length_m(there) == pytest.approx(path_length_m(back), rel=5e-3)
    assert there[0].tolist() == back[-1].tolist() == [100, 100]
    ways = passage.ways([(100, 100), (900, 100)])
    assert np.array_equal(ways.path(0, 1), ways.path(1, 0)[::-1])


def test_no_way_leads_through_a_diagonal_gap_of_no_width():
    """Two islands that touch at a corner: a line between cell centres would slip through."""
    land = shapely.union_all([box(0, 500, 500, 1000), box(500, 0, 1000, 500)])
    passage = Passage(survey(land, passage_cells=20))
    with pytest.raises(Unreachable):
        passage.path((100, 100), (900, 900))


def test_thin_land_between_the_samples_of_a_line_is_seen():
    spit = Polygon([(0, 500.0), (990, 500.0), (990, 500.5), (0, 500.5)])
    passage = Passage(survey(spit, size=(1100, 1000), passage_cells=110))
    path = passage.path((50, 480), (50, 520))
    assert not LineString(path).intersects(spit)
    assert path_length_m(path) > 1800


def test_other_basins_are_unreachable():
    passage = Passage(survey(box(450, 0, 550, 1000)))
    points = [(100, 100), (300, 900), (800, 500)]
    distances = passage.distances(points)
    assert np.isfinite(distances[0, 1])
    assert np.isinf(distances[:2, 2]).all()
    assert passage.reachable(points[0], points).tolist() == [True, True, False]
    with pytest.raises(Unreachable, match="800 m east, 500 m north"):
        passage.path(points[0], points[2])


def test_points_near_the_shore_are_joined_by_a_clear_leg():
    """With cells of 50 m, a point 1 m from the shore lies in a cell that is partly land."""
    land = box(0, 0, 1000, 233)
    area = survey(land, passage_cells=20)
    passage = Passage(area)
    path = passage.path((510, 234), (990, 990))
    assert path[0].tolist() == [510, 234]
    assert area.legs_are_clear(path[:-1], path[1:]).all()


def test_a_vessel_in_the_stand_off_comes_out_by_the_nearest_water():
    land = box(0, 0, 1000, 200)
    area = survey(land, standoff_m=60.0)
    path = Passage(area).path((500, 205), (900, 700))
    assert path[0].tolist() == [500, 205]
    assert path[1][1] < 275
    assert not LineString(path).intersects(land)
    assert area.legs_are_clear(path[1:-1], path[2:]).all()


def test_a_vessel_outside_the_area_comes_in():
    path = Passage(survey()).path((500, -40), (500, 700))
    assert path[0].tolist() == [500, -40]
    assert path[1][1] < 10


def test_a_vessel_on_land_or_with_land_in_its_way_reaches_nothing():
    land = shapely.union_all([box(0, 0, 1000, 200), box(-300, -300, 1300, 0)])
    passage = Passage(survey(land))
    for start in [(500, 100), (500, -400)]:
        assert not passage.reachable(start, [(500, 500)]).any()
        with pytest.raises(Unreachable):
            passage.path(start, (500, 500))


def test_a_fiftieth_of_a_cell_is_no_way_but_a_fifth_is():
    for width_m, there in ((1, False), (10, True)):
        area = survey(box(0, 0, 1000, 1000 - width_m), passage_cells=20)
        ends = [(10, 1000 - width_m / 2), (900, 1000 - width_m / 2)]
        assert Passage(area).reachable(ends[0], ends[1:]).tolist() == [there]


def test_distances_equal_the_lengths_of_the_ways():
    rng = np.random.default_rng(4)
    land = shapely.union_all([box(200, 200, 400, 900), box(600, 100, 800, 800)])
    area = survey(land)
    points = rng.uniform(0, 1000, (40, 2))
    points = points[area.is_navigable(points)][:12]
    ways = Passage(area).ways(points)
    for i in range(len(points)):
        for j in range(len(points)):
            assert ways.distances_m[i, j] == pytest.approx(path_length_m(ways.path(i, j)), abs=1e-9)
            assert ways.path(i, j)[0].tolist() == points[i].tolist()
            assert ways.path(i, j)[-1].tolist() == points[j].tolist()


def test_the_passage_of_a_survey_is_built_once():
    area = survey()
    assert passage_of(area) is passage_of(area)
    assert passage_of(area) is not passage_of(survey())


def test_ways_are_close_to_those_of_a_visibility_graph():
    """Independent truth: shortest paths over the corners of square islands, which need no raster."""
    from scipy.sparse.csgraph import dijkstra

    rng = np.random.default_rng(12)
    islands = [box(x, y, x + s, y + s) for x, y, s in rng.uniform([0, 0, 60], [900, 900, 200], (12, 3))]
    area = survey(shapely.union_all(islands), passage_cells=200)
    points = rng.uniform(0, 1000, (60, 2))
    points = points[area.is_navigable(points)][:10]
    nodes = np.concatenate([points, shapely.get_coordinates(area.navigable)])
    lengths = np.full((len(nodes), len(nodes)), np.inf)
    for k, node in enumerate(nodes):
        seen = area.legs_are_clear(node, nodes)
        lengths[k, seen] = np.hypot(*(nodes[seen] - node).T)
    shortest = dijkstra(lengths, indices=np.arange(len(points)))[:, : len(points)]
    ratio = (Passage(area).distances(points) / np.where(shortest > 0, shortest, np.inf))[shortest > 0]
    assert ratio.min() >= 1 - 1e-9
    assert ratio.mean() <= 1.01
    assert ratio.max() <= 1.06
