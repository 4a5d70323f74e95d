"""The parts that a survey is made of: each against the work that it can't do without, in the same run."""

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import dijkstra

from autonomy import jobs
from autonomy.learning.fitting import fit
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.likelihood import Readings
from autonomy.learning.rebuild import reestimate
from autonomy.learning.snapshot import decode, encode
from autonomy.learning.structures import STRUCTURES
from autonomy.mavlink.codec import Codec
from autonomy.planning.exchange import select_by_exchange
from autonomy.planning.information import precision
from autonomy.planning.passage import Passage
from autonomy.planning.selection import select_by_dynamic_programming, select_greedily
from autonomy.planning.tour import open_tour

sys.path.insert(0, str(Path(__file__).parent))
from references import KERNEL, SPAN_M, H, cholesky, passes, product, projecting, readings
from voyage_log import sailed
from waters import archipelago, distances, full, lattice, nearest_neighbour

X_AXIS, Y_AXIS = np.arange(351.0), np.arange(391.0)


@pytest.fixture(scope="module")
def voyages():
    """Ten minutes of a survey at 1 Hz; and 100 whose telemetry comes each 10 s."""
    return {speedup: sailed(600.0, speedup) for speedup in (1.0, 10.0)}


def test_a_reading(against):
    against("learn a reading, m = 100", projecting(100), "dgemv + dger of 100", passes(100), 20)


def test_a_map(against):
    model = full(KERNEL, 100, SPAN_M).model()
    against(
        "map of 351 × 391, mean and variance, m = 100",
        lambda: model.predict_grid(X_AXIS, Y_AXIS),
        "dgemm of the same flops",
        product(100, len(X_AXIS) * len(Y_AXIS)),
    )


def test_a_fit(against, monkeypatch):
    """The reference is a Cholesky of that size for every time that the likelihood was asked for."""
    sample, start = readings(300), Hyperparameters(0.5, 0.05, (15.0, 15.0)).kernel
    asked, marginal = [], Readings.marginal
    with monkeypatch.context() as counting:
        counting.setattr(
            Readings, "marginal", lambda self, kernel: asked.append(self.n) or marginal(self, kernel)
        )
        fit(sample, STRUCTURES["squared_exponential"], SPAN_M, start)
    factors = [cholesky(n) for n in asked]
    against(
        "fit of 300 readings",
        lambda: fit(sample, STRUCTURES["squared_exponential"], SPAN_M, start),
        f"{len(asked)} times Cholesky",
        lambda: [factor() for factor in factors],
    )


@pytest.mark.parametrize(
    ("name", "select"),
    [
        ("dynamic programme", select_by_dynamic_programming),
        ("greedy", select_greedily),
        ("greedy and exchange", select_by_exchange),
    ],
)
def test_a_choice_of_spots(against, name, select):
    S = lattice(12)
    note = f"I = {select(S, 20).mutual_information:.3f}"
    against(
        f"{name}, 20 of 12 × 12 sites", lambda: select(S, 20), "inverting S", lambda: precision(S), 7, note
    )


def test_a_tour(against):
    D = distances(21)
    against("tour of 21 nodes", lambda: open_tour(D, 0), "nearest neighbour", lambda: nearest_neighbour(D))


def test_ways_over_water(against):
    survey = archipelago(25)
    passage = Passage(survey)
    points = np.random.default_rng(1).uniform(0, 15_000, (60, 2))
    points = points[survey.is_navigable(points)]
    points = points[passage.reachable(points[0], points)][:21]
    cells = passage.cells_of(points)
    against(
        "all ways between 21 spots among 25 islands",
        lambda: passage.ways(points),
        "Dijkstra from each",
        lambda: dijkstra(passage.graph, indices=cells, return_predecessors=True),
        5,
    )


def test_a_reestimate(against, voyages):
    """Fits of all candidates, a new basis, and the history absorbed."""
    request = voyages[10.0].request.reestimate
    cells = request.cells
    sample = Readings.of(cells.points, cells.means, None, cells.times_s, "gls")
    against(
        f"re-estimate from {len(cells)} cells of readings",
        lambda: reestimate(request),
        "one likelihood and gradient",
        lambda: sample.marginal(H),
        3,
    )


@pytest.mark.parametrize("planner", ["spots", "paper", "route"])
def test_a_full_replan(against, voyages, planner):
    """What the worker does in a survey."""
    voyage = voyages[10.0]
    request = replace(voyage.request, planner=planner, plan=replace(voyage.request.plan, budget_m=60e3))
    assert jobs.explore(request, voyage.survey).problem is None
    against(
        f"re-estimate and plan by {planner}",
        lambda: jobs.explore(request, voyage.survey),
        "the re-estimate alone",
        lambda: reestimate(request.reestimate),
        3,
    )


def test_a_snapshot(against):
    model = full(KERNEL, 100, SPAN_M).model()
    data = encode(model, None, "16 bit")
    against(
        "snapshot to bytes and back, m = 100",
        lambda: decode(encode(model, None, "16 bit")),
        "pickle",
        lambda: pickle.loads(pickle.dumps(model)),
        7,
        f"{len(data)} bytes; pickle {len(pickle.dumps(model))}",
    )


def test_events(report, seconds, voyages):
    """In the core alone, learning included, beyond packing and parsing."""
    voyage = voyages[1.0]
    count = len(voyage.packets)
    codec = Codec(1, 191)
    parsing = seconds(lambda: [codec.decode(packet, "core") for packet in voyage.packets], 3) / count
    note = f"{count / voyage.core_s:.0f} a second; slowest {voyage.slowest_s * 1e3:.1f} ms"
    report("an event in the core", voyage.core_s / count, "parsing its message", parsing, note)


@pytest.mark.parametrize("speedup", [1.0, 10.0])
def test_simulated_time(report, voyages, speedup):
    """Core, vessel and every byte between them, plans made in the same process."""
    voyage = voyages[speedup]
    note = (
        f"{voyage.lasted_s / 86400 / (voyage.spent_s / 60):.2g} simulated days a minute, {voyage.plans} plans"
    )
    name = f"{voyage.lasted_s:.0f} s of a survey, telemetry each {speedup:g} s"
    report(name, voyage.spent_s, "on the water", voyage.lasted_s, note)
