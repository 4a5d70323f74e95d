"""One voyage of a comparison, as a sweep computes it: a sea, a strategy, a launch and a seed, and what came of it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import thread_time
from typing import Any

import numpy as np

from autonomy.config import Configuration
from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.learning.prediction import Prediction
from autonomy.planning.plan import NO_SPOTS, Plan
from autonomy.planning.planners import PlanRequest
from autonomy.planning.survey import SurveyArea
from sim.experiment import strategies, voyage
from sim.experiment.cells import Value
from sim.experiment.compare_maps import BatchMap, Read
from sim.experiment.compare_scores import Score, score
from sim.experiment.compare_seas import SPEED_MPS, Sea, SeaChoice, open_sea
from sim.experiment.compare_ways import LANES, ON_BOARD, PAPER
from sim.experiment.paper_setting import MAP_COLUMNS, MAP_ROWS, profile
from sim.experiment.waters import cell_middles
from sim.truth_map import TruthMap

JUDGEMENTS = 20
"""Equal parts of a voyage after which the map is judged."""

SETTLED = 0.5
"""Of a voyage over a sea that moves: what is believed after this counts."""

COVER_SIDES = 4.0
"""Length of one cover of a lawnmower that goes to and fro over a sea that moves, in √(water area)."""

_DONE_M = 1.0


@dataclass(frozen=True, eq=False)
class Moment:
    """When a map is judged: after so many samples and metres; `model` is the core's, whoever sails."""

    samples: int
    distance_m: float
    time_s: float
    model: FieldModel


@dataclass(frozen=True, eq=False)
class Belief:
    """What is believed of the field over the water at one moment, and of a reading's noise (standard deviation)."""

    prediction: Prediction
    noise: float
    time_s: float


def sail(arguments: Mapping[str, Any]) -> dict[str, Value]:
    """A voyage: arguments are `sea` (the fields of a `SeaChoice`), `strategy`, `launch`, `seed`, `sides` or `budget_m`.

    Returns:
        `distance_m`, `rmse`, `nlpd`, `coverage`, shape (k,): the strategy's own map along the way, errors in units of
        the field's standard deviation. `final_rmse`, `final_nlpd`, `final_coverage`: of a still sea at the end, of a
        moving one root mean square and means over the second half. `batch_final_…`: the same of the batch process on
        the strategy's readings. `truth` and `mean`, shape (rows, columns): at the end, in the same units. `track_m`,
        shape (n, 2). What the sea is. And `cpu_s`, CPU seconds of planning and learning: the only value that another
        run does not give again.
    """
    sea = open_sea(SeaChoice(**arguments["sea"]), arguments["sides"], arguments["budget_m"])
    strategy = arguments["strategy"]
    launch_m, seed = sea.launch(arguments["launch"]), int(arguments["seed"])
    if strategy in ON_BOARD:
        sailed, cpu_s = _sailed_by_the_core(sea, strategy, launch_m, seed)
        moments = _moments(sea, sailed)
        beliefs = [_on_board(sea, moment) for moment in moments]
        batch = [
            _judged(sea, _ashore(sea, sailed, moment, seed))
            for moment in moments
            if _counts(sea, moment, sailed)
        ]
    else:
        sailed, cpu_s = _sailed_by_plan(sea, strategy, launch_m, seed)
        moments = _moments(sea, sailed)
        beliefs = [_ashore(sea, sailed, moment, seed) for moment in moments[:-1]]
        begun_s = thread_time()
        beliefs.append(_ashore(sea, sailed, moments[-1], seed))
        cpu_s += thread_time() - begun_s
        batch = []
    scores = [_judged(sea, each) for each in beliefs]
    counted = [each for each, moment in zip(scores, moments, strict=True) if _counts(sea, moment, sailed)]
    return {
        "distance_m": np.array([each.distance_m for each in moments]),
        "rmse": np.array([each.rmse for each in scores]),
        "nlpd": np.array([each.nlpd for each in scores]),
        "coverage": np.array([each.coverage for each in scores]),
        **_summary("", counted),
        **_summary("batch_", batch or counted),
        "samples": len(sailed.samples),
        "plans": len(sailed.plans),
        "reestimates": len(sailed.reestimates),
        "launch_m": launch_m,
        "track_m": sailed.track_m[:: voyage.READINGS_PER_SAMPLE],
        "truth": _on_map(sea, sea.truth(moments[-1].time_s)),
        "mean": _on_map(sea, beliefs[-1].prediction.mean),
        "x_axis_m": sea.waters.x_axis_m,
        "y_axis_m": sea.waters.y_axis_m,
        "side_m": sea.side_m,
        "budget_m": sea.budget_m,
        "unit": sea.unit,
        "hastened": sea.hastened,
        "shrunk": sea.shrunk,
        "cpu_s": cpu_s,
    }


def _summary(prefix: str, scores: Sequence[Score]) -> dict[str, Value]:
    """Of the moments that count: root of the mean square error, means of the others."""
    return {
        f"{prefix}final_rmse": float(np.sqrt(np.mean([each.rmse**2 for each in scores]))),
        f"{prefix}final_nlpd": float(np.mean([each.nlpd for each in scores])),
        f"{prefix}final_coverage": float(np.mean([each.coverage for each in scores])),
    }


def configuration(sea: Sea, strategy: str, seed: int) -> Configuration:
    """What the core is told: the default, or the paper's profile; within the budget, where it has to come home.

    Nobody keeps a reserve here, or all would sail different lengths: that is the one thing of the default that changes.
    """
    base = _paper(sea) if strategy == PAPER else _default(sea)
    update: dict[str, Any] = {
        "seed": seed,
        "sampling": base.sampling.model_copy(update={"spacing_m": sea.spacing_m}),
    }
    if strategy in ON_BOARD and not sea.choice.moves:
        limits = {"distance_m": sea.budget_m, "reserve": 0.0, "home_margin": 1.0, "speed_mps": SPEED_MPS}
        update["budget"] = base.budget.model_copy(update=limits)
    return base.model_copy(update=update)


def _default(sea: Sea) -> Configuration:
    x_min, y_min, x_max, y_max = sea.waters.survey.bounds
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    area = [tuple(place) for place in sea.waters.survey.frame.to_geodetic(corners).tolist()]
    return Configuration.model_validate({"survey": {"area": area}})


def _paper(sea: Sea) -> Configuration:
    """The paper's profile; the lengths in it are counted in cells of a map as fine as the paper's."""
    waters = sea.waters
    x_min, y_min, x_max, y_max = waters.survey.bounds
    columns, rows = cell_middles(x_min, x_max, MAP_COLUMNS), cell_middles(y_min, y_max, MAP_ROWS)
    return profile(TruthMap(waters.field, waters.survey, columns, rows))


def _orders(
    sea: Sea, told: Configuration, launch_m: FloatArray, seed: int, planner: voyage.Planner | None = None
) -> voyage.Orders:
    # Waypoints over a sea that stands still may be sailed at any pace, and a coarse one is computed sooner.
    hurries = planner is not None and not sea.choice.moves
    return voyage.Orders(
        waters=sea.waters,
        configuration=told,
        launch_m=launch_m,
        distance_m=sea.budget_m,
        noise=sea.noise,
        seed=seed,
        speed_mps=None if hurries else SPEED_MPS,
        planner=planner,
        judgements=JUDGEMENTS,
        keep_models=True,
    )


def _sailed_by_the_core(
    sea: Sea, strategy: str, launch_m: FloatArray, seed: int
) -> tuple[voyage.Voyage, float]:
    sailed = voyage.sail(_orders(sea, configuration(sea, strategy, seed), launch_m, seed))
    return sailed, sailed.cost.core_s + sailed.cost.jobs_s


def _sailed_by_plan(sea: Sea, strategy: str, launch_m: FloatArray, seed: int) -> tuple[voyage.Voyage, float]:
    pilot = _Pilot(_strategy(sea, strategy, seed), sea, launch_m, seed)
    told = voyage.on_rails(configuration(sea, strategy, seed))
    return voyage.sail(_orders(sea, told, launch_m, seed, pilot)), pilot.spent_s


def _strategy(sea: Sea, name: str, seed: int) -> strategies.Strategy:
    cover = COVER_SIDES if sea.choice.moves else None
    ways: dict[str, Callable[[], strategies.Strategy]] = {
        LANES[0]: lambda: strategies.Lawnmower(0, cover),
        LANES[1]: lambda: strategies.Lawnmower(1, cover),
        "random": lambda: strategies.RandomWaypoints(seed),
        "entropy": strategies.GreedyEntropy,
        "information": strategies.GreedyInformation,
    }
    return ways[name]()


class _Pilot:
    """A strategy as the voyage's planner; counts what is left of the budget."""

    def __init__(self, strategy: strategies.Strategy, sea: Sea, launch_m: FloatArray, seed: int) -> None:
        self._strategy, self._sea, self._seed = strategy, sea, seed
        self._home_m = None if sea.choice.moves else launch_m
        self._left_m = sea.budget_m
        self.spent_s = 0.0

    def __call__(self, request: PlanRequest, survey: SurveyArea) -> Plan | None:
        begun_s = thread_time()
        cells = request.measured
        read = (
            Read.nothing()
            if cells is None
            else Read(cells.points[:, :2], cells.means, cells.times_s, cells.counts)
        )
        underway = strategies.Underway(
            survey,
            np.asarray(request.start_m, dtype=float),
            self._home_m,
            self._left_m,
            float(read.times_s.max(initial=0.0)),
            read,
            self._sea.choice.moves,
            self._seed,
        )
        corners = self._strategy.stretch(underway) if self._left_m > _DONE_M else np.empty((0, 2))
        self.spent_s += thread_time() - begun_s
        if not len(corners):
            return None
        plan = Plan(
            underway.here_m, corners, np.ones(len(corners), dtype=bool), NO_SPOTS, "given", request.reason
        )
        self._left_m -= plan.length_m
        return plan


def _moments(sea: Sea, sailed: voyage.Voyage) -> list[Moment]:
    """All judgements, and of a still sea the very end, at home."""
    moments = [
        Moment(each.samples, each.distance_m, each.time_s, each.model)
        for each in sailed.curve
        if each.model is not None
    ]
    if not sea.choice.moves:
        end_s = float(sailed.samples.time_s[-1])
        moments.append(Moment(len(sailed.samples), sailed.distance_m, end_s, sailed.model))
    return moments


def _counts(sea: Sea, moment: Moment, sailed: voyage.Voyage) -> bool:
    """Whether the belief of a moment is part of the voyage's result."""
    if sea.choice.moves:
        return moment.distance_m > SETTLED * sea.budget_m
    return moment.distance_m == sailed.distance_m and moment.model is sailed.model


def _on_board(sea: Sea, moment: Moment) -> Belief:
    noise = float(np.sqrt(moment.model.kernel.noise_variance))
    return Belief(moment.model.predict(sea.points_m), noise, moment.time_s)


def _ashore(sea: Sea, sailed: voyage.Voyage, moment: Moment, seed: int) -> Belief:
    """What the batch process makes of the samples up to a moment."""
    samples, count = sailed.samples, moment.samples
    read = Read(samples.points_m[:count], samples.values[:count], samples.time_s[:count], np.ones(count))
    made = BatchMap.fitted(read, sea.waters.survey.span_m, may_move=sea.choice.moves, seed=seed)
    noise = float(np.sqrt(made.kernel.noise_variance))
    return Belief(made.predict(sea.points_m, moment.time_s), noise, moment.time_s)


def _judged(sea: Sea, belief: Belief) -> Score:
    return score(belief.prediction, belief.noise, sea.truth(belief.time_s), sea.noise, sea.unit)


def _on_map(sea: Sea, values: FloatArray) -> FloatArray:
    """Values at the water's cells as a map in units of the field's deviation about its mean, NaN on land."""
    mean = float(sea.truth(0.0).mean())
    whole = np.full(sea.waters.is_water.shape, np.nan)
    whole[sea.waters.is_water] = (values - mean) / sea.unit
    return whole
