"""The instrument: when it reads, and what."""

import numpy as np
import pytest

from sim.sensor import Sensor
from sim.vessel import Position


class Slope:
    def value(self, lat_deg, lon_deg, time_s):
        return np.asarray(10.0 * lat_deg + 0.001 * time_s)

    def is_land(self, lat_deg, lon_deg):
        return np.zeros(np.shape(lat_deg), dtype=bool)


HERE = Position(3.0, 4.0)


def test_readings_are_truth_plus_noise_of_the_given_size():
    sensor = Sensor(Slope(), np.random.default_rng(5), noise_std=0.2)
    errors = np.array([sensor.read(HERE, 0.0) - 30.0 for _ in range(4000)])
    assert abs(errors.mean()) < 4 * 0.2 / np.sqrt(len(errors))
    assert errors.std() == pytest.approx(0.2, rel=0.05)


def test_the_same_seed_gives_the_same_readings():
    def readings(seed: int) -> list[float]:
        sensor = Sensor(Slope(), np.random.default_rng(seed), noise_std=0.2)
        return [sensor.read(HERE, float(time)) for time in range(5)]

    assert readings(1) == readings(1)
    assert readings(1) != readings(2)


def test_readings_are_due_on_multiples_of_the_interval():
    sensor = Sensor(Slope(), np.random.default_rng(0), interval_s=0.1)
    due = []
    for _ in range(1000):
        due.append(sensor.next_time_s)
        sensor.read(HERE, due[-1])
    np.testing.assert_allclose(due, 0.1 * np.arange(1, 1001), rtol=0, atol=1e-9)


def test_without_noise_it_reads_the_field_at_that_time():
    assert Sensor(Slope(), np.random.default_rng(0)).read(HERE, 500.0) == 30.5


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ({"interval_s": 0.0}, "interval"),
        ({"noise_std": -1.0}, "noise"),
        ({"noise_std": float("nan")}, "noise"),
        ({"name": "ELEVENCHARS"}, "1 to 10"),
        ({"name": ""}, "1 to 10"),
        ({"name": "SALÉ"}, "ASCII"),
    ],
)
def test_impossible_instruments_are_refused(arguments, complaint):
    with pytest.raises(ValueError, match=complaint):
        Sensor(Slope(), np.random.default_rng(0), **arguments)
