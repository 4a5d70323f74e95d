"""Which readings teach the model: only those of the survey, taken under way, in its water, at its spacing."""

import math
from collections import Counter

import numpy as np

from autonomy.config import SamplingSection, SensorSection
from autonomy.geometry import FloatArray
from autonomy.mavlink.telemetry import Observation
from autonomy.planning.survey import SurveyArea


class SampleGate:
    """Lets a reading through to the learner or says why not.

    Readings on deck, in the harbour or at anchor teach nothing about the field between the spots, and a reading
    repeated at one place would outweigh the rest; both are counted, so that a silent map can be explained.
    """

    def __init__(self, survey: SurveyArea, sampling: SamplingSection, sensor: SensorSection) -> None:
        self._survey = survey
        self._sampling = sampling
        self._sensor = sensor
        self._last_point: FloatArray | None = None
        self.refused: Counter[str] = Counter()

    def admit(self, observation: Observation, *, survey_started: bool, speed_mps: float) -> FloatArray | None:
        """The local point, shape (2,), of a reading that shall teach the model; None if it shall not."""
        point = self._survey.frame.to_local(observation.lat_deg, observation.lon_deg)
        reason = self._refusal(observation, point, survey_started, speed_mps)
        if reason is not None:
            self.refused[reason] += 1
            return None
        self._last_point = point
        return point

    def _refusal(
        self, observation: Observation, point: FloatArray, survey_started: bool, speed_mps: float
    ) -> str | None:
        if not survey_started:
            return "survey not started"
        if not self._sensor.minimum <= observation.value <= self._sensor.maximum:
            return "outside the sensor's range"
        if speed_mps < self._sampling.minimum_speed_mps:
            return "not under way"
        if not self._survey.contains(float(point[0]), float(point[1])):
            return "outside the survey area"
        if self._last_point is not None:
            distance_m = math.hypot(*np.subtract(point, self._last_point))
            if distance_m < self._sampling.spacing_m:
                return "closer than the sampling distance"
        return None
