"""A voyage over a known field: the daemon's own core on the discrete driver, and a record of all that came of it.

What is sailed is what the core decides, or what another planner chooses; vessel, wire, sampling and learner are the
same either way. The simulated vessel is a nimble one, and no time of its own passes while the core's jobs are computed
but `_JOB_SAMPLES`: on a real boat a sample takes minutes, and a plan seconds.
"""

from dataclasses import dataclass, field, replace
from time import thread_time

import numpy as np

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Effect, Topic
from autonomy.events import Event, JobFinished, StopRequested
from autonomy.exploration import Exploration
from autonomy.geometry import LocalFrame
from autonomy.learning.learner import Learner
from autonomy.planning.restrictions import restricted
from autonomy.planning.survey import SurveyArea
from autonomy.quality import Flag, refused_by
from autonomy.replanning import figures
from autonomy.situation import State
from autonomy.wire import ObservationNotice
from sim.autopilot import Autopilot, Options
from sim.discrete import DiscreteRun
from sim.experiment.logbook import Cost, Judgement, Occasion, Reestimation, Replan, Samples, Voyage
from sim.experiment.orders import Orders
from sim.experiment.probe import Probe, make_probe
from sim.vessel import Handling, Position, Vessel

_HANDLING = Handling(acceleration_mps2=1e3, turn_rate_deg_s=360.0)
_SAMPLE_S = (
    10.0  # of the vessel's time, where no speed is given: in steps of a second it follows the route well
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


class VoyageError(RuntimeError):
    """The voyage can't go on; the text says why, for a person."""


def sail(orders: Orders) -> Voyage:
    """Sail a voyage to its end.

    Raises:
        VoyageError: no mission comes on board, or no more samples come.
    """
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
    return run.record()


class _MeasuredCore(Core):
    """The core, and what it has cost."""

    spent_s = 0.0

    def handle(self, now: float, event: Event) -> list[Effect]:
        begun_s = thread_time()
        effects = super().handle(now, event)
        self.spent_s += thread_time() - begun_s
        return effects


@dataclass
class _Sailing(DiscreteRun):
    """A discrete run that keeps a logbook."""

    orders: Orders = field(kw_only=True)
    probe: Probe = field(kw_only=True)
    plans: list[Replan] = field(default_factory=list)
    reestimates: list[Reestimation] = field(default_factory=list)
    judgements: list[Judgement] = field(default_factory=list)
    has_ended: bool = False
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
        probe = make_probe(orders, vessel, speed_mps, sample_s)
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

    def record(self) -> Voyage:
        """What came of it, after the core's last words."""
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
            cost=Cost(self.core.spent_s, self.jobs_s),
        )


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
    return Exploration(configuration.exploration).rho(figures(learner, model_time_s=0.0))
