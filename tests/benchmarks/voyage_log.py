"""A short survey on the discrete driver, under a stop-watch."""

from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np

from autonomy import jobs
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.events import MessageReceived
from autonomy.jobs import ExploreRequest
from autonomy.planning.survey import SurveyArea, read_survey
from sim.autopilot import Autopilot, Options
from sim.discrete import DiscreteRun
from sim.field import open_field
from sim.sensor import Sensor
from sim.vessel import Position, Vessel

CORNERS = [[33.925, -118.865], [33.925, -118.73], [33.98, -118.73], [33.98, -118.865]]


@dataclass
class Voyage:
    """What it took. `lasted_s` is its time on the water, `core_s` what the core took to think, `spent_s` what all took.

    `request` is what a re-plan at its end would ask of the worker.
    """

    survey: SurveyArea
    lasted_s: float
    core_s: float = 0.0
    slowest_s: float = 0.0
    spent_s: float = 0.0
    plans: int = 0
    packets: list[bytes] = field(default_factory=list)
    request: ExploreRequest | None = None


class Clocked:
    """A core with a stop-watch."""

    def __init__(self, core, voyage):
        self._core, self._voyage = core, voyage

    def handle(self, now, event):
        began = process_time()
        effects = self._core.handle(now, event)
        took = process_time() - began
        self._voyage.core_s += took
        self._voyage.slowest_s = max(self._voyage.slowest_s, took)
        if isinstance(event, MessageReceived):
            self._voyage.packets.append(bytes(event.message.get_msgbuf()))
        return effects

    def __getattr__(self, name):
        return getattr(self._core, name)


def sailed(seconds, speedup):
    """Seconds of protocol time, `speedup` as many of the vessel's, at 10 m/s, a reading every 20 m."""
    configuration = Configuration(survey={"area": CORNERS}, sampling={"spacing_m": 20.0})
    survey = read_survey(configuration.survey)
    voyage = Voyage(survey, seconds * speedup)
    sensor = Sensor(open_field("synthetic-patch"), np.random.default_rng(0), interval_s=1.0, noise_std=0.007)
    autopilot = Autopilot(Vessel(Position(33.95, -118.8)), sensor, Options(speed_mps=10.0))

    def do(name, request, context):
        if request.plan is not None:
            voyage.request = request
        return jobs.run(name, request, context)

    core = Core(configuration, survey)
    run = DiscreteRun(Clocked(core, voyage), autopilot, survey, run_job=do, speedup=speedup)
    run.start_survey()
    began = process_time()
    run.advance(seconds)
    voyage.spent_s = process_time() - began
    voyage.plans = sum(text.startswith("plan ") for _, text in run.log)
    learner = core._learner
    plan = replace(voyage.request.plan, model=learner.model(None), measured=learner.history.cells())
    voyage.request = replace(
        voyage.request, reestimate=learner.reestimate_request(0, configuration.estimation), plan=plan
    )
    return voyage
