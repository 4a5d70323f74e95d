"""Who learns a moving truth: learners driven as the core drives them, and the filter that knows it all."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from moving import FloatArray, MovingTruth, Patrol
from oracles import negative_log_density

from autonomy.config import EstimationSection, ExplorationSection
from autonomy.exploration import Exploration
from autonomy.learning.field_model import Prediction
from autonomy.learning.kernel import Kernel
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.replanning import figures


class Pupil(Protocol):
    """Takes readings and predicts the field as it is at the last one."""

    def read(self, point: FloatArray, value: float, time_s: float) -> None:
        """Take in a reading at `point` (2,), metres."""

    def predict(self, points: FloatArray) -> Prediction:
        """The field at the time of the last reading at `points` (n, 2)."""


class Filter:
    """The online model with a given kernel, which is never re-estimated."""

    def __init__(self, kernel: Kernel, capacity: int, novelty: float = 1e-3) -> None:
        self.gp = SparseOnlineGP(kernel, capacity, novelty)
        self._time_s = 0.0

    def read(self, point: FloatArray, value: float, time_s: float) -> None:
        self.gp.advance(time_s - self._time_s)
        self._time_s = time_s
        self.gp.update(point, value)

    def predict(self, points: FloatArray) -> Prediction:
        return self.gp.predict(points)


class Driven:
    """The learner, re-estimated when Algorithm 1 says so and at the latest every `interval_s`."""

    def __init__(self, learner: Learner, options: EstimationSection, interval_s: float) -> None:
        self.learner = learner
        self.reestimates = 0
        self._options = options
        self._exploration = Exploration(ExplorationSection(maximum_interval_s=interval_s))

    def read(self, point: FloatArray, value: float, time_s: float) -> None:
        learner = self.learner
        learner.add(point, value, time_s)
        while learner.catch_up():
            continue
        decision = self._exploration.decide(figures(learner, time_s))
        if learner.born and decision is not None and decision.reestimate:
            request = learner.reestimate_request(self.reestimates, self._options)
            learner.adopt(reestimate(request))
            self._exploration.reestimated(time_s, len(learner.history))
            self.reestimates += 1

    def predict(self, points: FloatArray) -> Prediction:
        return self.learner.model().predict(points)

    @property
    def kernel(self) -> Kernel:
        """What it believes in now."""
        return self.learner.gp.kernel


@dataclass
class Marks:
    """Of one pupil, one entry for each examination: mean square error and negative log density of the nowcast."""

    squares: list[float] = field(default_factory=list)
    densities: list[float] = field(default_factory=list)

    @property
    def rmse(self) -> float:
        """Of all examinations together."""
        return float(np.sqrt(np.mean(self.squares)))

    @property
    def nlpd(self) -> float:
        """Mean of all examinations, nats, for a field of variance 1."""
        return float(np.mean(self.densities))


@dataclass(frozen=True)
class Voyage:
    """A boat that reads every `spacing_m` and `interval_s`, with noise; the field is examined at `points`."""

    truth: MovingTruth
    patrol: Patrol
    points: FloatArray
    spacing_m: float
    interval_s: float
    noise: float
    rng: np.random.Generator

    def sail(self, pupils: Mapping[str, Pupil], samples: int, first: int, every: int) -> dict[str, Marks]:
        """All pupils hear the same readings; from the `first` sample on they are examined `every` so many."""
        marks = {name: Marks() for name in pupils}
        for number in range(1, samples + 1):
            self.truth.advance(self.interval_s)
            place = self.patrol.step(self.spacing_m)
            value = float(self.truth.value(place[None])[0]) + self.noise * self.rng.standard_normal()
            for pupil in pupils.values():
                pupil.read(place, value, number * self.interval_s)
            if number >= first and (number - first) % every == 0:
                truth = self.truth.value(self.points)
                for name, pupil in pupils.items():
                    prediction = pupil.predict(self.points)
                    variance = np.maximum(prediction.variance, 1e-12)
                    marks[name].squares.append(float(np.mean((prediction.mean - truth) ** 2)))
                    marks[name].densities.append(negative_log_density(prediction.mean, variance, truth))
        return marks
