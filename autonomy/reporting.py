"""What the core tells people ashore: model, plan, observations, health and log, each when it is due."""

from collections.abc import Callable
from dataclasses import dataclass

from autonomy.config import Configuration
from autonomy.effects import Effect, Level, Log, Publish, Topic
from autonomy.mavlink.telemetry import Observation
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.wire import HealthNotice, LogNotice, ModelSnapshot, ObservationNotice, PlanNotice


@dataclass
class _Schedule:
    """A thing done every `period_s`, from the first time it is asked for."""

    period_s: float
    due: float = 0.0

    def take(self, now: float) -> bool:
        if now < self.due:
            return False
        self.due = now + self.period_s
        return True


class Reporter:
    """Collects what there is to tell and turns it into Publish and Log effects."""

    def __init__(self, configuration: Configuration, survey: SurveyArea) -> None:
        self._configuration = configuration
        self._survey = survey
        self._model_schedule = _Schedule(configuration.shore.model_period_s)
        self._health_schedule = _Schedule(configuration.shore.health_period_s)
        self._observations: list[ObservationNotice] = []
        self._sequence = 0
        self._effects: list[Effect] = []

    def next_deadline(self) -> float:
        """When `step` must be called at the latest."""
        return min(self._model_schedule.due, self._health_schedule.due)

    def observed(self, observation: Observation) -> None:
        """A reading that teaches the model."""
        self._observations.append(
            ObservationNotice(
                observation.model_time_s, observation.lat_deg, observation.lon_deg, observation.value
            )
        )

    def planned(self, plan: Plan, sequence: int) -> None:
        """A new plan."""
        start, *route = self._survey.frame.to_geodetic([plan.start_m, *plan.route_m]).tolist()
        notice = PlanNotice(
            sequence=sequence,
            start_deg=tuple(start),
            route_deg=tuple((lat, lon) for lat, lon in route),
            is_spot=tuple(bool(mark) for mark in plan.is_spot),
            mutual_information=plan.mutual_information,
            planner=plan.planner,
            reason=plan.reason,
        )
        self._effects.append(Publish(Topic.PLAN, notice))

    def log(self, level: Level, text: str) -> None:
        """A line for the log on board and, from INFO on, for people ashore."""
        self._effects.append(Log(level, text))
        if level is not Level.DEBUG:
            self._effects.append(Publish(Topic.LOG, LogNotice(level.name.lower(), text)))

    def step(
        self, now: float, health: Callable[[], HealthNotice], snapshot: Callable[[int], ModelSnapshot]
    ) -> None:
        """Publish what is due; `health` and `snapshot(sequence)` are only asked when it is."""
        if self._health_schedule.take(now):
            self._tell_health(health())
        if self._model_schedule.take(now):
            self._tell_model(snapshot)

    def flush(self, health: HealthNotice, snapshot: Callable[[int], ModelSnapshot]) -> None:
        """The last words before a stop: nothing learned so far stays untold."""
        self._tell_health(health)
        self._tell_model(snapshot)

    def take(self) -> list[Effect]:
        """The effects collected since the last call, in order."""
        effects, self._effects = self._effects, []
        return effects

    def _tell_health(self, health: HealthNotice) -> None:
        self._effects.append(Publish(Topic.HEALTH, health))
        if self._observations:
            self._effects.append(Publish(Topic.OBSERVATIONS, tuple(self._observations)))
            self._observations = []

    def _tell_model(self, snapshot: Callable[[int], ModelSnapshot]) -> None:
        self._sequence += 1
        self._effects.append(Publish(Topic.MODEL, snapshot(self._sequence)))
