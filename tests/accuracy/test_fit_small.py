"""Fits on the few readings that a boat has in its first hours, and of how fast a field moves: many seeds.

HALOCLINE_SEEDS: how many; without it a few.
"""

import math
import os

import numpy as np
import pytest
from moving import OrnsteinUhlenbeckField, Patrol
from scipy.optimize import brentq

from autonomy.config import EstimationSection
from autonomy.learning.choice import choose, readings_of
from autonomy.learning.fitting import fit
from autonomy.learning.history import History
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.structures import STRUCTURES

CANDIDATES = EstimationSection().candidates
SEEDS = int(os.environ.get("HALOCLINE_SEEDS", "5"))
SPAN = 1000.0


def course(rng, n):
    """A wandering track in the square: n places, each a thirtieth of its side from the last."""
    heading, place = rng.uniform(0, 2 * math.pi), rng.uniform(0.2 * SPAN, 0.8 * SPAN, 2)
    places = [place]
    while len(places) < n:
        heading += rng.normal(0, 0.3)
        ahead = place + SPAN / 30 * np.array([math.cos(heading), math.sin(heading)])
        if ((ahead > 0) & (ahead < SPAN)).all():
            place = ahead
            places.append(place)
        else:
            heading += 0.5
    return np.array(places)


def reach(kernel):
    """The distance at which the field's correlation is exp(−1/2): the length-scale, if it is squared-exponential."""

    def excess(distance):
        away = np.array([[distance, 0.0]])
        return kernel.covariance(np.zeros((1, 2)), away)[0, 0] / kernel.signal_variance - math.exp(-0.5)

    return brentq(excess, 1e-3, 1e7)


def still_errors(share, n, candidates, seeds):
    """log(found/true length-scale), and whether anything was believed to move, for each seed."""
    truth = Kernel((Component(1.0, SquaredExponential((SPAN * share,) * 2)),), 0.01)
    errors, moved = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        x = course(rng, n)
        K = truth.covariance(x, x) + truth.noise_variance * np.eye(n)
        y = 33.0 + np.linalg.cholesky(K) @ rng.normal(size=n)
        found = choose(Readings.of(x, y, None, 50.0 * np.arange(n), "gls"), candidates, SPAN).fit.kernel
        errors.append(math.log(reach(found) / (SPAN * share)))
        moved.append(not found.is_static)
    return np.array(errors), np.array(moved)


@pytest.mark.parametrize("candidates", [["squared_exponential"], CANDIDATES], ids=["one", "all"])
@pytest.mark.parametrize("share", [1 / 30, 1 / 10, 1 / 3])
@pytest.mark.parametrize("n", [10, 20, 30])
def test_lengthscales_from_a_short_track(n, share, candidates, capsys):
    errors, moved = still_errors(share, n, candidates, SEEDS)
    with capsys.disabled():
        median, worst = float(np.median(np.abs(errors))), float(np.abs(errors).max())
        print(
            f"\n  {n} points, l = extent × {share:.3f}: median |log l error| {median:.2f}, worst {worst:.2f}",
            end="",
        )
    assert worst < math.log(10)
    assert n < 30 or median < 0.7
    assert not moved.any()


def patrolled(seed, timescale_s):
    """Cells of 4000 readings, one a second, of an OU field on a random patrol."""
    truth = OrnsteinUhlenbeckField(np.random.default_rng([seed, 0]), SPAN, 0.15 * SPAN, timescale_s)
    rng = np.random.default_rng([seed, 1])
    patrol, history = Patrol(rng, SPAN), History(SPAN)
    for begin in range(0, 4000, 10):
        # Ten readings of one field: in ten seconds it changes by less than the noise.
        places = np.array([patrol.step(0.01 * SPAN) for _ in range(10)])
        values = truth.value(places) + 0.1 * rng.normal(size=10)
        for i in range(10):
            history.add(places[i], float(values[i]), float(begin + i))
        truth.advance(10.0)
    return readings_of(history.cells(), 300, np.random.default_rng([seed, 2]))


def test_how_fast_a_field_moves_is_found(capsys):
    found = [
        fit(patrolled(seed, 2000.0), STRUCTURES["ou"], SPAN).kernel.components[0].time.timescale_s
        for seed in range(min(SEEDS, 10))
    ]
    with capsys.disabled():
        print(f"\n  τ = 2000 s found as {np.sort(found).round()}", end="")
    assert min(found) >= 1000
    assert max(found) <= 4000


def test_a_still_field_is_left_still(capsys):
    still = [
        choose(patrolled(seed, math.inf), CANDIDATES, SPAN).fit.kernel.is_static
        for seed in range(min(SEEDS, 10))
    ]
    with capsys.disabled():
        print(f"\n  still in {sum(still)} of {len(still)} seeds", end="")
    assert all(still)
