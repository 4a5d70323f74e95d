"""Channels and bays narrower than the raster's cells."""

import numpy as np
import pytest
import shapely
from shapely.geometry import LineString, box

from autonomy.geometry import LocalFrame, path_length_m
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.planning.passage import Passage
from autonomy.planning.planners import PLANNERS
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea

FRAME = LocalFrame(33.0, -119.0)
SEA = box(0, 0, 1000, 1000)


def survey(land, **given):
    return SurveyArea.from_geometry(FRAME, SEA, land=land, **given)


@pytest.mark.parametrize("width_m", [60.0, 30.0, 12.0])
@pytest.mark.parametrize("west_m", [480.0, 493.0, 471.5])
def test_a_straight_channel_half_a_cell_wide_is_a_way(width_m, west_m):
    """Cells of 25 m; the raster alone closes every channel of less than 50 m."""
    land = box(0, 300, 1000, 700) - box(west_m, 300, west_m + width_m, 700)
    area = survey(land, passage_cells=40)
    way = Passage(area).path((400, 200), (600, 800))
    assert area.legs_are_clear(way[:-1], way[1:]).all()
    assert not LineString(way).intersects(land.buffer(-1e-3))
    # Two corners, bottom left and top right of the channel, on the line from end to end or as near as they let.
    corners = np.array([(400, 200), (west_m, 300), (west_m + width_m, 700), (600, 800)])
    assert path_length_m(way) <= 1.01 * path_length_m(corners)


def test_a_channel_with_a_bend_is_a_way_but_a_wall_as_thin_is_none():
    bent = LineString([(500, 300), (500, 480), (640, 560), (640, 700)]).buffer(9, cap_style="square")
    area = survey(box(0, 300, 1000, 700) - bent, passage_cells=40)
    way = Passage(area).path((400, 200), (600, 800))
    assert area.legs_are_clear(way[:-1], way[1:]).all()
    # A wall of 2 m across the channel, in the middle of it.
    closed = survey(shapely.union(box(0, 300, 1000, 700) - bent, box(480, 400, 520, 402)), passage_cells=40)
    assert not Passage(closed).reachable((400, 200), [(600, 800)]).any()


@pytest.mark.parametrize("seed", range(4))
def test_every_edge_of_the_graph_is_a_clear_leg(seed):
    rng = np.random.default_rng(seed)
    islands = [
        shapely.Point(p).buffer(r)
        for p, r in zip(rng.uniform(0, 1000, (25, 2)), rng.uniform(5, 120, 25), strict=True)
    ]
    land = shapely.union_all(islands)
    passage = Passage(survey(land, standoff_m=10.0, passage_cells=30))
    edges = passage.graph.tocoo()
    legs = shapely.linestrings(np.stack([passage.nodes_m[edges.row], passage.nodes_m[edges.col]], axis=1))
    assert shapely.distance(legs, land).min() >= 10.0 - 2e-3
    assert abs(passage.graph - passage.graph.T).max() == 0.0
    assert edges.data == pytest.approx(shapely.length(legs))


@pytest.mark.parametrize("name", ["lawnmower", "patrol", "paper", "spots"])
def test_every_planner_sails_water_beyond_a_channel_narrower_than_a_cell(name):
    land = box(0, 480, 1000, 520) - box(501, 480, 504, 520)
    area = survey(land, passage_cells=100)
    model = FieldModel.prior(Hyperparameters(1.0, 0.01, (150.0, 150.0)))
    request = PlanRequest(model, np.array([100.0, 100.0]), 10, (8, 8), "test", 0, budget_m=6000.0)
    route = PLANNERS[name](request, area).route_m
    assert (route[:, 1] > 520).any()
