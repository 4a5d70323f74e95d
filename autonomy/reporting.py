"""What the core tells people ashore: model, plan, observations, health and log, each when it is due."""

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from autonomy import __version__
from autonomy.config import Configuration
from autonomy.effects import Effect, Level, Log, Publish, Topic
from autonomy.learning.choice import Choice
from autonomy.learning.description import describe
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import Reestimate
from autonomy.mavlink.pairing import Observation
from autonomy.mavlink.rover import mode_name
from autonomy.mavlink.telemetry import Telemetry
from autonomy.planning.plan import Plan
from autonomy.planning.survey import SurveyArea
from autonomy.quality import Flags, aggregate
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


@dataclass(frozen=True)
class Status:
    """What the core itself knows about the survey.

    Attributes:
        state: what the service is doing.
        reason: why.
        rho: share of the basis that is new since the last re-estimate.
        plans: number of plans made.
        worker_busy: whether a job runs.
        in_touch: whether the autopilot is heard.
        distance_m: what has been sailed.
        quality: readings by flag and test.
    """

    state: str
    reason: str
    rho: float
    plans: int
    worker_busy: bool
    in_touch: bool
    distance_m: float
    quality: Mapping[str, tuple[int, ...]]


class Reporter:
    """Collects what there is to tell and turns it into Publish and Log effects.

    It looks at telemetry and learner and changes neither.
    """

    def __init__(
        self, configuration: Configuration, survey: SurveyArea, telemetry: Telemetry, learner: Learner
    ) -> None:
        self._configuration = configuration
        self._survey = survey
        self._telemetry = telemetry
        self._learner = learner
        self._configuration_hash = configuration_hash(configuration)
        self._model_schedule = _Schedule(configuration.shore.model_period_s)
        self._health_schedule = _Schedule(configuration.shore.health_period_s)
        self._observations: list[ObservationNotice] = []
        self._sequence = 0
        self._unreachable_sites = 0
        self._effects: list[Effect] = []

    def next_deadline(self) -> float:
        """When `step` must be called at the latest."""
        return min(self._model_schedule.due, self._health_schedule.due)

    def resume(self, away_s: float) -> None:
        """The service was away for so long, or is no more sure what it said since: numbers are not used twice."""
        self._effects.clear()
        self._model_schedule.due = self._health_schedule.due = 0.0
        self._sequence += math.ceil(away_s / self._model_schedule.period_s) + 1

    def observed(self, observation: Observation, flags: Flags) -> None:
        """A reading that teaches the model, or that would if its quality were better."""
        flag, checks = int(aggregate(flags)), tuple(map(int, flags))
        place = (observation.model_time_s, observation.lat_deg, observation.lon_deg)
        self._observations.append(ObservationNotice(*place, observation.value, flag, checks))

    def reestimated(self, found: Reestimate) -> None:
        """The model was rebuilt, under other hyperparameters if the fit found any."""
        if found.fit.kept_start:
            self.log(Level.INFO, f"hyperparameters kept: {found.fit.message}")
            return
        kernel = found.kernel
        self.log(
            Level.INFO,
            f"re-estimated: mean {found.prior_mean:.3f}, signal sd {kernel.signal_variance**0.5:.3g}, "
            f"noise sd {kernel.noise_variance**0.5:.3g}; {describe(kernel)} ({_lead(found.choice)})",
        )

    def planned(self, plan: Plan, sequence: int) -> None:
        """A new plan is on its way on board."""
        start, *route = self._survey.frame.to_geodetic([plan.start_m, *plan.route_m]).tolist()
        notice = PlanNotice(
            sequence=sequence,
            start_deg=tuple(start),
            route_deg=tuple((lat, lon) for lat, lon in route),
            is_spot=tuple(bool(mark) for mark in plan.is_spot),
            mutual_information=plan.mutual_information,
            planner=plan.planner,
            reason=plan.reason,
            objective_before=plan.objective_before,
            objective_after=plan.objective_after,
            expected_rmse=plan.expected_rmse,
            rejected=plan.rejected,
            seed=plan.seed,
            model_version=plan.model_version,
        )
        self._effects.append(Publish(Topic.PLAN, notice))
        self.log(Level.INFO, f"plan {sequence} ({plan.reason}): {_worth(plan)}")
        if plan.unreachable_sites != self._unreachable_sites:
            self._unreachable_sites = plan.unreachable_sites
            count = plan.unreachable_sites
            self.log(
                Level.WARNING,
                f"no way over water leads to {count} of the candidate sites: they stay unsampled",
            )

    def log(self, level: Level, text: str) -> None:
        """A line for the log on board and, from INFO on, for people ashore."""
        self._effects.append(Log(level, text))
        if level is not Level.DEBUG:
            line = LogNotice(level.name.lower(), text, self.utc_s)
            self._effects.append(Publish(Topic.LOG, line))

    def step(self, now: float, status: Callable[[], Status]) -> None:
        """Publish what is due; `status` is only asked when something is."""
        if self._health_schedule.take(now):
            self._tell_health(status())
        if self._model_schedule.take(now):
            self._tell_model(status())

    def flush(self, status: Status) -> None:
        """The last words before a stop: nothing learned so far stays untold."""
        self._tell_health(status)
        self._tell_model(status)

    def take(self) -> list[Effect]:
        """The effects collected since the last call, in order."""
        effects, self._effects = self._effects, []
        return effects

    def _tell_health(self, status: Status) -> None:
        self._effects.append(Publish(Topic.HEALTH, self._health(status)))
        if self._observations:
            self._effects.append(Publish(Topic.OBSERVATIONS, tuple(self._observations)))
            self._observations = []

    def _tell_model(self, status: Status) -> None:
        if not self._learner.born:
            # Nothing is believed yet; after a restart, an empty map would wipe the last good one ashore.
            return
        self._sequence += 1
        self._effects.append(Publish(Topic.MODEL, self._snapshot(status)))

    @property
    def utc_s(self) -> float | None:
        """The vehicle's clock in seconds since 1970, None while they are not known."""
        offset_s, vehicle = self._telemetry.utc_offset_s, self._telemetry.state
        if offset_s is None or vehicle is None or vehicle.model_time_s is None:
            return None
        return max(0.0, vehicle.model_time_s + offset_s)

    def _snapshot(self, status: Status) -> ModelSnapshot:
        offset_s = self._telemetry.utc_offset_s
        vehicle = self._telemetry.state
        model_time_s = 0.0 if vehicle is None else vehicle.model_time_s or 0.0
        return ModelSnapshot(
            vehicle=self._configuration.vehicle.name,
            sequence=self._sequence,
            software_version=__version__,
            variable=self._configuration.sensor.variable,
            units=self._configuration.sensor.units,
            model=self._learner.model(model_time_s),
            model_time_s=model_time_s,
            utc_s=None if offset_s is None else model_time_s + offset_s,
            samples=self._learner.samples,
            rho=status.rho,
            replans=status.plans,
            calibration=self._learner.calibration.figures,
            ahead=self._learner.ahead.figures,
            origin_lat_deg=self._survey.frame.origin_lat_deg,
            origin_lon_deg=self._survey.frame.origin_lon_deg,
            bounds_m=self._survey.bounds,
            survey=self._configuration.survey.name,
            capacity=self._learner.capacity,
            rho0=self._configuration.exploration.rho0,
            configuration_hash=self._configuration_hash,
        )

    def _health(self, status: Status) -> HealthNotice:
        vehicle = self._telemetry.state
        return HealthNotice(
            state=status.state,
            reason=status.reason,
            mode="unknown" if vehicle is None else mode_name(vehicle.mode),
            armed=vehicle is not None and vehicle.armed,
            lat_deg=None if vehicle is None else vehicle.lat_deg,
            lon_deg=None if vehicle is None else vehicle.lon_deg,
            heading_deg=None if vehicle is None else vehicle.heading_deg,
            groundspeed_mps=None if vehicle is None else vehicle.groundspeed_mps,
            model_time_s=None if vehicle is None else vehicle.model_time_s,
            samples=self._learner.samples,
            basis_size=len(self._learner.basis),
            rho=status.rho,
            rho0=self._configuration.exploration.rho0,
            replans=status.plans,
            kernel=describe(self._learner.gp.kernel) if self._learner.born else "",
            calibration=self._learner.calibration.figures,
            ahead=self._learner.ahead.figures,
            repairs=self._learner.repairs,
            distance_m=status.distance_m,
            clock_rate=self._telemetry.clock_rate,
            link_ok=status.in_touch,
            worker_busy=status.worker_busy,
            dropped=0,
            journal="",
            quality=status.quality,
        )


def configuration_hash(configuration: Configuration) -> str:
    """Sixteen hexadecimal digits that are equal for equal configurations."""
    return hashlib.blake2b(configuration.model_dump_json().encode(), digest_size=8).hexdigest()


def _lead(choice: Choice) -> str:
    """The structure that was chosen, and by how many nats: "long_short, 6.1 nats before matern32"."""
    scores = dict(choice.scores)
    best = scores.pop(choice.fit.structure)
    if not scores:
        return choice.fit.structure
    second = max(scores, key=lambda name: scores[name])
    return f"{choice.fit.structure}, {best - scores[second]:.1f} nats before {second}"


def _worth(plan: Plan) -> str:
    """What a plan is made of and promises: "20 spots, 12.3 km, 4.53 nats, route 0.71 after 0.80, expected rmse 0.2"."""
    parts = [f"{len(plan.spots_m)} spots", f"{plan.length_m / 1e3:.1f} km"]
    if plan.mutual_information > 0.0:
        parts.append(f"{plan.mutual_information:.2f} nats")
    if plan.objective_after is not None:
        before = "" if plan.objective_before is None else f" after {plan.objective_before:.4g}"
        parts.append(f"{plan.planner} {plan.objective_after:.4g}{before}")
    if plan.expected_rmse is not None:
        parts.append(f"expected rmse {plan.expected_rmse:.3g}")
    return ", ".join(parts)
