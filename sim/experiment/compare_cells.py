"""One voyage of a comparison, as a sweep computes it: a sea, a strategy, a launch and a seed, and what came of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from time import thread_time
from typing import Any

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.learning.prediction import Prediction
from sim.experiment.cells import Value
from sim.experiment.compare_maps import BatchMap, Read
from sim.experiment.compare_scores import Score, score
from sim.experiment.compare_seas import Sea, SeaChoice, open_sea
from sim.experiment.compare_voyages import sailed
from sim.experiment.compare_ways import ON_BOARD
from sim.experiment.logbook import Voyage
from sim.experiment.probe import READINGS_PER_SAMPLE

SETTLED = 0.5
"""Of a voyage over a sea that moves: what is believed after this counts."""


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
    launch_m, seed = sea.launch(arguments["launch"]), int(arguments["seed"])
    is_on_board = arguments["strategy"] in ON_BOARD
    done, cpu_s = sailed(sea, arguments["strategy"], launch_m, seed)
    moments = _moments(sea, done)
    begun_s = thread_time()
    last = _ashore(sea, done, moments[-1], seed)
    cpu_s += 0.0 if is_on_board else thread_time() - begun_s
    counted = [_counts(sea, moment, done) for moment in moments]
    ashore = [
        _judged(sea, last if moment is moments[-1] else _ashore(sea, done, moment, seed))
        for moment, counts in zip(moments, counted, strict=True)
        if counts or not is_on_board
    ]
    own = [_judged(sea, _on_board(sea, moment)) for moment in moments] if is_on_board else ashore
    own_counted = [score for score, counts in zip(own, counted, strict=True) if counts]
    belief = _on_board(sea, moments[-1]) if is_on_board else last
    return {
        "distance_m": np.array([each.distance_m for each in moments]),
        "rmse": np.array([each.rmse for each in own]),
        "nlpd": np.array([each.nlpd for each in own]),
        "coverage": np.array([each.coverage for each in own]),
        **_summary("", own_counted),
        **_summary("batch_", ashore if is_on_board else own_counted),
        "samples": len(done.samples),
        "plans": len(done.plans),
        "reestimates": len(done.reestimates),
        "launch_m": launch_m,
        "track_m": done.track_m[::READINGS_PER_SAMPLE],
        "truth": _on_map(sea, sea.truth(moments[-1].time_s)),
        "mean": _on_map(sea, belief.prediction.mean),
        "cpu_s": cpu_s,
        **_of_sea(sea),
    }


def _of_sea(sea: Sea) -> dict[str, Value]:
    return {
        "x_axis_m": sea.waters.x_axis_m,
        "y_axis_m": sea.waters.y_axis_m,
        "side_m": sea.side_m,
        "budget_m": sea.budget_m,
        "unit": sea.unit,
        "hastened": sea.hastened,
        "shrunk": sea.shrunk,
    }


def _summary(prefix: str, scores: Sequence[Score]) -> dict[str, Value]:
    """Of the moments that count: root of the mean square error, means of the others."""
    return {
        f"{prefix}final_rmse": float(np.sqrt(np.mean([each.rmse**2 for each in scores]))),
        f"{prefix}final_nlpd": float(np.mean([each.nlpd for each in scores])),
        f"{prefix}final_coverage": float(np.mean([each.coverage for each in scores])),
    }


def _moments(sea: Sea, done: Voyage) -> list[Moment]:
    """All judgements, and of a still sea the very end, at home."""
    moments = [
        Moment(each.samples, each.distance_m, each.time_s, each.model)
        for each in done.curve
        if each.model is not None
    ]
    if not sea.choice.moves:
        end_s = float(done.samples.time_s[-1])
        moments.append(Moment(len(done.samples), done.distance_m, end_s, done.model))
    return moments


def _counts(sea: Sea, moment: Moment, done: Voyage) -> bool:
    """Whether the belief of a moment is part of the voyage's result."""
    if sea.choice.moves:
        return moment.distance_m > SETTLED * sea.budget_m
    return moment.distance_m == done.distance_m and moment.model is done.model


def _on_board(sea: Sea, moment: Moment) -> Belief:
    noise = float(np.sqrt(moment.model.kernel.noise_variance))
    return Belief(moment.model.predict(sea.points_m), noise, moment.time_s)


def _ashore(sea: Sea, done: Voyage, moment: Moment, seed: int) -> Belief:
    """What the batch process makes of the samples up to a moment."""
    samples, count = done.samples, moment.samples
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
