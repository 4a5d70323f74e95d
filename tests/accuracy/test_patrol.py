"""Rounds against lawnmowers over water that moves: the nowcast's error, averaged over ten passes and all the water.

A boat sails for ever at 1.5 m/s over a square of 10 km and reads every 50th of the side
with noise of 0.1 of the field's deviation. Every track is heard by a filter of its own with the same kernel, and all
are as long: ten rounds of the patrol. The lawnmowers go back and forth along their lanes; of eight of them, two
headings and four densities, that one counts which turns out best, sea by sea. Errors count from the second pass on.
HALOCLINE_SEEDS: seas of each kind (one by default); HALOCLINE_ACCURACY=long: eight of them, and the learner's run.
"""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from moving import FloatArray, MovingTruth, OrnsteinUhlenbeckField, Rotation, SmoothDraw, square
from pupils import Driven, Filter, Pupil
from shapely.geometry import box

from autonomy.config import EstimationSection
from autonomy.geometry import LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.learner import Learner
from autonomy.learning.spatial import SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, TemporalKernel
from autonomy.planning.lanes import CORNERS
from autonomy.planning.planners import patrol
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import lawnmowers

LONG = os.environ.get("HALOCLINE_ACCURACY") == "long"
SEEDS = int(os.environ.get("HALOCLINE_SEEDS", "8" if LONG else "1"))
pytestmark = pytest.mark.timeout(7200 if LONG else 300)

SPAN_M, SCALE_M, NOISE = 10_000.0, 2_000.0, 0.1
SPEED_MPS, SAMPLE_M = 1.5, SPAN_M / 50.0
PASSES = 10
START_M = np.array([200.0, 200.0])
SURVEY = SurveyArea.from_geometry(LocalFrame(33.0, -119.0), box(0, 0, SPAN_M, SPAN_M))
# Of the square's area over the length-scale: the length of one cover, from dense to sparse.
COVERS = (1.15, 0.87, 0.65, 0.48)


class Drift:
    """A smooth draw that is carried across the square at a constant velocity, always new water from upstream."""

    def __init__(self, rng: np.random.Generator, velocity_mps: FloatArray, longest_s: float) -> None:
        reach_m = float(np.abs(velocity_mps).max()) * longest_s
        self._draw = SmoothDraw(rng, SPAN_M + reach_m, SCALE_M)
        self._offset_m = np.where(velocity_mps > 0.0, reach_m, 0.0)
        self._velocity_mps = velocity_mps

    def advance(self, dt_s: float) -> None:
        """Let `dt_s` ≥ 0 pass."""
        self._offset_m = self._offset_m - self._velocity_mps * dt_s

    def value(self, points: FloatArray) -> FloatArray:
        """The field now at `points` (n, 2): shape (n,)."""
        return self._draw.value(points + self._offset_m)


@dataclass(frozen=True)
class Sea:
    """A kind of moving water, and how the filter believes that it moves."""

    make: Callable[[np.random.Generator, float], MovingTruth]
    time: TemporalKernel

    @property
    def kernel(self) -> Kernel:
        return Kernel((Component(1.0, SquaredExponential((SCALE_M, SCALE_M)), self.time),), NOISE**2)


# A round of the patrol takes 26 700 s.
MEMORY_S = 100_000.0
# What passes a fixed place at u is correlated over l/u; in the middle of a disc's radius it is the memory, too.
CURRENT_MPS = SCALE_M / MEMORY_S
TURN_S = 2.0 * math.pi * (SPAN_M / 4.0) / CURRENT_MPS
SEAS = {
    "forgetting": Sea(
        lambda rng, _: OrnsteinUhlenbeckField(rng, SPAN_M, SCALE_M, MEMORY_S), OrnsteinUhlenbeck(MEMORY_S)
    ),
    "rotating": Sea(lambda rng, _: Rotation(rng, SPAN_M, SCALE_M, TURN_S), MaternMotion(MEMORY_S)),
    "advected": Sea(
        lambda rng, longest_s: Drift(rng, CURRENT_MPS * np.array([0.8, 0.6]), longest_s),
        MaternMotion(MEMORY_S),
    ),
}


def request(kernel: Kernel, start_m: FloatArray) -> PlanRequest:
    return PlanRequest(FieldModel.prior(kernel), start_m, 20, (12, 12), "a round", speed_mps=SPEED_MPS)


def rounds(kernel: Kernel) -> FloatArray:
    """Ten rounds of the patrol, plan after plan, corners (n, 2)."""
    corners = START_M[None]
    for _ in range(PASSES):
        plan = patrol.plan(request(kernel, corners[-1]), SURVEY)
        corners = np.concatenate([corners, plan.route_m])
    return corners


def back_and_forth(length_m: float) -> dict[str, FloatArray]:
    """Lawnmowers of two headings and four densities, each along its lanes to and fro until the length is sailed."""
    tracks = {}
    for cover in COVERS:
        sweeps = lawnmowers(SURVEY, START_M, cover * SPAN_M**2 / SCALE_M + SPAN_M / 2)
        for sweep in (sweep for sweep in sweeps if sweep.corner == CORNERS[0]):
            once = np.concatenate([START_M[None], sweep.route_m])
            times = math.ceil(length_m / sweep.length_m)
            legs = [once[1:] if k % 2 == 0 else once[1:][::-1] for k in range(times + 1)]
            name = f"{math.degrees(sweep.heading_rad):.0f}°, {sweep.spacing_m / SCALE_M:.2f} l"
            tracks[name] = np.concatenate([once[:1], *legs])
    return tracks


def samples(track: FloatArray, length_m: float) -> FloatArray:
    """Places every `SAMPLE_M` along a polyline, (n, 2)."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track, axis=0).T))])
    wanted = np.arange(SAMPLE_M, length_m, SAMPLE_M)
    return np.column_stack([np.interp(wanted, travelled, track[:, axis]) for axis in (0, 1)])


def errors(sea: Sea, seed: int, tracks: dict[str, FloatArray], pupils: dict[str, Pupil]) -> dict[str, float]:
    """Time-averaged RMSE of each pupil's nowcast; all see the same sea at the same time."""
    length_m = min(float(np.hypot(*np.diff(track, axis=0).T).sum()) for track in tracks.values())
    interval_s = SAMPLE_M / SPEED_MPS
    truth = sea.make(np.random.default_rng(seed), length_m / SPEED_MPS)
    noise = {name: np.random.default_rng([seed, k]) for k, name in enumerate(tracks)}
    places = {name: samples(track, length_m) for name, track in tracks.items()}
    count = min(len(each) for each in places.values())
    lattice = square(SPAN_M, 500.0)
    squares: dict[str, list[float]] = {name: [] for name in tracks}
    for number in range(count):
        truth.advance(interval_s)
        here = np.array([places[name][number] for name in tracks])
        for name, value in zip(tracks, truth.value(here).tolist(), strict=True):
            read = value + NOISE * float(noise[name].standard_normal())
            pupils[name].read(places[name][number], read, (number + 1) * interval_s)
        if number >= count // PASSES and number % 25 == 0:
            field = truth.value(lattice)
            for name in tracks:
                squares[name].append(float(np.mean((pupils[name].predict(lattice).mean - field) ** 2)))
    return {name: math.sqrt(float(np.mean(each))) for name, each in squares.items()}


def knowing(kernel: Kernel) -> Pupil:
    return Filter(kernel, capacity=120)


def ratio(sea: Sea, seed: int, pupil: Callable[[Kernel], Pupil] = knowing) -> float:
    """Patrol over the best lawnmower in hindsight, all heard by pupils of one kind."""
    around = rounds(sea.kernel)
    length_m = float(np.hypot(*np.diff(around, axis=0).T).sum())
    tracks = {"patrol": around, **back_and_forth(length_m)}
    told = errors(sea, seed, tracks, {name: pupil(sea.kernel) for name in tracks})
    best = min((name for name in told if name != "patrol"), key=lambda name: told[name])
    print(f"seed {seed}: patrol {told['patrol']:.3f}, best lawnmower {told[best]:.3f} ({best}), all", end=" ")
    print(", ".join(f"{name} {told[name]:.3f}" for name in told if name != "patrol"))
    return told["patrol"] / told[best]


def mean_ratio(kind: str) -> float:
    ratios = [ratio(SEAS[kind], seed) for seed in range(SEEDS)]
    mean = math.exp(float(np.mean(np.log(ratios))))
    print(f"{kind}: {mean:.3f}")
    return mean


def test_a_round_nowcasts_water_that_moves_better_than_the_best_lawnmower() -> None:
    rotating, advected = mean_ratio("rotating"), mean_ratio("advected")
    assert rotating <= 0.88
    assert advected <= 0.95
    assert math.sqrt(rotating * advected) <= 0.88


@pytest.mark.skipif(not LONG, reason="nothing is to be won here")
def test_where_water_forgets_but_does_not_move_a_round_loses_little() -> None:
    assert mean_ratio("forgetting") <= 1.1


@pytest.mark.skipif(not LONG, reason="nine learners")
def test_with_what_is_learnt_on_the_way_a_round_is_still_better() -> None:
    def learner(_: Kernel) -> Pupil:
        interval_s = 400 * SAMPLE_M / SPEED_MPS
        return Driven(Learner(SPAN_M, area_m2=SPAN_M**2), EstimationSection(), interval_s)

    assert ratio(SEAS["rotating"], 0, learner) <= 1.0
