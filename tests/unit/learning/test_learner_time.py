"""The learner and time: the nowcast ages while nothing is read, and a state that breaks is made anew."""

import math
from itertools import pairwise

import numpy as np
import pytest

from autonomy.config import EstimationSection
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate

SPAN = 1000.0
MOVING = Hyperparameters(1.0, 0.01, (200.0, 200.0), 300.0)
STILL = Hyperparameters(1.0, 0.01, (200.0, 200.0))
PLACES = np.random.default_rng(9).uniform(0, SPAN, (40, 2))


def taught(learner, n, start=0):
    rng = np.random.default_rng(start)
    for i in range(n):
        place = rng.uniform(0, SPAN, 2)
        learner.add(place, 33.5 + math.sin(place[0] / 150.0) + 0.1 * rng.normal(), float(start + i))
    return learner


def test_what_moves_is_known_less_and_less_while_nothing_is_read():
    learner = taught(Learner(SPAN, 60, hyperparameters=MOVING), 200)
    models = [learner.model(time_s).predict(PLACES) for time_s in (199.0, 300.0, 600.0, 1e6)]
    for early, late in pairwise(models):
        assert (late.variance > early.variance).all()
    prior_mean = learner.gp.prior_mean
    np.testing.assert_allclose(models[-1].mean, prior_mean, atol=1e-9)
    np.testing.assert_allclose(models[-1].variance, 1.0, rtol=1e-6)
    # After t seconds exp(−t/τ) of the departure from the prior is left.
    kept = (models[2].mean - prior_mean) / (models[0].mean - prior_mean)
    np.testing.assert_allclose(kept, math.exp(-401.0 / 300.0), rtol=1e-9)


def test_looking_ahead_changes_nothing_and_the_past_is_the_last_reading():
    learner = taught(Learner(SPAN, 60, hyperparameters=MOVING), 200)
    before = learner.model().predict(PLACES)
    learner.model(1e5)
    for model in (learner.model(), learner.model(0.0), learner.model(199.0)):
        np.testing.assert_array_equal(model.predict(PLACES).variance, before.variance)


def test_still_water_does_not_age():
    learner = taught(Learner(SPAN, 60, hyperparameters=STILL), 200)
    one, two = learner.model().predict(PLACES), learner.model(1e7).predict(PLACES)
    np.testing.assert_array_equal(one.variance, two.variance)
    assert len(Learner(SPAN).model(5.0)) == 0


def broken(learner):
    """A cosmic ray."""
    learner.gp._state.matrix[0, 0] = math.nan
    return learner


@pytest.mark.parametrize("given", [STILL, MOVING], ids=["still", "moving"])
def test_a_state_that_breaks_is_made_anew_from_the_history(given):
    healthy, hurt = (taught(Learner(SPAN, 60, hyperparameters=given), 300) for _ in range(2))
    expected = healthy.model().predict(PLACES)
    broken(hurt)
    taught(hurt, 1, start=300)
    taught(healthy, 1, start=300)
    assert (hurt.repairs, healthy.repairs) == (1, 0)
    assert hurt.gp.fault() is None
    assert hurt.gp.check() is None
    assert hurt.gp.kernel == given.kernel
    assert hurt.behind == 0
    assert hurt.samples == 301
    assert hurt.fresh_count == 0
    found = hurt.model().predict(PLACES)
    # Its cells are averages, and its basis another one: as good, not the same.
    assert (
        np.sqrt(np.mean((found.mean - expected.mean) ** 2)) < 0.35 * np.sqrt(expected.variance.mean()) + 0.05
    )
    assert taught(hurt, 100, start=301).repairs == 1


def test_a_factor_that_breaks_before_a_look_ahead_is_mended_too():
    # One model is put aside with the broken factor, the next reading far away is asked of it.
    hurt = taught(Learner(SPAN, 60, hyperparameters=STILL), 300)
    hurt.gp._state._factors[0][5, 5] = math.nan
    assert taught(hurt, 100, start=300).repairs == 1
    assert hurt.gp.check() is None
    assert np.isfinite(hurt.model().predict(PLACES).mean).all()
    assert math.isfinite(hurt.ahead.figures.mean_square)


def test_a_repair_while_a_job_runs_loses_nothing():
    learner = taught(Learner(SPAN, 60, hyperparameters=STILL), 200)
    result = reestimate(learner.reestimate_request(0, EstimationSection()))
    broken(taught(learner, 20, start=200))
    taught(learner, 20, start=220)
    assert learner.repairs == 1
    learner.adopt(result)
    assert learner.behind == 40
    while learner.catch_up():
        pass
    assert learner.gp.fault() is None
    assert learner.repairs == 1


def test_what_could_not_be_predicted_is_not_held_against_the_model():
    learner = broken(taught(Learner(SPAN, 60, hyperparameters=STILL), 200))
    taught(learner, 50, start=200)
    assert math.isfinite(learner.calibration.figures.log_score)
    assert learner.calibration.count >= 200
