"""What a plan promises is what a dense Gaussian process says of the map after it."""

import dataclasses

import numpy as np
import pytest
import shapely

from autonomy.geometry import LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.planning.expectation import along_route, readings_along
from autonomy.planning.plan import Plan
from autonomy.planning.planners import PlanRequest, make_plan
from autonomy.planning.survey import SurveyArea

THETA = Hyperparameters(0.5, 0.02, (700.0, 500.0))
SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0, 0, 3000, 2000), passage_cells=20)
ROUTE = np.array([(2500.0, 300.0), (2500.0, 1500.0), (300.0, 1500.0)])


def learnt() -> tuple[FieldModel, np.ndarray]:
    """A model that has kept every reading, so that it is a dense process of them."""
    points = np.random.default_rng(3).uniform((0, 0), (3000, 2000), (15, 2))
    gp = SparseOnlineGP(THETA, 50, novelty=0.0)
    for point in points:
        gp.update(point, 0.1)
    return gp.model(), points


def squared_exponential(a, b):
    scaled = (a[:, None] - b[None]) / np.array(THETA.lengthscales_m)
    return THETA.signal_variance * np.exp(-0.5 * np.sum(scaled**2, axis=-1))


def plan_along(route) -> Plan:
    return Plan(np.array([300.0, 300.0]), route, np.ones(len(route), dtype=bool), 0.0, "test", "test")


@pytest.mark.parametrize("spacing_m", [60.0, 20.0, 700.0])
def test_it_is_what_a_dense_process_says(spacing_m):
    model, known = learnt()
    request = PlanRequest(model, np.array([300.0, 300.0]), 5, (9, 7), "test", sample_spacing_m=spacing_m)
    plan = plan_along(ROUTE)
    along = np.arange(spacing_m, plan.length_m + 1e-6, spacing_m)
    corners = np.vstack([plan.start_m, ROUTE])
    ends = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    readings = np.column_stack([np.interp(along, ends, corners[:, axis]) for axis in range(2)])
    everything, sites = np.vstack([known, readings]), SURVEY.candidate_sites(9, 7)
    gram = squared_exponential(everything, everything) + THETA.noise_variance * np.eye(len(everything))
    cross = squared_exponential(everything, sites)
    variance = THETA.signal_variance - np.sum(cross * np.linalg.solve(gram, cross), axis=0)
    # The readings need not lie at the same places to within a spacing, nor one by one.
    assert along_route(plan, request, SURVEY).rmse == pytest.approx(np.sqrt(variance.mean()), rel=0.02)


def test_a_longer_route_promises_more():
    model, _ = learnt()
    request = PlanRequest(model, np.array([300.0, 300.0]), 5, (9, 7), "test", sample_spacing_m=50.0)
    promised = [along_route(plan_along(ROUTE[:k]), request, SURVEY).rmse for k in (1, 2, 3)]
    assert promised[0] > promised[1] > promised[2] > 0.0


def test_readings_along_a_route_are_thinned_and_stand_for_others():
    points = np.array([(0.0, 0.0), (3000.0, 0.0)])
    places, each = readings_along(points, 10.0)
    assert (len(places), each) == (150, 2.0)
    places, each = readings_along(points, 100.0)
    assert (len(places), each) == (30, 1.0)
    np.testing.assert_allclose(places[-1], points[-1])
    assert readings_along(points, 0.0)[1] == 1.0
    assert len(readings_along(np.array([(0.0, 0.0), (5.0, 0.0)]), 100.0)[0]) == 1


def test_a_plan_says_what_it_came_from():
    model, _ = learnt()
    request = PlanRequest(model, np.array([300.0, 300.0]), 5, (6, 5), "test", seed=7, model_version=15)
    made = make_plan("paper", request, SURVEY)
    assert (made.seed, made.model_version) == (7, 15)
    assert 0.0 < made.expected_rmse < np.sqrt(THETA.signal_variance)
    unborn = make_plan("paper", dataclasses.replace(request, model_version=None), SURVEY)
    assert unborn.expected_rmse is None
