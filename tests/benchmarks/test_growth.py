"""How the parts grow with what they are given: exponents, beside those of the work that they can't do without."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from autonomy.learning.snapshot import encode
from autonomy.planning.exchange import select_by_exchange
from autonomy.planning.information import precision
from autonomy.planning.passage import Passage
from autonomy.planning.selection import select_by_dynamic_programming, select_greedily
from autonomy.planning.tour import open_tour

sys.path.insert(0, str(Path(__file__).parent))
from references import KERNEL, SPAN_M, H, cholesky, passes, product, projecting, readings
from waters import archipelago, distances, full, lattice, nearest_neighbour

SIDES = (12, 18, 24, 36)
SPOTS = (5, 10, 20, 40)
CHOICES = {
    "dynamic programme": select_by_dynamic_programming,
    "greedy": select_greedily,
    "greedy and exchange": select_by_exchange,
}


def mapping(m, side):
    """A map of side² cells."""
    model, axis = full(KERNEL, m, SPAN_M).model(), np.linspace(0.0, SPAN_M, side)
    return lambda: model.predict_grid(axis, axis)


def test_a_reading(growth):
    growth("learn a reading", "basis vectors m", (100, 200, 400, 800), projecting, "dgemv + dger", passes, 5)


def test_a_map_with_its_cells(growth):
    cells = [side**2 for side in (100, 200, 400, 800)]
    growth(
        "map, m = 100",
        "cells",
        cells,
        lambda count: mapping(100, round(count**0.5)),
        "dgemm",
        lambda count: product(100, count),
    )


def test_a_map_with_its_basis(growth):
    growth(
        "map of 200 × 200",
        "basis vectors m",
        (50, 100, 200, 400),
        lambda m: mapping(m, 200),
        "dgemm",
        lambda m: product(m, 40_000),
    )


def test_a_likelihood(growth):
    def likelihood(n):
        sample = readings(n)
        return lambda: sample.marginal(H)

    growth("likelihood and gradient", "readings n", (100, 200, 400, 800), likelihood, "Cholesky", cholesky)


def inverting(sites):
    S = lattice(round(sites**0.5))
    return lambda: precision(S)


def choosing(name, sites, n):
    S, select = lattice(round(sites**0.5)), CHOICES[name]
    return lambda: select(S, n)


@pytest.mark.parametrize("name", CHOICES)
def test_a_choice_with_its_sites(growth, name):
    sites = [side**2 for side in SIDES]
    growth(f"{name}, 20 spots", "sites N", sites, lambda N: choosing(name, N, 20), "inverse", inverting, 2)


@pytest.mark.parametrize("name", CHOICES)
def test_a_choice_with_its_spots(growth, name):
    growth(
        f"{name}, 144 sites",
        "spots n",
        SPOTS,
        lambda n: choosing(name, 144, n),
        "inverse",
        lambda _: inverting(144),
    )


def test_a_tour(growth):
    def touring(n):
        D = distances(n)
        return lambda: open_tour(D, 0)

    def plainly(n):
        D = distances(n)
        return lambda: nearest_neighbour(D)

    growth("tour", "nodes", (12, 25, 50, 100), touring, "nearest neighbour", plainly)


def test_ways_over_water(growth):
    survey = archipelago(25)
    passage = Passage(survey)
    points = np.random.default_rng(1).uniform(0, 15_000, (200, 2))
    points = points[survey.is_navigable(points)]
    points = points[passage.reachable(points[0], points)]

    def alone(n):
        cells = passage.cells_of(points[:n])
        return lambda: dijkstra(passage.graph, indices=cells, return_predecessors=True)

    growth(
        "all ways among 25 islands",
        "spots n",
        SPOTS,
        lambda n: lambda: passage.ways(points[:n]),
        "Dijkstra from each",
        alone,
        2,
    )


def test_a_snapshot(growth):
    def encoding(m):
        model = full(KERNEL, m, SPAN_M).model()
        return lambda: encode(model, None, "16 bit")

    def pickling(m):
        model = full(KERNEL, m, SPAN_M).model()
        return lambda: pickle.dumps(model)

    growth("snapshot to bytes", "basis vectors m", (50, 100, 200, 400), encoding, "pickle", pickling)
