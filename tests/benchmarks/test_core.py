"""Speed of the core on a whole simulated survey: what a message costs beyond packing and parsing it."""

import timeit

import numpy as np

from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.events import MessageReceived
from autonomy.mavlink.codec import Codec
from autonomy.planning.survey import read_survey
from sim.autopilot import Autopilot, Options
from sim.discrete import DiscreteRun
from sim.field import open_field
from sim.sensor import Sensor
from sim.vessel import Position, Vessel

CORNERS = [[33.925, -118.865], [33.925, -118.73], [33.98, -118.73], [33.98, -118.865]]
SECONDS = 1200.0


class Clocked:
    """A core with a stop-watch: how long it thought about messages, and which."""

    def __init__(self, core):
        self._core = core
        self.spent_s = 0.0
        self.slowest_s = 0.0
        self.messages = []

    def handle(self, now, event):
        began = timeit.default_timer()
        effects = self._core.handle(now, event)
        took = timeit.default_timer() - began
        self.spent_s += took
        self.slowest_s = max(self.slowest_s, took)
        if isinstance(event, MessageReceived):
            self.messages.append(event.message)
        return effects

    def __getattr__(self, name):
        return getattr(self._core, name)


def test_messages(report, seconds):
    configuration = Configuration(survey={"area": CORNERS}, sampling={"spacing_m": 20.0})
    survey = read_survey(configuration.survey)
    field = open_field("synthetic-patch")
    sensor = Sensor(field, np.random.default_rng(0), interval_s=1.0, noise_std=0.007)
    autopilot = Autopilot(Vessel(Position(33.95, -118.8)), sensor, Options(speed_mps=10.0))
    core = Clocked(Core(configuration, survey))
    run = DiscreteRun(core, autopilot, survey)
    run.start_survey()
    run.advance(SECONDS)
    count = len(core.messages)
    packets = [bytes(message.get_msgbuf()) for message in core.messages]
    codec = Codec(1, 191)
    parsing = seconds(lambda: [codec.decode(packet, "core") for packet in packets], 3) / count
    plans = sum(text.startswith("plan ") for _, text in run.log)
    note = f"{count / core.spent_s:.0f} a second, slowest {core.slowest_s * 1e3:.1f} ms; plans made: {plans}"
    report(
        "an event in the core, learning included", core.spent_s / count, "parsing the message", parsing, note
    )
