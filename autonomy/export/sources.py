"""Where an intake is filled from: the shore's recording, or the boat's journal."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from autonomy import replay, wire
from autonomy.effects import Effect, Publish, Topic
from autonomy.export.intake import Intake
from autonomy.export.values import ExportError
from autonomy.planning.survey import SurveyArea
from autonomy.shore.recording import Recorded, known_vehicles, read_recording
from autonomy.wire import (
    HealthNotice,
    LogBatch,
    LogNotice,
    ModelSnapshot,
    ObservationBatch,
    PlanNotice,
    SurveyNotice,
)

_TOPICS = {topic.value: topic for topic in Topic}
_TOLERANCE = 1e-6
"""By how much a replay's numbers may differ from the recorded ones, relatively: other processors round otherwise."""


def find_vehicle(folder: Path) -> str:
    """The vehicle whose recording a folder holds. Raises ExportError if there are several, or none."""
    known = known_vehicles(folder)
    if not known:
        raise ExportError(f"{folder}: the recording is empty")
    if len(known) > 1:
        listed = ", ".join(known[:20]) + (", …" if len(known) > 20 else "")
        raise ExportError(f"{folder}: holds {len(known)} vehicles, {listed}: --vehicle says which")
    return known[0]


def fill_from_recording(intake: Intake, folder: Path, regret: Callable[[str], None]) -> None:
    """Take all that a recording holds of the intake's vehicle.

    Args:
        intake: to be filled.
        folder: of the recording.
        regret: is told, for a person, what can't be used.

    Raises:
        ExportError: the vehicle is not in it, or only what other versions have told.
        RecordingError: it is none.
        OSError: it can't be read.
    """
    taken, outdated, why = 0, 0, ""
    for one in read_recording(folder, intake.vehicle, regret):
        try:
            taken += _take(intake, one)
        except wire.VersionError as error:
            outdated, why = outdated + 1, str(error)
        except wire.WireError as error:
            regret(f"received {one.received_utc_s:.3f} under {one.key}, left out: {error}")
    if outdated:
        told = f"{outdated} records of {intake.vehicle} are of another version: {why}"
        if not taken:
            raise ExportError(told)
        regret(f"left out: {told}")
    if not taken:
        raise ExportError(f"{folder}: holds nothing of {intake.vehicle}")


def fill_from_journal(intake: Intake, folder: Path, run: int, regret: Callable[[str], None]) -> SurveyArea:
    """Take all that the core tells when a journal's run is replayed, and the runs that it went on from.

    Args:
        intake: to be filled.
        folder: of the journal.
        run: number of the run.
        regret: is told, for a person, what is doubtful.

    Returns:
        The survey area.

    Raises:
        JournalError: it can't be replayed.
        CoreRaisedError: the core raised.
        OSError: it can't be read.
    """
    header = replay.run_header(folder, run)
    told = _Told(intake)
    outcome = replay.replay(folder, run, tolerance=_TOLERANCE, heard=told.heard)
    for text in outcome.troubles:
        regret(text)
    if outcome.differences:
        regret(
            f"{len(outcome.differences)} of {outcome.effects} effects are not what they were on board "
            f"(the first: {outcome.differences[0]}): so may be what is exported"
        )
    return replay.read_survey_area(header)


def _take(intake: Intake, one: Recorded) -> int:
    """How many values a record brings, 0 or 1; WireError if it is not what its key promises."""
    topic = _TOPICS.get(one.topic)
    if topic is None or topic is Topic.STATUS:
        return 0
    if topic is Topic.MODEL:
        return _take_model(intake, one)
    match wire.decode(topic, one.payload):
        case ObservationBatch() as batch:
            intake.take_readings(batch.run, batch.first, batch.items)
            intake.announce(batch.run, batch.end)
        case LogBatch() as batch:
            intake.take_lines(one.received_utc_s, batch.run, batch.first, batch.items)
        case HealthNotice() as health:
            intake.announce(health.run, health.observations_end)
            intake.take_state(one.received_utc_s, health)
        case PlanNotice() as plan:
            intake.take_plan(one.received_utc_s, plan)
        case SurveyNotice() as survey:
            intake.take_survey(survey)
    return 1


def _take_model(intake: Intake, one: Recorded) -> int:
    """Only the models that are kept are decoded whole, which takes a hundred times as long."""
    content = wire.parse(Topic.MODEL, one.payload)
    match content:
        case {
            "v": wire.VERSION,
            "run": int() as run,
            "model_time_s": float() as at,
            "utc_s": float() | None as utc_s,
        }:
            intake.take_model(one.received_utc_s, run, at, utc_s, one.payload)
        case _:
            wire.decode(Topic.MODEL, one.payload)
            raise wire.WireError("model: holds no times")
    return 1


class _Told:
    """What a replayed core publishes, as if it had been received."""

    def __init__(self, intake: Intake) -> None:
        self._intake = intake
        self._readings = self._lines = 0

    def heard(self, utc_s: float, effects: Sequence[Effect]) -> None:
        """The effects of one event, by the wall clock on board."""
        for effect in effects:
            if isinstance(effect, Publish):
                self._take(utc_s, effect.payload)

    def _take(self, utc_s: float, payload: Any) -> None:
        match payload:
            case ModelSnapshot():
                self._intake.take_model(utc_s, payload.run, payload.model_time_s, payload.utc_s, payload)
            case PlanNotice():
                self._intake.take_plan(utc_s, payload)
            case HealthNotice():
                self._intake.take_state(utc_s, payload)
            case LogNotice():
                self._intake.take_lines(utc_s, 0, self._lines, (payload,))
                self._lines += 1
            case tuple() as readings:
                self._intake.take_readings(0, self._readings, readings)
                self._readings += len(readings)
