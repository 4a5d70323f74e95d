"""A voyage over a known field: the daemon's own core on the discrete driver, and a record of all that came of it.

What is sailed is what the core decides, or waypoints that are given; vessel, wire, sampling and learner are the same
either way. The simulated vessel is a nimble one, and no time of its own passes while the core's jobs are computed
but `_JOB_SAMPLES`: on a real boat a sample takes minutes, and a plan seconds.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import thread_time
from typing import Literal

import numpy as np

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Effect, Topic
from autonomy.events import Event, JobFinished, StopRequested
from autonomy.exploration import Exploration, Figures
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Kernel
from autonomy.learning.learner import Learner
from autonomy.planning.plan import NO_SPOTS, Plan
from autonomy.planning.planners import PlanRequest
from autonomy.planning.restrictions import restricted
from autonomy.planning.survey import SurveyArea
from autonomy.quality import Flag, refused_by
from autonomy.situation import State
from autonomy.wire import ObservationNotice
from sim.autopilot import Autopilot, Options
from sim.discrete import DiscreteRun
from sim.sensor import Sensor
from sim.truth_map import TruthMap
from sim.vessel import Handling, Position, Vessel

READINGS_PER_SAMPLE = 5
"""The probe reads so often between two samples: after a turn a sample comes at most this share of the spacing late."""

_HANDLING = Handling(acceleration_mps2=1e3, turn_rate_deg_s=360.0)
_SAMPLE_S = (
    10.0  # of the vessel's time, where no speed is given: steps of at most a second follow the route well
)
_TOP_SPEED_MPS = 30.0  # positions that come by faster than 50 m/s count as glitches
_PROTOCOL_S = 0.5  # a sample, in protocol time: the telemetry's 1 Hz is every other sample
_POSITIONS_HZ = 1.0  # beside those that come with every reading
_JOB_SAMPLES = 0.1
_ROUNDED_UP = (
    1.002  # positions on the wire have centimetres: readings must not come just short of the spacing
)
_PATIENCE_SAMPLES = 300
_OLD_NEWS_S = 1e6

Planner = Callable[[PlanRequest, SurveyArea], Plan | None]
"""What chooses the way instead of the configured planner; None ends the voyage."""

Occasion = Literal["under way", "before re-estimate", "after re-estimate"]


class VoyageError(RuntimeError):
    """The voyage can't go on; the text says why, for a person."""


@dataclass(frozen=True, eq=False)
class Orders:
    """What is to be sailed.

    Attributes:
        waters: the truth, the survey, and the map on which beliefs are judged.
        configuration: the core's, with a `sampling.spacing_m`; whose survey section is not looked at.
        launch_m: shape (2,), local metres, navigable.
        samples: the voyage ends when so many have been learnt; None: `distance_m` ends it.
        distance_m: or when so much has been sailed; None: `samples` ends it. A budget may end it before, at home.
        noise: standard deviation of a reading.
        seed: of the readings' noise. The core's own is in the configuration.
        speed_mps: of the vessel; None: a sample every ten seconds, which is right for seas that don't move.
        planner: chooses the way; None: the configured one. See `following`.
        judgements: the model is judged so often, at equal parts of the voyage.
        keep_models: whether judgements and plans keep their models.
        known_m: shape (k, 2), local metres: places whose values are known before the launch; None: of none.
        known: their values, shape (k,).
        spots_only: whether the probe is read at the spots of the plans only, once each, instead of all along the way.
    """

    waters: TruthMap
    configuration: Configuration
    launch_m: FloatArray
    samples: int | None = None
    distance_m: float | None = None
    noise: float = 0.0
    seed: int = 0
    speed_mps: float | None = None
    planner: Planner | None = None
    judgements: int = 80
    keep_models: bool = False
    known_m: FloatArray | None = None
    known: FloatArray | None = None
    spots_only: bool = False

    def __post_init__(self) -> None:
        if self.samples is None and self.distance_m is None:
            raise ValueError("a voyage needs an end: samples, distance_m or both")
        if not self.configuration.sampling.spacing_m > 0.0:
            raise ValueError("a voyage needs sampling.spacing_m above 0")
        if (self.known_m is None) != (self.known is None):
            raise ValueError("what is known needs known_m, the places, and known, the values")


@dataclass(frozen=True, eq=False)
class Samples:
    """What taught the model, in order: `time_s` (n,) of the vessel, `points_m` (n, 2), `values` (n,)."""

    time_s: FloatArray
    points_m: FloatArray
    values: FloatArray

    def __len__(self) -> int:
        return len(self.values)


@dataclass(frozen=True, eq=False)
class Judgement:
    """The belief held against the truth over the water, after so many samples and metres.

    `rho` is the paper's; `model` is kept if the orders say so.
    """

    occasion: Occasion
    samples: int
    distance_m: float
    time_s: float
    rmse: float
    rho: float
    basis_size: int
    model: FieldModel | None = None


@dataclass(frozen=True, eq=False)
class Replan:
    """A plan as the planner made it; `rho` is that of the decision, `model` what was planned with."""

    samples: int
    distance_m: float
    time_s: float
    rho: float
    plan: Plan
    model: FieldModel | None = None


@dataclass(frozen=True, eq=False)
class Reestimation:
    """A re-estimate: the kernel that the model was rebuilt under, from how many points; `kept`: the fit found none."""

    samples: int
    kernel: Kernel
    points: int
    kept: bool


@dataclass(frozen=True)
class Cost:
    """CPU seconds: of the core (the learner's updates among them), of its jobs, and of all but the judging."""

    core_s: float
    jobs_s: float
    total_s: float


@dataclass(frozen=True, eq=False)
class Voyage:
    """All that came of a voyage.

    Attributes:
        samples: what taught the model.
        track_m: shape (k, 2), where the probe was read, samples or not.
        distance_m: sailed from the launch on.
        plans: in the order in which they were made.
        reestimates: the same.
        judgements: the same; `curve` are those at equal parts of the voyage.
        model: what is believed at the end.
        field_std: standard deviation of the truth over the water at the end.
        refused: how many readings at the samples' spacing were too bad to teach.
        log: lines of the core's log.
        cost: what it took; the one thing here that another run does not give again.
    """

    samples: Samples
    track_m: FloatArray
    distance_m: float
    plans: tuple[Replan, ...]
    reestimates: tuple[Reestimation, ...]
    judgements: tuple[Judgement, ...]
    model: FieldModel
    field_std: float
    refused: int
    log: tuple[str, ...]
    cost: Cost

    @property
    def curve(self) -> tuple[Judgement, ...]:
        """The judgements at equal parts of the voyage."""
        return tuple(each for each in self.judgements if each.occasion == "under way")


def sail(orders: Orders) -> Voyage:
    """Sail a voyage to its end.

    Raises:
        VoyageError: no mission comes on board, or no more samples come.
    """
    begun_s = thread_time()
    run = _Sailing.begin(orders)
    try:
        run.start_survey()
    except RuntimeError as error:
        raise VoyageError(str(error)) from error
    while not run.is_over:
        known = run.core.learner.samples
        is_over = run.advance(_PATIENCE_SAMPLES * _PROTOCOL_S, until=lambda: run.is_over)
        if not is_over and run.core.learner.samples == known:
            raise VoyageError(f"no more samples come after {known}; the last words: {run.log[-3:]}")
    run.happened(StopRequested())
    return run.record(thread_time() - begun_s)


def following(route_m: FloatArray) -> Planner:
    """A planner of one plan: these waypoints (n, 2), local metres, once; the voyage ends with them.

    No leg may leave the survey's navigable water. The configuration must not let the core plan anew under way: see
    `on_rails`.
    """
    routes = [np.asarray(route_m, dtype=float).reshape(-1, 2)]

    def plan(request: PlanRequest, survey: SurveyArea) -> Plan | None:
        if not routes:
            return None
        route = routes.pop()
        return Plan(
            request.start_m, route, np.ones(len(route), dtype=bool), NO_SPOTS, "given", request.reason
        )

    return plan


def on_rails(configuration: Configuration) -> Configuration:
    """The configuration with which the core re-estimates nothing and plans anew only where a path has ended."""
    exploration = configuration.exploration.model_copy(
        update={
            "rho0": 1.0,
            "rho_rule": "added",
            "maximum_interval_s": None,
            "outgrown_ratio": None,
            "reestimate_on_path_end": False,
        }
    )
    return configuration.model_copy(update={"exploration": exploration})


class _MeasuredCore(Core):
    """The core, and what it has cost."""

    spent_s = 0.0

    def handle(self, now: float, event: Event) -> list[Effect]:
        begun_s = thread_time()
        effects = super().handle(now, event)
        self.spent_s += thread_time() - begun_s
        return effects


@dataclass
class _Probe(Sensor):
    """A sensor that remembers where it was read."""

    positions: list[Position] = field(default_factory=list)

    def read(self, position: Position, time_s: float) -> float:
        self.positions.append(position)
        return super().read(position, time_s)

    def told(self, spots: list[Position]) -> None:
        """Another plan has these spots."""


@dataclass
class _SpotProbe(_Probe):
    """A probe that is read once at each spot of the newest plan, within `reach_m` of it."""

    vessel: Vessel = field(kw_only=True)
    reach_m: float = field(kw_only=True)
    spots: list[Position] = field(default_factory=list)

    @property
    def next_time_s(self) -> float:
        return -math.inf if self._near(self.vessel.position) else math.inf

    def read(self, position: Position, time_s: float) -> float:
        self.spots = [spot for spot in self.spots if spot not in self._near(position)]
        return super().read(position, time_s)

    def told(self, spots: list[Position]) -> None:
        self.spots = spots

    def _near(self, position: Position) -> list[Position]:
        return [spot for spot in self.spots if position.distance_to(spot) <= self.reach_m]


@dataclass
class _Sailing(DiscreteRun):
    """A discrete run that keeps a logbook."""

    orders: Orders = field(kw_only=True)
    probe: _Probe = field(kw_only=True)
    plans: list[Replan] = field(default_factory=list)
    reestimates: list[Reestimation] = field(default_factory=list)
    judgements: list[Judgement] = field(default_factory=list)
    has_ended: bool = False
    judging_s: float = 0.0
    jobs_s: float = 0.0
    _rho_before: float = 0.0
    _judged_parts: int = 0

    @classmethod
    def begin(cls, orders: Orders) -> "_Sailing":
        """Vessel and core as they are before the survey is started."""
        survey, spacing_m = orders.waters.survey, orders.configuration.sampling.spacing_m
        speed_mps = orders.speed_mps or min(_TOP_SPEED_MPS, spacing_m / _SAMPLE_S)
        sample_s = _ROUNDED_UP * spacing_m / speed_mps
        lat_deg, lon_deg = survey.frame.to_geodetic(orders.launch_m).tolist()
        # The vessel is not stopped by land: routes are checked against it, and a boat this fast swings wide.
        vessel = Vessel(Position(lat_deg, lon_deg), handling=_HANDLING)
        probe = _probe(orders, vessel, speed_mps, sample_s)
        run = cls(
            _MeasuredCore(_fitted(orders.configuration), survey),
            Autopilot(vessel, probe, Options(speed_mps=speed_mps)),
            survey,
            job_s=_JOB_SAMPLES * _PROTOCOL_S,
            speedup=sample_s / _PROTOCOL_S,
            orders=orders,
            probe=probe,
        )
        if orders.known_m is not None and orders.known is not None:
            for place, value in zip(orders.known_m, orders.known, strict=True):
                run.core.learner.add(place, float(value), vessel.time_s)
        run.run_job = run.work
        return run

    @property
    def is_over(self) -> bool:
        """Whether what was ordered has been sailed, or the core has brought the vessel home within its budget."""
        health = self.published[Topic.HEALTH]
        is_home = bool(health) and health[-1].state == State.FINISHED.name.lower()
        return self.has_ended or is_home or self._part >= 1.0

    @property
    def _part(self) -> float:
        """How much of the voyage has been sailed, from 0 to 1 or a little more."""
        samples, distance_m = self.orders.samples, self.orders.distance_m
        by_samples = 0.0 if samples is None else self.core.learner.samples / samples
        by_distance = 0.0 if distance_m is None else self.autopilot.vessel.distance_sailed_m / distance_m
        return max(by_samples, by_distance)

    @property
    def _time_s(self) -> float:
        return self.autopilot.vessel.time_s

    def happened(self, event: Event) -> None:
        """As any discrete run, and judge what is believed when it is time to."""
        adopts = isinstance(event, JobFinished) and event.result.reestimate is not None
        if adopts:
            self._judge("before re-estimate")
        self._rho_before = _rho(self.core.learner, self.orders.configuration)
        super().happened(event)
        if adopts:
            self._judge("after re-estimate")
        part = min(1.0, self._part)
        if int(part * self.orders.judgements) > self._judged_parts and self.core.learner.born:
            self._judged_parts = int(part * self.orders.judgements)
            self._judge("under way")

    def work(self, name: str, request: jobs.ExploreRequest, survey: SurveyArea) -> jobs.ExploreResult:
        """Do a job, by the planner that was ordered if there is one, and note what came of it."""
        begun_s = thread_time()
        result = self._planned(name, request, survey)
        self.jobs_s += thread_time() - begun_s
        learner, found = self.core.learner, result.reestimate
        if found is not None:
            kept = found.fit.kept_start
            self.reestimates.append(Reestimation(learner.samples, found.kernel, found.points, kept))
        if result.plan is not None and request.plan is not None:
            model = request.plan.model if found is None else found.gp.model()
            # The core has counted anew already where a path was finished.
            rho = self._rho_before if found is None else _rho(learner, self.orders.configuration)
            kept_model = model if self.orders.keep_models else None
            distance_m = self.autopilot.vessel.distance_sailed_m
            self.plans.append(Replan(learner.samples, distance_m, self._time_s, rho, result.plan, kept_model))
            places = survey.frame.to_geodetic(result.plan.spots_m).tolist()
            self.probe.told([Position(lat_deg, lon_deg) for lat_deg, lon_deg in places])
        return result

    def _planned(self, name: str, request: jobs.ExploreRequest, survey: SurveyArea) -> jobs.ExploreResult:
        planner, problem = self.orders.planner, request.plan
        if planner is None or problem is None:
            done: jobs.ExploreResult = jobs.run(name, request, survey)
            return done
        learnt: jobs.ExploreResult = jobs.run(name, replace(request, plan=None), survey)
        if learnt.reestimate is not None:
            problem = replace(problem, model=learnt.reestimate.gp.model())
        plan = planner(problem, restricted(survey, request.restrictions))
        if plan is None:
            self.has_ended = True
            return replace(learnt, problem="the voyage is over")
        return replace(learnt, plan=plan)

    def _judge(self, occasion: Occasion) -> None:
        begun_s = thread_time()
        learner = self.core.learner
        model = learner.model(self._time_s)
        rmse, _ = self.orders.waters.judge(model, self._time_s)
        judgement = Judgement(
            occasion,
            learner.samples,
            self.autopilot.vessel.distance_sailed_m,
            self._time_s,
            rmse,
            _rho(learner, self.orders.configuration),
            len(model),
            model if self.orders.keep_models else None,
        )
        self.judgements.append(judgement)
        self.judging_s += thread_time() - begun_s

    def record(self, spent_s: float) -> Voyage:
        """What came of it, after the core's last words; `spent_s` is the CPU time of all."""
        assert isinstance(self.core, _MeasuredCore)
        frame = self.orders.waters.survey.frame
        told = [each for batch in self.published[Topic.OBSERVATIONS] for each in batch]
        samples = _samples([each for each in told if _teaches(each, self.orders.configuration)], frame)
        return Voyage(
            samples=samples,
            track_m=frame.to_local(*np.transpose(self.probe.positions)),
            distance_m=self.autopilot.vessel.distance_sailed_m,
            plans=tuple(self.plans),
            reestimates=tuple(self.reestimates),
            judgements=tuple(self.judgements),
            model=self.core.learner.model(self._time_s),
            field_std=float(np.nanstd(self.orders.waters.truth(self._time_s))),
            refused=len(told) - len(samples),
            log=tuple(text for _, text in self.log),
            cost=Cost(self.core.spent_s, self.jobs_s, spent_s - self.judging_s),
        )


def _probe(orders: Orders, vessel: Vessel, speed_mps: float, sample_s: float) -> _Probe:
    truth, rng = orders.waters.field, np.random.default_rng(orders.seed)
    name, interval_s = orders.configuration.sensor.message_name, sample_s / READINGS_PER_SAMPLE
    if not orders.spots_only:
        return _Probe(truth, rng, name, interval_s, orders.noise)
    # In a step of a second the vessel gets that far.
    return _SpotProbe(truth, rng, name, interval_s, orders.noise, vessel=vessel, reach_m=speed_mps)


def _fitted(configuration: Configuration) -> Configuration:
    """The configuration of the vessel that sails here, of which nobody follows the model ashore."""
    vehicle = configuration.vehicle.model_copy(update={"turn_rate_deg_s": _HANDLING.turn_rate_deg_s})
    mavlink = configuration.mavlink.model_copy(update={"position_rate_hz": _POSITIONS_HZ})
    shore = configuration.shore.model_copy(update={"model_period_s": _OLD_NEWS_S})
    return configuration.model_copy(update={"vehicle": vehicle, "mavlink": mavlink, "shore": shore})


def _teaches(notice: ObservationNotice, configuration: Configuration) -> bool:
    """Whether a reading that was told ashore has taught, which the core decides by the same flags."""
    allowed = {Flag.GOOD} if configuration.quality.learn_from == "good" else {Flag.GOOD, Flag.SUSPECT}
    return refused_by(tuple(map(Flag, notice.checks)), allowed) is None


def _samples(told: list[ObservationNotice], frame: LocalFrame) -> Samples:
    columns = np.array([(each.model_time_s, each.lat_deg, each.lon_deg, each.value) for each in told])
    time_s, lat_deg, lon_deg, values = columns.reshape(-1, 4).T
    return Samples(time_s, frame.to_local(lat_deg, lon_deg), values)


def _rho(learner: Learner, configuration: Configuration) -> float:
    """The paper's rho of the moment, by the configured rule."""
    figures = Figures(
        model_time_s=0.0,
        basis_size=len(learner.basis),
        capacity=learner.capacity,
        fresh=learner.fresh_count,
        replaced=learner.replaced_since_mark,
        path_finished=False,
        cells=0,
        spread=0.0,
    )
    return Exploration(configuration.exploration).rho(figures)
