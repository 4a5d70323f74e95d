"""A probe that spikes, sticks, reads air and says nothing: what that does to the map."""

import math

import numpy as np

from autonomy.effects import Topic
from sim.faults import Replaced, Spikes, Stuck

SAILING_S = 1500.0


def faults():
    """Spikes of 5 to 1000 standard deviations of the noise, a stuck probe, silence, air, a driver's error."""
    return (
        Spikes(np.random.default_rng(1), 0.03, 0.1, 20.0),
        Stuck(500.0, 40.0),
        Replaced(math.nan, 310.0, 15.0),
        Replaced(0.0, 390.0, 20.0),
        Replaced(3.4e38, 97.0, 2.0),
    )


def survey_with(make_voyage, troubles, **sections):
    voyage = make_voyage(**sections)
    voyage.autopilot.sensor.faults = troubles
    voyage.start()
    voyage.advance(SAILING_S)
    return voyage


def test_the_map_is_nearly_as_good_as_with_a_probe_that_works(make_voyage):
    clean, faulty = survey_with(make_voyage, ()), survey_with(make_voyage, faults())
    # No reading is bad, and of some nine hundred at most one looks it.
    assert sum(clean.health.quality["aggregate"][2:]) <= 1
    quality = faulty.health.quality
    assert quality["flat_line"][2] + quality["flat_line"][3] > 50
    assert quality["spike"][3] > 10
    assert quality["syntax"][3] > 10
    assert quality["syntax"][4] > 20
    assert faulty.rmse() < 1.1 * clean.rmse()


def test_without_quality_control_it_is_worthless(make_voyage):
    """That the test above can fail: the limits off, all of it is learnt but for what is no number at all."""
    limits = ("spike_suspect", "spike_fail", "rate_suspect_per_s", "rate_fail_per_s")
    off = dict.fromkeys((*limits, "flat_suspect_s", "flat_fail_s"), math.inf)
    assert survey_with(make_voyage, faults(), quality=off).rmse() > 2.0


def test_what_was_refused_goes_ashore_with_its_flags_and_is_explained(make_voyage):
    voyage = survey_with(make_voyage, faults())
    samples = voyage.samples
    told = [one for batch in voyage.published[Topic.OBSERVATIONS] for one in batch]
    assert [one.model_time_s for one in told] == sorted(one.model_time_s for one in told)
    flags = {flag: [one for one in told if one.flag == flag] for flag in (1, 3, 4, 9)}
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
