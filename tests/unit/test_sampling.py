"""Which readings teach the model, and why the others don't."""

import math

import numpy as np
import pytest
import shapely

from autonomy.config import Configuration
from autonomy.geometry import LocalFrame
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.vehicle import VehicleState
from autonomy.planning.survey import SurveyArea
from autonomy.quality import Flag, aggregate
from autonomy.sampling import SampleGate

FRAME = LocalFrame(33.5, -118.5)
SURVEY = SurveyArea.from_geometry(
    FRAME, shapely.box(0, 0, 1000, 1000), land=shapely.box(400, 400, 600, 600), standoff_m=50.0
)


AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]


class Gate:
    """Readings a second apart; what is held back for the next one comes out at the end of `admit`."""

    def __init__(self, spacing_m=100.0, minimum=30.0, maximum=40.0, **quality):
        configuration = Configuration.model_validate(
            {
                "survey": {"area": AREA},
                "sampling": {"spacing_m": spacing_m, "minimum_speed_mps": 0.5},
                "sensor": {"minimum": minimum, "maximum": maximum},
                # The boat of these tests flies from place to place.
                "quality": {"maximum_speed_mps": 1e6, **quality},
            }
        )
        self.gate = SampleGate(SURVEY, configuration)
        self.time_s = 0.0

    def take(self, x, y, value=None, *, started=True, speed_mps=2.0, ekf_ok=True, lag_s=0.0):
        self.time_s += 1.0
        if value is None:
            value = 33.0 + 0.01 * math.sin(7.0 * self.time_s)  # a probe that stays the same is stuck
        lat_deg, lon_deg = map(float, FRAME.to_geodetic((x, y)))
        observation = Observation(self.time_s, lat_deg, lon_deg, value)
        vehicle = VehicleState(
            *(1, 1, 3, 11, 10, True, 4),
            model_time_s=self.time_s + lag_s,
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            groundspeed_mps=speed_mps,
            ekf_ok=ekf_ok,
        )
        return self.gate.take(observation, vehicle, survey_started=started)

    def samples(self, *args, **kwargs):
        return self.take(*args, **kwargs) + self.gate.release(math.inf)

    def admit(self, *args, **kwargs):
        learnt = [sample.point_m for sample in self.samples(*args, **kwargs) if sample.teaches]
        return learnt[0] if learnt else None


def test_a_good_reading_comes_through_at_its_place():
    np.testing.assert_allclose(Gate().admit(200.0, 300.0), (200.0, 300.0), atol=1e-3)


@pytest.mark.parametrize(
    ("reading", "reason"),
    [
        ({"x": 200.0, "y": 200.0, "started": False}, "survey not started"),
        ({"x": 200.0, "y": 200.0, "value": 29.9}, "outside the sensor's range"),
        ({"x": 200.0, "y": 200.0, "value": 40.1}, "outside the sensor's range"),
        ({"x": 200.0, "y": 200.0, "value": float("nan")}, "not a number"),
        ({"x": 200.0, "y": 200.0, "value": float("inf")}, "not a number"),
        ({"x": 200.0, "y": 200.0, "speed_mps": 0.4}, "not under way"),
        ({"x": 200.0, "y": 200.0, "ekf_ok": False}, "the vehicle is not sure of its position"),
        ({"x": -1.0, "y": 200.0}, "outside the survey area"),
        ({"x": 500.0, "y": 500.0}, "outside the survey area"),
    ],
)
def test_refused_readings_are_counted_and_change_nothing(reading, reason):
    gate = Gate()
    assert gate.admit(**reading) is None
    assert gate.gate.refused == {reason: 1}
    assert gate.admit(200.0, 200.0) is not None


def test_the_newest_reading_waits_for_the_next_and_all_come_in_their_order():
    gate = Gate(spacing_m=0.0)
    values = [33.0 + 0.01 * math.sin(7.0 * k) for k in range(40)]
    came = [[s.observation.value for s in gate.take(100.0 + 2.0 * k, 100.0, v)] for k, v in enumerate(values)]
    assert came[:12] == [[]] * 12  # until the stream has shown what is usual
    assert came[12] == values[:12]
    assert came[13:] == [[value] for value in values[12:-1]]
    assert [s.observation.value for s in gate.gate.release(math.inf)] == values[-1:]


def test_what_was_long_on_its_way_waits_no_less_for_the_next_one():
    gate = Gate(spacing_m=0.0)
    for k in range(40):
        gate.take(100.0 + 2.0 * k, 100.0, lag_s=13.0)
    assert gate.gate.release(gate.time_s + 13.5) == []
    assert len(gate.gate.release(gate.time_s + 13.0 + 60.0)) == 1


@pytest.mark.parametrize("learn_from", ["good", "good_and_suspect"])
def test_what_is_bad_is_told_and_does_not_teach(learn_from):
    gate = Gate(spacing_m=0.0, minimum=-1e6, maximum=1e6, suspect_maximum=35.0, learn_from=learn_from)
    samples = []
    for k in range(40):
        value = {20: 1000.0, 25: math.nan, 30: 35.02}.get(k, 34.98 + 0.01 * math.sin(7.0 * k))
        samples += gate.take(100.0 + 2.0 * k, 100.0, value)
    samples += gate.gate.release(math.inf)
    assert len(samples) == 40
    refused = {k: aggregate(sample.flags) for k, sample in enumerate(samples) if not sample.teaches}
    suspect = {30: Flag.SUSPECT} if learn_from == "good" else {}
    assert refused == {20: Flag.FAIL, 25: Flag.MISSING, **suspect}
    assert gate.gate.quality.counts["aggregate"] == (37, 0, 1, 1, 1)


def test_a_probe_that_stays_bad_is_told_at_the_sampling_distance():
    gate = Gate(spacing_m=100.0)
    told = [k for k in range(40) for _ in gate.samples(100.0 + 10.01 * k, 100.0, 99.0)]
    assert told == [0, 10, 20, 30]
    assert gate.gate.refused == {"outside the sensor's range": 40}


def test_within_the_stand_off_is_still_the_survey():
    assert Gate().admit(380.0, 500.0) is not None


def test_the_spacing_is_kept_from_the_last_reading_that_was_learnt():
    gate = Gate(spacing_m=100.0)
    learnt = [x for x in range(0, 500, 30) if gate.admit(float(x), 100.0) is not None]
    assert learnt == [0, 120, 240, 360, 480]
    assert gate.gate.refused == {"closer than the sampling distance": 12}


def test_without_a_spacing_every_reading_teaches():
    gate = Gate(spacing_m=0.0)
    assert all(gate.admit(100.0, 100.0) is not None for _ in range(5))


@pytest.mark.parametrize(
    ("sensor", "good", "bad", "reason"),
    [
        ({"transform": "log"}, 0.3, 0.0, "the logarithm needs values above 0"),
        (
            {"transform": "logit", "transform_bounds": (0.0, 40.0)},
            39.9,
            40.0,
            "the logit needs values between 0 and 40, the ends excluded",
        ),
    ],
)
def test_what_cannot_be_transformed_is_refused_with_the_reason(sensor, good, bad, reason):
    gate = Gate()
    configuration = {"survey": {"area": AREA}, "sampling": {"spacing_m": 0.0}, "sensor": sensor}
    gate.gate = SampleGate(SURVEY, Configuration.model_validate(configuration))
    assert gate.admit(200.0, 200.0, bad) is None
    assert gate.gate.refused == {reason: 1}
    assert gate.admit(200.0, 200.0, good) is not None
