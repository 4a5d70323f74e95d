"""Ways pulled tight against the shore."""

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.planning.passage import Passage
from autonomy.planning.survey import SurveyArea
from autonomy.planning.taut import Shoreline

SEA = box(0, 0, 1000, 1000)


def test_a_way_keeps_its_side_of_an_island_and_touches_its_corners():
    shore = Shoreline(SEA - box(450, 450, 550, 550), 5.0)
    for bend, corners in (((500, 900), [(450, 550), (550, 550)]), ((500, 100), [(450, 450), (550, 450)])):
        tight = shore.tightened(np.array([(100, 500), bend, (900, 500)], dtype=float))
        assert len(tight) == 4
        assert np.abs(tight[1:-1] - corners).max() < 0.1


def test_without_land_between_nothing_is_left_but_the_ends():
    shore = Shoreline(SEA - box(450, 450, 550, 550), 5.0)
    way = np.array([(100, 100), (200, 700), (300, 200), (400, 100)], dtype=float)
    assert shore.tightened(way).tolist() == [[100, 100], [400, 100]]
    assert shore.tightened(way[:2]).tolist() == way[:2].tolist()


def test_a_long_way_about_comes_back_round_all_islands_it_went_round():
    """Three islands in a row, passed north, south, north: the length is that of the polygon through their corners."""
    islands = [box(x, 400, x + 20, 600) for x in (250, 500, 750)]
    tight = Shoreline(SEA - shapely.union_all(islands), 5.0).tightened(
        np.array(
            [(100, 500), (260, 950), (380, 500), (510, 20), (630, 500), (760, 950), (900, 500)], dtype=float
        )
    )
    corners = [(100, 500), (250, 600), (270, 600), (500, 400), (520, 400), (750, 600), (770, 600), (900, 500)]
    assert path_length_m(tight) == pytest.approx(path_length_m(corners), rel=2e-3)


@pytest.mark.parametrize("standoff_m", [60.0, 150.0])
def test_an_arc_of_the_stand_off_becomes_a_few_legs(standoff_m):
    land = box(480, 0, 520, 700)
    survey = SurveyArea.from_geometry(
        LocalFrame(33.0, -119.0), SEA, land=land, standoff_m=standoff_m, passage_cells=50
    )
    arc = len(shapely.get_coordinates(survey.navigable))
    way = Passage(survey).path((100, 100), (900, 100))
    assert len(way) <= 10 < arc / 2
    line = LineString(way)
    assert line.distance(land) >= standoff_m - 1e-3
    assert line.length <= 1.01 * _round(standoff_m)


def _round(standoff_m):
    """The shortest way round two corners at a distance: tangents, arcs, and the stretch between them."""
    reach = np.hypot(380, 600)
    tangent = np.sqrt(reach**2 - standoff_m**2)
    # The way turns by half a circle about each corner, less what the tangents lean.
    lean = np.arctan2(600, 380) + np.arcsin(standoff_m / reach)
    return 2 * tangent + 2 * standoff_m * lean + 40
