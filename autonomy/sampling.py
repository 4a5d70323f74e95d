"""Which readings teach the model: only those of the survey, taken under way, in its water, at its spacing."""

import math
from collections import Counter

import numpy as np

from autonomy.config import SamplingSection, SensorSection
from autonomy.geometry import FloatArray
from autonomy.learning.transform import transform_of
from autonomy.mavlink.telemetry import Observation, VehicleState
from autonomy.planning.survey import SurveyArea

TOO_CLOSE = "closer than the sampling distance"
"""The one refusal that is in the order of things."""


class SampleGate:
    """Lets a reading through to the learner or says why not.

    Readings on deck, in the harbour or at anchor teach nothing about the field between the spots, and a reading
    repeated at one place would outweigh the rest; both are counted, so that a silent map can be explained.
    """

    def __init__(self, survey: SurveyArea, sampling: SamplingSection, sensor: SensorSection) -> None:
        self._survey = survey
        self._sampling = sampling
        self._sensor = sensor
        self._transform = transform_of(sensor)
        self._last_point: FloatArray | None = None
        self.refused: Counter[str] = Counter()

    def admit(
        self, observation: Observation, vehicle: VehicleState, *, survey_started: bool
    ) -> FloatArray | None:
        """The local point, shape (2,), of a reading that shall teach the model; None if it shall not."""
        point = self._survey.frame.to_local(observation.lat_deg, observation.lon_deg)
        reason = self._refusal(observation, point, vehicle) if survey_started else "survey not started"
        if reason is not None:
            self.refused[reason] += 1
            return None
        self._last_point = point
        return point

    def _refusal(self, observation: Observation, point: FloatArray, vehicle: VehicleState) -> str | None:
        if not vehicle.position_ok:
            return "the vehicle is not sure of its position"
        if not self._sensor.minimum <= observation.value <= self._sensor.maximum:
            return "outside the sensor's range"
        untransformable = self._transform.refusal(observation.value)
        if untransformable is not None:
            return untransformable
        if (vehicle.groundspeed_mps or 0.0) < self._sampling.minimum_speed_mps:
            return "not under way"
        if not self._survey.contains(float(point[0]), float(point[1])):
            return "outside the survey area"
        if self._last_point is not None:
            distance_m = math.hypot(*np.subtract(point, self._last_point))
            if distance_m < self._sampling.spacing_m:
                return TOO_CLOSE
        return None
