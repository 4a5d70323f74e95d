"""Instruments that go wrong, on purpose and to the second."""

import math

import numpy as np
import pytest

from sim.faults import Replaced, Spikes, Stuck
from sim.sensor import Sensor
from sim.vessel import Position


class Clock:
    """A field that tells the time."""

    def value(self, lat_deg, lon_deg, time_s):
        return np.asarray(time_s)

    def is_land(self, lat_deg, lon_deg):
        return np.zeros(np.shape(lat_deg), dtype=bool)


def read(count, *faults, seed=0, noise_std=0.0):
    sensor = Sensor(Clock(), np.random.default_rng(seed), noise_std=noise_std, faults=faults)
    return np.array([sensor.read(Position(1.0, 2.0), sensor.next_time_s) for _ in range(count)])


def test_spikes_have_the_share_and_the_sizes_asked_for():
    off = np.abs(read(20_000, Spikes(np.random.default_rng(1), 0.1, 2.0, 200.0)) - np.arange(1, 20_001))
    spikes = off[off > 1e-6]
    assert len(spikes) / len(off) == pytest.approx(0.1, rel=0.1)
    assert 2.0 - 1e-6 <= spikes.min() < 2.1
    assert 190.0 < spikes.max() <= 200.0 + 1e-6
    assert np.median(spikes) == pytest.approx(20.0, rel=0.1)  # log-uniform


def test_a_stuck_probe_repeats_the_reading_at_which_it_got_stuck():
    expected = list(range(1, 10)) + [10] * 3 + list(range(13, 20)) + [20] * 3 + [23.0, 24.0]
    assert read(24, Stuck(10.0, 3.0)).tolist() == expected


@pytest.mark.parametrize("value", [math.nan, 0.0, 3.4e38])
def test_readings_are_replaced_in_every_period_but_the_first(value):
    came = read(12, Replaced(value, 5.0, 2.0))
    np.testing.assert_array_equal(came, [1, 2, 3, 4, value, value, 7, 8, 9, value, value, 12])


def test_faults_do_not_change_the_noise():
    clean, faulty = read(50, noise_std=0.5), read(50, Replaced(math.nan, 5.0, 1.0), noise_std=0.5)
    there = ~np.isnan(faulty)
    assert there.sum() == 40
    np.testing.assert_array_equal(faulty[there], clean[there])


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: Spikes(np.random.default_rng(0), 1.5, 1.0, 2.0), "share"),
        (lambda: Spikes(np.random.default_rng(0), 0.5, 0.0, 2.0), "positive"),
        (lambda: Spikes(np.random.default_rng(0), 0.5, 3.0, 2.0), "positive"),
        (lambda: Stuck(10.0, 10.0), "shorter"),
        (lambda: Replaced(0.0, 10.0, 0.0), "shorter"),
    ],
)
def test_impossible_faults_are_refused(make, complaint):
    with pytest.raises(ValueError, match=complaint):
        make()
