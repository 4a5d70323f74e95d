"""Which readings teach the model, and why the others don't."""

import numpy as np
import pytest
import shapely

from autonomy.config import SamplingSection, SensorSection
from autonomy.geometry import LocalFrame
from autonomy.mavlink.telemetry import Observation, VehicleState
from autonomy.planning.survey import SurveyArea
from autonomy.sampling import SampleGate

FRAME = LocalFrame(33.5, -118.5)
SURVEY = SurveyArea.from_geometry(
    FRAME, shapely.box(0, 0, 1000, 1000), land=shapely.box(400, 400, 600, 600), standoff_m=50.0
)


class Gate:
    def __init__(self, spacing_m=100.0, minimum=30.0, maximum=40.0):
        sampling = SamplingSection(spacing_m=spacing_m, minimum_speed_mps=0.5)
        self.gate = SampleGate(SURVEY, sampling, SensorSection(minimum=minimum, maximum=maximum))

    def admit(self, x, y, value=33.0, *, started=True, speed_mps=2.0, ekf_ok=True):
        lat_deg, lon_deg = map(float, FRAME.to_geodetic((x, y)))
        observation = Observation(1.0, lat_deg, lon_deg, value)
        vehicle = VehicleState(
            *(1, 1, 3, 11, 10, True, 4),
            lat_deg=lat_deg,
            lon_deg=lon_deg,
            groundspeed_mps=speed_mps,
            ekf_ok=ekf_ok,
        )
        return self.gate.admit(observation, vehicle, survey_started=started)


def test_a_good_reading_comes_through_at_its_place():
    np.testing.assert_allclose(Gate().admit(200.0, 300.0), (200.0, 300.0), atol=1e-3)


@pytest.mark.parametrize(
    ("reading", "reason"),
    [
        ({"x": 200.0, "y": 200.0, "started": False}, "survey not started"),
        ({"x": 200.0, "y": 200.0, "value": 29.9}, "outside the sensor's range"),
        ({"x": 200.0, "y": 200.0, "value": 40.1}, "outside the sensor's range"),
        ({"x": 200.0, "y": 200.0, "value": float("nan")}, "outside the sensor's range"),
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
        (SensorSection(transform="log"), 0.3, 0.0, "the logarithm needs values above 0"),
        (
            SensorSection(transform="logit", transform_bounds=(0.0, 40.0)),
            39.9,
            40.0,
            "the logit needs values between 0 and 40, the ends excluded",
        ),
    ],
)
def test_what_cannot_be_transformed_is_refused_with_the_reason(sensor, good, bad, reason):
    gate = Gate()
    gate.gate = SampleGate(SURVEY, SamplingSection(spacing_m=0.0), sensor)
    assert gate.admit(200.0, 200.0, bad) is None
    assert gate.gate.refused == {reason: 1}
    assert gate.admit(200.0, 200.0, good) is not None
