"""What becomes of the map when the kernel changes: re-estimates from bad starts, rebuilds of moving water, long runs.

HALOCLINE_SEEDS: how many seas each, and the run of 100 000 readings in full; without it a short form.
"""

import functools
import os
from dataclasses import replace

import numpy as np
import pytest
from moving import Eddies, MovingTruth, Patrol, SmoothDraw, square
from oracles import ExactGP, geometric_mean, rmse

from autonomy.config import EstimationSection
from autonomy.learning.fitting import fit
from autonomy.learning.kernel import Hyperparameters, Kernel
from autonomy.learning.learner import Learner
from autonomy.learning.likelihood import Readings
from autonomy.learning.rebuild import reestimate
from autonomy.learning.structures import STRUCTURES

LONG = "HALOCLINE_SEEDS" in os.environ
SEEDS = range(int(os.environ.get("HALOCLINE_SEEDS", "2")))
SPAN_M = 1000.0
LENGTH_M = SPAN_M / 6
STEP_M, STEP_S = 10.0, 1.0
NOISE = 0.1
GRID = square(SPAN_M, 40.0)
ALL = EstimationSection()
STILL = EstimationSection(candidates=("squared_exponential", "long_short"))


class Still:
    """A truth that does not move."""

    def __init__(self, rng):
        self._draw = SmoothDraw(rng, SPAN_M, LENGTH_M)

    def advance(self, dt_s):
        pass

    def value(self, points):
        return self._draw.value(points)


class Stream:
    """Readings of a truth by a boat that sails from waypoint to waypoint."""

    def __init__(self, truth: MovingTruth, rng: np.random.Generator, noise: float = NOISE) -> None:
        self.truth, self._rng, self._noise = truth, rng, noise
        self._patrol = Patrol(rng, SPAN_M)
        self.x, self.y, self.times_s = [], [], []

    def read(self, n):
        """`n` more readings, one by one: (place, value, time)."""
        for _ in range(n):
            self.truth.advance(STEP_S)
            place = self._patrol.step(STEP_M)
            value = float(self.truth.value(place[None])[0]) + self._noise * self._rng.standard_normal()
            self.x.append(place)
            self.y.append(value)
            self.times_s.append(len(self.x) * STEP_S)
            yield place, value, self.times_s[-1]

    def exact(self, kernel: Kernel, prior_mean: float | None = None) -> np.ndarray:
        """The nowcast on the grid of the exact process of `kernel` on all readings so far."""
        times = None if kernel.is_static else np.array(self.times_s)
        gp = ExactGP(kernel, np.array(self.x), np.array(self.y), times, prior_mean=prior_mean)
        return gp.mean(GRID, self.times_s[-1])


def teach(learner, stream, n):
    for place, value, time_s in stream.read(n):
        learner.add(place, value, time_s)


def renew(learner, options, seed):
    learner.adopt(reestimate(learner.reestimate_request(seed, options)))


TRUTH = Hyperparameters(1.0, NOISE**2, (LENGTH_M, LENGTH_M))


@functools.cache
def still_water(seed):
    """2000 readings of a still sea, the sea on the grid, and the errors of two exact processes on all readings:
    of the true hyperparameters and mean, and of those that the readings maximise.
    """
    rng = np.random.default_rng(seed)
    stream = Stream(Still(rng), rng)
    readings = list(stream.read(2000))
    now = stream.truth.value(GRID)
    # Every second reading tells as much, at an eighth of the price.
    sample = Readings.of(np.array(stream.x)[::2], np.array(stream.y)[::2], mean="gls")
    best = fit(sample, STRUCTURES["squared_exponential"], SPAN_M)
    known = rmse(stream.exact(TRUTH.kernel, 0.0), now)
    return stream, readings, now, known, rmse(stream.exact(best.kernel, best.prior_mean), now)


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_a_re_estimate_from_length_scales_ten_times_off(factor):
    """2000 samples, 100 basis vectors: the map right after it against exact processes on all readings.

    One knows the true hyperparameters and the true mean; in the mean over the seas it is at most a tenth
    better. Of a single sea the readings may tell other hyperparameters than the true ones, and the corners
    that the track leaves out then tell it on the map: another exact process has those that its readings
    maximise. The third has the learner's own, so that only the bounded basis and history stand between them: a hundred
    basis vectors are enough in nine seas of ten.
    """
    ratios, fitted, own = [], [], []
    for seed in SEEDS:
        stream, readings, now, known, best = still_water(seed)
        wrong = replace(TRUTH, lengthscales_m=(factor * LENGTH_M,) * 2)
        learner = Learner(SPAN_M, capacity=100, hyperparameters=wrong)
        for place, value, time_s in readings:
            learner.add(place, value, time_s)
        renew(learner, ALL, seed)
        error = rmse(learner.model().predict(GRID).mean, now)
        ratios.append(error / known)
        fitted.append(error / best)
        own.append(error / rmse(stream.exact(learner.gp.kernel, learner.gp.prior_mean), now))
    for what, found in (("the truth", ratios), ("a fit of all", fitted), ("its own kernel", own)):
        row = np.round(found, 3).tolist()
        print(f"{factor:g} times off, over {what}: {row}, {geometric_mean(found)[0]:.3f}")
    assert geometric_mean(ratios)[0] <= 1.10
    assert geometric_mean(fitted)[0] <= 1.05
    assert geometric_mean(own)[0] <= 1.05
    assert np.mean(np.array(own) <= 1.10) >= 0.9


def test_moving_eddies_are_rebuilt_from_a_thousand_cells():
    """3000 samples: the nowcast after a rebuild against the exact space-time process of the same kernel."""
    ratios = []
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        stream = Stream(Eddies(rng, SPAN_M, LENGTH_M, 6000.0), rng)
        learner = Learner(SPAN_M, history_cells=1000)
        teach(learner, stream, 3000)
        result = reestimate(learner.reestimate_request(seed, ALL))
        learner.adopt(result)
        assert len(learner.history) <= 1000
        now = stream.truth.value(GRID)
        exact = stream.exact(result.kernel, result.prior_mean)
        ratios.append(rmse(learner.model().predict(GRID).mean, now) / rmse(exact, now))
    print(f"rebuilt eddies over exact: {np.round(ratios, 3).tolist()}, {geometric_mean(ratios)[0]:.3f}")
    assert geometric_mean(ratios)[0] <= 1.10


def test_a_long_run_is_as_good_as_a_fresh_rebuild():
    """100 000 samples with re-estimates along the way: no repair, and the map made anew is not 1 % better."""
    rng = np.random.default_rng(0)
    stream = Stream(Still(rng), rng)
    learner = Learner(SPAN_M)
    done = 0
    for number in (100, 300, 1000, 3000, 10_000, *((30_000, 60_000) if LONG else ())):
        teach(learner, stream, number - done)
        renew(learner, ALL, number)
        done = number
    teach(learner, stream, (100_000 if LONG else 20_000) - done)
    request = learner.reestimate_request(0, ALL)
    gp = learner.gp
    fresh = request.build.rebuilt(request.cells, gp.kernel, gp.prior_mean, request.time_s)
    now = stream.truth.value(GRID)
    streamed, rebuilt = (rmse(model.predict(GRID).mean, now) for model in (gp, fresh))
    print(f"RMSE streamed {streamed:.4f}, made anew {rebuilt:.4f}; repairs {learner.repairs}")
    assert learner.repairs == 0
    assert gp.check() is None
    assert streamed <= 1.01 * rebuilt
