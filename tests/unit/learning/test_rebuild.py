"""The worker's half of learning: which basis a rebuild takes, what a replay teaches, and what capacity it has."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest

from autonomy.config import EstimationSection
from autonomy.learning.basis import select_basis
from autonomy.learning.capacity import Budget, choose_capacity
from autonomy.learning.history import HistoryCells
from autonomy.learning.kernel import Component, Hyperparameters, Kernel
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import Build, reestimate
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static

SPAN = 1000.0
SHAPE = SquaredExponential((250.0, 250.0))
BUILD = Build(SPAN**2, 200, Budget(), 300, 1e-9, 1e-10)


def kernel(*times, noise=0.04):
    return Kernel(tuple(Component(1.0 / len(times), SHAPE, time) for time in times), noise)


def cells(n, seed=0, duration_s=1000.0):
    """Cells all over the square, read one after the other."""
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0, duration_s, n))
    counts = rng.integers(1, 6, n).astype(float)
    return HistoryCells(rng.uniform(0, SPAN, (n, 2)), 33.5 + rng.normal(size=n), counts, times)


def exact(field, told, prior_mean, points, time_s):
    """The dense space-time process on the cells, with noise σn²/n."""
    K = field.covariance(told.points, told.points, np.abs(np.subtract.outer(told.times_s, told.times_s)))
    K[np.diag_indices(len(told))] += field.noise_variance / told.counts
    lags = np.broadcast_to(time_s - told.times_s, (len(points), len(told)))
    k = field.covariance(points, told.points, lags)
    mean = prior_mean + k @ np.linalg.solve(K, told.means - prior_mean)
    return mean, field.signal_variance - np.einsum("ij,ji->i", k, np.linalg.solve(K, k.T))


@pytest.mark.parametrize(
    "times",
    [
        (Static(),),
        (OrnsteinUhlenbeck(400.0),),
        (MaternMotion(400.0),),
        (Static(), OrnsteinUhlenbeck(400.0)),
        (Static(), MaternMotion(400.0)),
    ],
    ids=["static", "ou", "smooth", "static and ou", "static and smooth"],
)
def test_with_a_basis_for_every_cell_a_rebuild_is_the_exact_process_of_the_cells(times):
    field, told = kernel(*times), cells(60)
    build = replace(BUILD, novelty=0.0)
    gp = build.rebuilt(told, field, 33.5, 1050.0)
    points = np.random.default_rng(1).uniform(0, SPAN, (50, 2))
    mean, variance = exact(field, told, 33.5, points, 1050.0)
    found = gp.predict(points)
    np.testing.assert_allclose(found.mean, mean, atol=1e-5)
    np.testing.assert_allclose(found.variance, variance, atol=1e-6)


def test_nothing_known_is_an_empty_model():
    nothing = HistoryCells(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0))
    for times in ((Static(),), (OrnsteinUhlenbeck(10.0),)):
        assert len(BUILD.rebuilt(nothing, kernel(*times), 1.0, 5.0)) == 0


def test_the_basis_of_moving_water_stands_where_the_present_is_known():
    """Seen in the west long ago, in the east just now: the little room there is goes to the east, or to both."""
    rng = np.random.default_rng(2)
    west, east = rng.uniform(0, 400, (200, 2)), rng.uniform(0, 400, (200, 2)) + np.array([600.0, 0.0])
    times = np.concatenate([np.linspace(0, 100, 200), np.linspace(5000, 5100, 200)])
    told = HistoryCells(np.vstack([west, east]), rng.normal(size=400), np.ones(400), times)
    build = replace(BUILD, capacity=12)
    moving = build.rebuilt(told, kernel(OrnsteinUhlenbeck(1000.0)), 0.0, 5100.0)
    still = build.rebuilt(told, kernel(Static()), 0.0, 5100.0)
    both = build.rebuilt(told, kernel(Static(), OrnsteinUhlenbeck(1000.0)), 0.0, 5100.0)
    easterly = [int((gp.basis[:, 0] > 500).sum()) for gp in (still, both, moving)]
    assert easterly[0] == pytest.approx(6, abs=2)
    assert easterly[2] == 12
    assert easterly[0] <= easterly[1] < 12


def test_relevance_is_a_share_of_the_field_itself():
    """Counting a group times w everywhere is the same as w² of its variance."""
    points = np.random.default_rng(3).uniform(0, SPAN, (80, 2))
    two = kernel(Static(), OrnsteinUhlenbeck(10.0))
    weights = np.vstack([np.ones(80), np.full(80, 0.3)])
    static, moving = two.components
    lighter = Kernel((static, replace(moving, variance=0.09 * moving.variance)), two.noise_variance)
    share = lighter.signal_variance / two.signal_variance
    assert select_basis(points, two, 30, 1e-3 * share, weights) == select_basis(points, lighter, 30, 1e-3)
    assert select_basis(points, two, 30, 1e-3, np.ones((2, 80))) == select_basis(points, two, 30, 1e-3)


@pytest.mark.parametrize(("noise", "expected"), [(0.5, 1e-3), (1e-4, 1e-4), (1e-12, 1e-6)])
def test_no_novelty_is_left_out_that_noise_does_not_hide(noise, expected):
    build = replace(BUILD, novelty=1e-3)
    assert build.model(kernel(Static(), noise=noise), 0.0).novelty == pytest.approx(expected)


def test_a_capacity_that_is_set_is_kept_and_one_that_is_not_follows_the_kernel():
    short = Hyperparameters(1.0, 0.01, (120.0, 120.0)).kernel
    long = Hyperparameters(1.0, 0.01, (400.0, 400.0)).kernel
    free = replace(BUILD, capacity=None)
    assert [free.capacity_for(k) for k in (short, long)] == [209, 50]
    assert [BUILD.capacity_for(k) for k in (short, long)] == [200, 200]
    assert free.capacity_for(short) == choose_capacity(short, SPAN**2, Budget())
    assert replace(free, most=120).capacity_for(short) == 120


def wavy(n, seed=4, wavelength=900.0):
    """A learner with `n` readings of a plain wave along a random walk, and the readings."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(0, 25.0, (n, 2)), axis=0) % SPAN
    y = 33.5 + np.sin(2 * math.pi * x[:, 0] / wavelength) + 0.05 * rng.normal(size=n)
    learner = Learner(SPAN)
    for i, (point, value) in enumerate(zip(x, y, strict=True)):
        learner.add(point, value, float(i))
    return learner


def test_a_re_estimate_takes_up_where_the_last_one_ended():
    learner = wavy(400)
    first = learner.reestimate_request(0, EstimationSection())
    assert first.structure is None
    assert first.starts == {}
    result = reestimate(pickle.loads(pickle.dumps(first)))
    learner.adopt(pickle.loads(pickle.dumps(result)))
    second = learner.reestimate_request(1, EstimationSection())
    assert second.structure == result.fit.structure
    assert set(second.starts) == set(result.choice.scores)
    # The winner's start is what was refined, motion too slow to matter and all; the caution about the signal variance
    # is the model's, not the next fit's.
    start = second.starts[result.fit.structure].signal_variance
    assert start == pytest.approx(result.fit.kernel.signal_variance, rel=0.02)
    assert result.kernel.signal_variance > start
    again = reestimate(second)
    assert again.fit.iterations < result.fit.iterations + 20


def test_the_rebuilt_model_has_the_capacity_that_its_kernel_wants():
    learner = wavy(600, wavelength=300.0)
    before = learner.capacity
    learner.adopt(reestimate(learner.reestimate_request(0, EstimationSection())))
    assert learner.capacity == learner.gp.capacity == choose_capacity(learner.gp.kernel, SPAN**2, Budget())
    assert learner.capacity != before


def test_a_choice_is_refined_on_twice_as_many_points():
    learner = wavy(1000)
    options = EstimationSection(maximum_points=60, candidates=("squared_exponential",))
    request = learner.reestimate_request(0, options)
    assert len(request.cells) > 120
    assert reestimate(request).points == 120
    few = replace(request, cells=request.cells.take(np.arange(50)))
    assert reestimate(few).points == 50
