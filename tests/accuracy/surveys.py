"""A survey of a still field: the learner as the core drives it, along a lawnmower's track, with noise."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from sea_fields import FloatArray, SeaField
from tracks import lawnmower

from autonomy.config import EstimationSection, ExplorationSection
from autonomy.exploration import Exploration
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate
from autonomy.replanning import figures

INTERVAL_S = 120.0
"""Between samples: 10 × 10 km at 200 m and 1.7 m/s. Re-estimates come about every thirty samples, then."""
NOISE = 0.02
"""Standard deviation of the readings' noise, as a share of the field's."""


@dataclass(frozen=True)
class Survey:
    """The readings of one survey: places `x` (n, 2) metres, values `y` (n,), and the noise in them."""

    field: SeaField
    length: int
    across: bool
    x: FloatArray
    y: FloatArray
    noise: float

    @property
    def name(self) -> str:
        return f"{self.field.name} {self.length} {'across' if self.across else 'along'}"


def survey(field: SeaField, length: int, across: bool) -> Survey:
    """A lawnmower of `length` × √(water area) over `field`."""
    x = lawnmower(field, length, across)
    noise = NOISE * float(field.truth.std())
    rng = np.random.default_rng([length, across, *field.name.encode()])
    return Survey(field, length, across, x, field.at(x) + noise * rng.normal(size=len(x)), noise)


def learners(sailed: Survey) -> Iterator[Learner]:
    """The default learner after each tenth of the survey, driven as the core does.

    It is re-estimated when Algorithm 1 says so and, as the path is finished then, at the end.
    """
    options, exploration = EstimationSection(), Exploration(ExplorationSection())
    field, count, estimates = sailed.field, len(sailed.x), 0
    learner = Learner(field.span_m, area_m2=field.side_m**2)
    tenths = [round(count * tenth / 10) for tenth in range(1, 11)]
    for number, (x, y) in enumerate(zip(sailed.x, sailed.y, strict=True), start=1):
        time_s = number * INTERVAL_S
        learner.add(x, float(y), time_s)
        while learner.catch_up():
            pass
        decision = exploration.decide(figures(learner, time_s, path_finished=number == count))
        if learner.born and decision is not None and decision.reestimate:
            learner.adopt(reestimate(learner.reestimate_request(estimates, options)))
            exploration.reestimated(time_s, len(learner.history))
            estimates += 1
            while learner.catch_up():
                pass
        if number in tenths:
            yield learner


def surveyed(sailed: Survey) -> Learner:
    """The learner at the end of the survey."""
    *_, last = learners(sailed)
    return last
