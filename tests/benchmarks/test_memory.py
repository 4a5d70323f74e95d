"""Speed of the memory and of rebuilding from it: ratios against plain passes and matrix products, in the same run."""

import time

import numpy as np
import pytest

from autonomy.learning.capacity import Budget
from autonomy.learning.history import History, HistoryCells
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.rebuild import Build
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck, Static

SPAN_M = 300.0


@pytest.mark.parametrize("maximum", [2000, 20_000])
def test_a_reading_counted_by_a_full_history(report, seconds, maximum):
    """What one costs that begins a cell, and so makes two others merge; and the worst of all of them."""
    # In time of this thread: what others do with the core is not its fault.
    rng, history, spent = np.random.default_rng(0), History(SPAN_M, maximum), []
    for i, place in enumerate(rng.uniform(0, SPAN_M, (3 * maximum, 2))):
        began = time.thread_time()
        history.add(place, 1.0, float(i))
        spent.append(time.thread_time() - began)
    full = spent[2 * maximum :]
    ages = rng.uniform(1.0, 2.0, maximum)

    def least():
        return int((ages / ages[::-1]).argmin())

    once = seconds(least, 7, 50)
    report(
        f"count a reading, {maximum} cells, full",
        float(np.median(full)),
        "a quotient and its least",
        once,
        f"worst {max(full) * 1e3:.2f} ms",
    )


def test_a_rebuild_of_moving_water(report, seconds):
    """2000 cells into 2 × 300 coordinates, one after the other."""
    rng, n = np.random.default_rng(1), 2000
    times = np.sort(rng.uniform(0, 20_000.0, n))
    cells = HistoryCells(rng.uniform(0, SPAN_M, (n, 2)), rng.normal(size=n), np.ones(n), times)
    space = SquaredExponential((20.0, 20.0))
    kernel = Kernel((Component(1.0, space, Static()), Component(0.5, space, OrnsteinUhlenbeck(2000.0))), 0.01)
    build = Build(SPAN_M**2, 300, Budget(), 300, 1e-3, 1e-8)
    spent = seconds(lambda: build.rebuilt(cells, kernel, 0.0, 20_000.0), 2)
    S, a = np.eye(600), rng.normal(size=600)
    passes = n * seconds(lambda: S - np.outer(a, S @ a), 5, 5)
    report("rebuild, 2000 cells, 2 × 300 coordinates", spent, "as many rank-one downdates", passes)
