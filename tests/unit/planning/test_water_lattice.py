"""The water as cells and short legs: clear of land, in one piece, and their readings where they are."""

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.planning.survey import SurveyArea
from autonomy.planning.water_lattice import shore_distance, water_lattice_of


@pytest.fixture(scope="module")
def two_basins():
    """Two basins joined by a crooked channel much narrower than the lattice's cells."""
    wall = box(4800, 0, 5400, 10_000)
    channel = shapely.LineString([(4700, 5010), (4950, 5350), (5250, 4850), (5500, 5080)]).buffer(90)
    survey = SurveyArea.from_geometry(
        LocalFrame(33, -119), box(0, 0, 10_000, 10_000), land=wall.difference(channel)
    )
    return survey, water_lattice_of(survey)


def test_cells_are_about_690_wherever_the_water_is(two_basins):
    survey, lattice = two_basins
    assert 650 <= len(lattice) <= 730
    inside = shapely.contains_xy(survey.water, *lattice.points_m.T)
    assert inside.all()


def test_legs_are_short_and_clear_of_land(two_basins):
    survey, lattice = two_basins
    a, b = np.nonzero(np.triu(lattice.leg_number < lattice.no_leg, 1))
    length = lattice.leg_length_m[lattice.leg_number[a, b]]
    straight = np.hypot(*(lattice.points_m[b] - lattice.points_m[a]).T)
    is_bridge = length > straight * (1.0 + 1e-9)
    assert length[~is_bridge].max() <= 0.16 * lattice.side_m + 1e-6
    lines = shapely.linestrings(np.stack([lattice.points_m[a], lattice.points_m[b]], axis=1)[~is_bridge])
    assert shapely.length(shapely.intersection(lines, survey.obstacles)).max() < 1e-6
    assert np.count_nonzero(is_bridge) == 1


def test_a_channel_narrower_than_cells_joins_the_basins(two_basins):
    survey, lattice = two_basins
    west, east = lattice.cells_at([[1000.0, 5000.0], [9000.0, 5000.0]])
    way = lattice.path(int(west), int(east))
    corners = lattice.corners(way)
    assert shapely.LineString(corners).intersection(survey.obstacles).length < 0.02
    assert path_length_m(corners) == pytest.approx(lattice.distances_m(int(west))[east])
    np.testing.assert_allclose(lattice.corners(way[::-1]), corners[::-1])


def test_readings_are_counted_where_the_way_leads(two_basins):
    _, lattice = two_basins
    chain = lattice.path(*(int(c) for c in lattice.cells_at([[500.0, 500.0], [9500.0, 9500.0]])))
    corners = lattice.corners(chain)
    readings = lattice.readings(chain, 20.0)
    # All of the way is counted, and by the table of legs as along the polyline.
    assert readings.sum() == pytest.approx(path_length_m(corners) / 20.0)
    along = lattice.readings_along(corners, 20.0)
    assert np.abs(readings - along).sum() < 0.1 * readings.sum()
    # None is farther from the way than a cell's corner is from its middle.
    distance = shapely.distance(shapely.points(lattice.points_m[along > 0]), shapely.LineString(corners))
    assert distance.max() <= 0.75 * lattice.side_m / np.sqrt(len(lattice))


def test_the_shore_is_land(two_basins):
    survey, _ = two_basins
    side_m = np.sqrt(survey.area_m2)
    found = shore_distance(survey, np.array([[4700.0, 1000.0], [300.0, 1000.0]]))
    np.testing.assert_allclose(found, [100.0 / side_m, 4500.0 / side_m])
    open_sea = SurveyArea.from_geometry(LocalFrame(33, -119), box(0, 0, 1000, 1000))
    assert shore_distance(open_sea, np.array([[10.0, 10.0]]))[0] == 1.0
