"""Water that moves: the learner's nowcast against one that does not forget, and against what is reachable.

Every line is a field of variance 1 on a square of 10 km, or the simulator's coastal sea in units of its own standard
deviation; a boat patrols it at random, reading every 50th of the side with noise of 0.1, and the learner is
re-estimated when Algorithm 1 says so and at the latest every 400 readings. Errors are those of the nowcast over all
water, root mean square over examinations. HALOCLINE_SEEDS: how many seas each line is averaged over (one by default);
the geometric mean of the ratios counts. From sea to sea the logarithms of the ratios scatter by .05 (to the true
filter), .1 (coast) and .2 to .4 (to a learner that does not forget, whose errors depend on which way the water went);
on the first sea, that of the short form, every ratio keeps clear of its bound by more than another rounding can make.
"""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from moving import CoastalSea, MovingTruth, OrnsteinUhlenbeckField, Patrol, Rotation, square
from pupils import Driven, Filter, Marks, Pupil, Voyage

from autonomy.config import EstimationSection
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.learner import Learner
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck

LONG = "HALOCLINE_SEEDS" in os.environ
SEEDS = int(os.environ.get("HALOCLINE_SEEDS", "1"))
pytestmark = pytest.mark.timeout(7200 if LONG else 600)
SPAN_M, SCALE_M, NOISE = 10_000.0, 2_000.0, 0.1
SAMPLE_S = 10.0
TAU = 2000 * SAMPLE_S
STATIC = EstimationSection(candidates=("squared_exponential", "matern32", "long_short"))
OU = EstimationSection(candidates=("ou",))
ALL = EstimationSection()


@dataclass(frozen=True)
class Lesson:
    """What the pupils of one sea were worth."""

    marks: dict[str, Marks]
    pupils: dict[str, Pupil]

    def ratio(self, one: str, other: str) -> float:
        return self.marks[one].rmse / self.marks[other].rmse

    def kernel(self, name: str) -> Kernel:
        pupil = self.pupils[name]
        assert isinstance(pupil, Driven)
        return pupil.kernel


def learners(
    span_m: float, area_m2: float, sample_s: float, **options: EstimationSection
) -> dict[str, Pupil]:
    return {
        name: Driven(Learner(span_m, area_m2=area_m2), option, 400 * sample_s)
        for name, option in options.items()
    }


def lesson(
    seed: int,
    make: Callable[[np.random.Generator], MovingTruth],
    samples: int,
    others: dict[str, Pupil] | None = None,
    **options: EstimationSection,
) -> Lesson:
    """On the square; examined every 200 samples over the last half."""
    rng = np.random.default_rng(seed)
    pupils = learners(SPAN_M, SPAN_M**2, SAMPLE_S, **options) | (others or {})
    truth = make(rng)
    voyage = Voyage(truth, Patrol(rng, SPAN_M), square(SPAN_M, 250.0), SPAN_M / 50.0, SAMPLE_S, NOISE, rng)
    return Lesson(voyage.sail(pupils, samples, samples // 2, 200), pupils)


def on_the_coast(seed: int, samples: int, sample_s: float, **options: EstimationSection) -> Lesson:
    rng = np.random.default_rng(seed)
    sea = CoastalSea(seed)
    area_m2 = len(sea.water_m) * 300.0**2
    pupils = learners(sea.span_m, area_m2, sample_s, **options)
    patrol = Patrol(rng, sea.span_m, sea.is_clear)
    voyage = Voyage(sea, patrol, sea.water_m, sea.span_m / 50.0, sample_s, NOISE, rng)
    return Lesson(voyage.sail(pupils, samples, samples // 2, 200), pupils)


def true_filter(timescale_s: float) -> Filter:
    component = Component(1.0, SquaredExponential((SCALE_M, SCALE_M)), OrnsteinUhlenbeck(timescale_s))
    return Filter(Kernel((component,), NOISE**2), capacity=150)


def told(line: str, lessons: list[Lesson]) -> None:
    """A row for every sea: RMSE and NLPD of every pupil."""
    for seed, each in enumerate(lessons):
        figures = ", ".join(f"{name} {m.rmse:.3f} ({m.nlpd:.2f})" for name, m in each.marks.items())
        print(f"{line}, seed {seed}: {figures}")


def mean_ratio(lessons: list[Lesson], one: str, other: str) -> float:
    return math.exp(sum(math.log(each.ratio(one, other)) for each in lessons) / len(lessons))


def test_a_field_is_forgotten_at_its_own_pace() -> None:
    """An Ornstein-Uhlenbeck field of 2000 readings' memory, after 4000 readings."""
    lessons = [
        lesson(
            seed,
            lambda rng: OrnsteinUhlenbeckField(rng, SPAN_M, SCALE_M, TAU),
            samples=4000,
            others={"true": true_filter(TAU)},
            learner=ALL,
            still=STATIC,
        )
        for seed in range(SEEDS)
    ]
    told("OU", lessons)
    for each in lessons:
        moving = [c for c in each.kernel("learner").components if not math.isinf(c.time.timescale_s)]
        # Of several parts they share one time-scale.
        assert {1000.0 <= c.time.timescale_s / SAMPLE_S <= 4000.0 for c in moving} == {True}
    assert mean_ratio(lessons, "learner", "true") <= 1.05
    assert mean_ratio(lessons, "learner", "still") <= 0.6


def test_a_still_field_loses_next_to_nothing() -> None:
    lessons = [
        lesson(
            seed,
            lambda rng: OrnsteinUhlenbeckField(rng, SPAN_M, SCALE_M, math.inf),
            samples=1500,
            learner=ALL,
            still=STATIC,
        )
        for seed in range(SEEDS)
    ]
    told("static", lessons)
    assert mean_ratio(lessons, "learner", "still") <= 1.06


def test_smooth_motion_is_followed() -> None:
    """A disc that turns once in 20 000 readings. NLPD is in units where the field's standard deviation is 1."""
    lessons = [
        lesson(
            seed,
            lambda rng: Rotation(rng, SPAN_M, SCALE_M, 20_000 * SAMPLE_S),
            samples=4000 if LONG else 2500,
            learner=ALL,
            still=STATIC,
        )
        for seed in range(SEEDS)
    ]
    told("rotation", lessons)
    assert mean_ratio(lessons, "learner", "still") <= 0.45
    assert np.mean([each.marks["learner"].nlpd for each in lessons]) < 0.0


def test_what_is_locked_to_the_coast_is_told_from_what_drifts() -> None:
    """The simulator's moving sea, read by a boat that takes 390 s from reading to reading (0.8 m/s)."""
    samples = 2500 if LONG else 1600
    lessons = [on_the_coast(seed, samples, 390.0, learner=ALL, single=OU) for seed in range(SEEDS)]
    told("coast", lessons)
    assert mean_ratio(lessons, "learner", "single") <= 0.9
