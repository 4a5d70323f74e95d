"""A probe that spikes, sticks, reads air and says nothing: what that does to the map."""

import math
from dataclasses import replace

import numpy as np
import pytest

from autonomy.effects import Topic
from autonomy.learning import Hyperparameters
from autonomy.learning.learner import Learner
from sim.faults import Replaced, Spikes, Stuck

from .conftest import FRAME, WIDTH_M, Sea, boat, rmse_of

NOISE_STD = 0.02
SAILING_S = 1500.0
EVERY_FAULT_S = 600.0
_SAILED = {}


def faults():
    """Spikes of 5 to 1000 standard deviations of the noise, a stuck probe, silence, air, a driver's error."""
    return (
        Spikes(np.random.default_rng(1), 0.03, 0.1, 20.0),
        Stuck(500.0, 40.0),
        Replaced(math.nan, 310.0, 15.0),
        Replaced(0.0, 390.0, 20.0),
        Replaced(3.4e38, 97.0, 2.0),
    )


def survey_with(make_voyage, troubles, *vessel, sailing_s=SAILING_S, **sections):
    voyage = make_voyage(*vessel, **sections)
    voyage.autopilot.sensor.faults = troubles
    voyage.start()
    voyage.advance(sailing_s)
    return voyage


@pytest.fixture
def with_faults(make_voyage):
    """`with_faults(seed)`: a survey with all the faults, sailed once for all tests that only look at it."""

    def sailed(seed):
        if seed not in _SAILED:
            _SAILED[seed] = survey_with(make_voyage, faults(), boat(seed=seed))
        return _SAILED[seed]

    return sailed


def told(voyage):
    return [one for batch in voyage.published[Topic.OBSERVATIONS] for one in batch]


def truth(notice):
    return float(Sea().value(notice.lat_deg, notice.lon_deg, 0.0))


def rmse_after(notices):
    """Of the map that these readings make under hyperparameters that fit the sea: a fit's luck plays no part."""
    sea = Hyperparameters(0.3, NOISE_STD**2, (600.0, 600.0))
    learner = Learner(WIDTH_M, capacity=200, centring_samples=8, hyperparameters=sea)
    for one in notices:
        learner.add(FRAME.to_local(one.lat_deg, one.lon_deg), one.value, one.model_time_s)
    while learner.behind:
        learner.catch_up()
    return rmse_of(learner.gp)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_map_is_as_good_as_with_a_probe_that_works(with_faults, seed):
    """No worse than the worst of twenty draws of the noise, for the same places.

    Two surveys would sail differently, and one lucky tour halves the error.
    """
    voyage = with_faults(seed)
    quality = voyage.health.quality
    assert quality["flat_line"][2] + quality["flat_line"][3] > 40
    assert quality["spike"][3] > 10
    assert quality["syntax"][3] > 10
    assert quality["syntax"][4] > 20
    learnt = [one for one in told(voyage) if one.flag == 1]
    # A twentieth of the spikes are no higher than five standard deviations of the noise and a turn of the sea.
    assert max(abs(one.value - truth(one)) for one in learnt) < 10 * NOISE_STD
    rng = np.random.default_rng(seed)
    sound = [
        [replace(one, value=truth(one) + rng.normal(0.0, NOISE_STD)) for one in learnt] for _ in range(20)
    ]
    assert rmse_after(learnt) < max(map(rmse_after, sound))


def test_of_a_probe_that_works_nothing_is_refused(make_voyage):
    """Of some nine hundred readings at most one looks bad."""
    assert sum(survey_with(make_voyage, ()).health.quality["aggregate"][2:]) <= 1


def test_without_quality_control_it_is_worthless(make_voyage):
    """That the test above can fail: the limits off, all of it is learnt but for what is no number at all.

    The map is then further off than the mean of the field would be.
    """
    limits = ("spike_suspect", "spike_fail", "rate_suspect_per_s", "rate_fail_per_s")
    off = dict.fromkeys((*limits, "flat_suspect_s", "flat_fail_s"), math.inf)
    voyage = survey_with(make_voyage, faults(), sailing_s=EVERY_FAULT_S, quality=off)
    assert voyage.rmse() > 2.0 * np.std([truth(one) for one in told(voyage)])


def test_what_was_refused_goes_ashore_with_its_flags_and_is_explained(with_faults):
    voyage = with_faults(0)
    samples = voyage.samples
    notices = told(voyage)
    assert [one.model_time_s for one in notices] == sorted(one.model_time_s for one in notices)
    flags = {flag: [one for one in notices if one.flag == flag] for flag in (1, 3, 4, 9)}
    assert len(flags[1]) == samples
    assert min(map(len, flags.values())) > 0
    assert all(math.isnan(one.value) for one in flags[9])
    assert all(32.5 < one.value < 34.5 for one in flags[1])
    for reason in ("a spike", "not a number", "the same for too long"):
        assert voyage.lines(f"a reading was not learnt (said once): {reason}")


def test_a_probe_that_has_nothing_to_say_is_told_to_be_silent(make_voyage):
    voyage = make_voyage()
    voyage.start()
    voyage.advance(60.0)
    voyage.autopilot.sensor.faults = (lambda time_s, value: math.nan,)
    voyage.until("no reading named SALT comes in")
    samples = voyage.samples
    voyage.advance(60.0)
    assert voyage.samples == samples
    voyage.autopilot.sensor.faults = ()
    voyage.advance(120.0)
    assert voyage.samples > samples
    assert "no reading" not in voyage.health.reason
