"""Speed of whole routes: against the dense algebra that a search without low-rank updates would do at every move."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Hyperparameters
from autonomy.planning.planners import route
from autonomy.planning.request import PlanRequest
from autonomy.planning.water_lattice import water_lattice_of
from autonomy.planning.weighted_variance import WeightedVariance, conditioned, planning_covariance

sys.path.insert(0, str(Path(__file__).parent))
from waters import archipelago


@pytest.fixture(scope="module")
def islands():
    return archipelago(8)


@pytest.fixture(scope="module")
def dense(islands):
    """The weighted variance of some route from scratch: a Cholesky factor and two products of 690 × 690."""
    lattice = water_lattice_of(islands)
    K = planning_covariance(lattice.points_m / lattice.side_m)
    precision = np.full(len(lattice), 20.0)
    weights = np.full(len(lattice), 1.0 / len(lattice))
    return lambda: WeightedVariance(conditioned(K, precision), weights)


def test_the_lattice(report, seconds, islands, dense):
    spent = seconds(lambda: water_lattice_of.__wrapped__(islands), 3)
    report("690 cells and their legs", spent, "one dense objective", seconds(dense, 3))


@pytest.mark.parametrize("length", [3, 10])
def test_a_route(length, report, seconds, islands, dense):
    side_m = water_lattice_of(islands).side_m
    model = FieldModel.prior(Hyperparameters(1.0, 0.01, (2000.0, 2000.0)))
    start_m = islands.candidate_sites(12, 12)[0]
    request = PlanRequest(model, start_m, 20, (12, 12), "benchmark", budget_m=length * side_m)
    made = route.plan(request, islands)
    again = replace(request, remainder_m=made.route_m, seed=1)
    reference = seconds(dense, 3)
    first = seconds(lambda: route.plan(request, islands), 2)
    report(f"first route, {length} √area, from lawnmowers", first, "one dense objective", reference)
    better = 1.0 - route.plan(again, islands).objective_after / made.objective_after
    spent = seconds(lambda: route.plan(again, islands), 3)
    note = f"{better:.1%} better once more"
    report(f"route from its remainder, {length} √area", spent, "one dense objective", reference, note)


def test_one_move(report, seconds, dense):
    objective = dense()
    cells = np.arange(12)
    precisions = np.linspace(-10.0, 100.0, 12)
    many, each = np.tile(cells, (256, 1)), np.tile(precisions, (256, 1))
    reference = seconds(dense, 3)
    looked = seconds(lambda: objective.changes(many, each), 5) / 256
    report("a move looked at", looked, "one dense objective", reference)

    def made():
        objective.add(cells, precisions)
        objective.add(cells, -precisions)

    report("a move made", seconds(made, 5) / 2, "one dense objective", reference)
