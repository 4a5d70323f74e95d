"""Rocks that touch in a point: no tolerance opens a way between them."""

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.planning.passage import Passage
from autonomy.planning.pinches import pinches
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)
ROCKS = shapely.union_all([box(300, 500, 500, 700), box(500, 300, 700, 500)])


def area(land, **given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, 1000, 1000), land=land, **given)


@pytest.mark.parametrize("passage_cells", [20, 33, 200])
def test_nothing_is_squeezed_through_a_diagonal_gap_that_can_be_rounded(passage_cells):
    """The straight line goes exactly through the point where the rocks touch, and touches nothing else."""
    survey = area(ROCKS, passage_cells=passage_cells)
    assert not survey.leg_is_clear((400, 400), (600, 600))
    way = Passage(survey).path((400, 400), (600, 600))
    # The shortest way round bends at three corners of one rock: two diagonals of 100 m, two sides of 200 m.
    shortest = 2 * np.hypot(100, 100) + 400
    assert shortest <= path_length_m(way) <= 1.01 * shortest
    assert survey.legs_are_clear(way[:-1], way[1:]).all()


def test_a_corner_that_touches_an_edge_is_closed_too():
    wedge = shapely.Polygon([(500, 500), (600, 900), (400, 900)])
    survey = area(shapely.union_all([wedge, box(200, 300, 800, 500)]))
    assert not survey.leg_is_clear((495, 600), (520, 400))
    assert not survey.leg_is_clear((450, 500.0), (550, 500.0))
    assert survey.leg_is_clear((210, 500.0), (480, 500.0))


def test_a_shore_of_many_short_edges_has_no_pinch():
    round_island = shapely.Point(500, 500).buffer(0.05, quad_segs=64)
    assert len(shapely.get_coordinates(round_island)) > 200
    assert len(pinches(area(round_island).navigable, 2e-3)) == 0
    assert len(pinches(area(ROCKS).navigable, 2e-3)) >= 1
    assert pinches(shapely.Polygon(), 2e-3).shape == (0, 2)
