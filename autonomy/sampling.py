"""Which readings teach the model: good ones of the survey, taken under way, in its water, at its spacing."""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from autonomy.config import Configuration
from autonomy.geometry import FloatArray
from autonomy.learning.transform import transform_of
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.vehicle import VehicleState
from autonomy.planning.survey import SurveyArea
from autonomy.quality import Check, Flag, Flags, Judged, QualityControl, Reading, Waters, refused_by

TOO_CLOSE = "closer than the sampling distance"
"""The one refusal that is in the order of things."""

BAD_QUALITY: dict[Check, str] = {
    Check.TIMING: "not later than the reading before it",
    Check.SYNTAX: "not a number",
    Check.GROSS_RANGE: "outside the sensor's range",
    Check.LOCATION: "taken where the vessel can't have been",
    Check.SPIKE: "a spike",
    Check.RATE_OF_CHANGE: "changed too fast since the last good one",
    Check.FLAT_LINE: "the same for too long",
}
"""Why a reading is refused that fails a test of its quality, or is suspect."""


@dataclass(frozen=True)
class Sample:
    """A reading of the survey that has been judged.

    Attributes:
        observation: what was measured, where and when.
        point_m: where, shape (2,), local metres.
        flags: of its quality, test by test.
        teaches: whether the model shall learn from it.
    """

    observation: Observation
    point_m: FloatArray
    flags: Flags
    teaches: bool


@dataclass(frozen=True)
class _Taken:
    """A reading as it came in; `refusal` is why it can't teach however good it is, None if it can."""

    observation: Observation
    point_m: FloatArray
    refusal: str | None


class SampleGate:
    """Lets readings through to the learner or says why not.

    Readings on deck, in the harbour or at anchor teach nothing about the field between the spots, and a reading
    repeated at one place would outweigh the rest; both are counted, so that a silent map can be explained. From the
    start of the survey on the quality of every reading is controlled, in the order in which they come, which takes
    until the next one has come: `autonomy.quality.stream`.
    """

    def __init__(self, survey: SurveyArea, configuration: Configuration) -> None:
        self._survey = survey
        self._sampling = configuration.sampling
        self._transform = transform_of(configuration.sensor)
        quality, sensor = configuration.quality, configuration.sensor
        margin_m = survey.span_m if quality.location_margin_m is None else quality.location_margin_m
        waters = Waters(survey.ground, survey.obstacles, margin_m)
        self.quality: QualityControl[_Taken] = QualityControl(
            quality, (sensor.minimum, sensor.maximum), waters
        )
        self._allowed = {Flag.GOOD} if quality.learn_from == "good" else {Flag.GOOD, Flag.SUSPECT}
        self._lag_s = 0.0
        self._last_point: FloatArray | None = None
        self._last_refused: FloatArray | None = None
        self.refused: Counter[str] = Counter()

    def take(self, observation: Observation, vehicle: VehicleState, *, survey_started: bool) -> list[Sample]:
        """Take in a reading; returns those of the survey that can be told by now to teach, or to be bad."""
        if not survey_started:
            self.refused["survey not started"] += 1
            return []
        if vehicle.model_time_s is not None:
            self._lag_s = max(0.0, vehicle.model_time_s - observation.model_time_s)
        point = self._survey.frame.to_local(observation.lat_deg, observation.lon_deg)
        taken = _Taken(observation, point, self._refusal(point, vehicle))
        x, y = point.tolist()
        reading = Reading(observation.model_time_s, x, y, observation.value)
        return self._sift(self.quality.add(reading, taken))

    def release(self, model_time_s: float) -> list[Sample]:
        """The readings that have waited for a next one in vain; all that wait at a time of infinity.

        The next one comes as late as the last did: water has been on its way to the sensor for a while.
        """
        return self._sift(self.quality.release(model_time_s - self._lag_s))

    def _refusal(self, point: FloatArray, vehicle: VehicleState) -> str | None:
        if not vehicle.position_ok:
            return "the vehicle is not sure of its position"
        if (vehicle.groundspeed_mps or 0.0) < self._sampling.minimum_speed_mps:
            return "not under way"
        if not self._survey.contains(float(point[0]), float(point[1])):
            return "outside the survey area"
        return None

    def _sift(self, judged: list[Judged[_Taken]]) -> list[Sample]:
        return [sample for one in judged for sample in self._admit(one)]

    def _admit(self, judged: Judged[_Taken]) -> list[Sample]:
        """The reading as a sample, if it teaches or is bad and as far from the last bad one as if it taught."""
        taken = judged.subject
        point = taken.point_m
        bad = refused_by(judged.flags, self._allowed)
        reason = taken.refusal
        if reason is None and self._is_near(self._last_point, point):
            reason = TOO_CLOSE
        if reason is None and bad is not None:
            reason = BAD_QUALITY[bad]
            self.refused[reason] += 1
            if self._is_near(self._last_refused, point):
                return []
            self._last_refused = point
            return [Sample(taken.observation, point, judged.flags, teaches=False)]
        if reason is None:
            reason = self._transform.refusal(taken.observation.value)
        if reason is not None:
            self.refused[reason] += 1
            return []
        self._last_point = point
        return [Sample(taken.observation, point, judged.flags, teaches=True)]

    def _is_near(self, other: FloatArray | None, point: FloatArray) -> bool:
        return other is not None and math.hypot(*np.subtract(point, other)) < self._sampling.spacing_m
