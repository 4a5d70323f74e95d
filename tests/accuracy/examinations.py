"""What the default learner knows of a still field after each tenth of a survey, and what it could know."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from oracles import ExactGP, inside_95, negative_log_density, rmse
from sea_fields import FloatArray, SeaField, drawn_field, real_field, sim_field
from surveys import INTERVAL_S, Survey, learners, survey

_HELD_OUT = 1000

Case = tuple[str, int, bool]
"""Name of the field, length of the track in √(water area), whether its lanes run along y."""


@dataclass(frozen=True)
class Examination:
    """One survey. `coverage`, `nlpd` (nats, for a field of variance 1) and `error` (share of the field's standard
    deviation) are after each tenth, of values at random places of *all* the water, sailed or not, each (10,);
    coverage and nlpd are of noisy values. `rmse` and `exact_rmse` are of all water cells at the end, of the
    learner's map and of the exact GP of the same kernel on all readings.
    """

    sailed: Survey
    coverage: FloatArray
    nlpd: FloatArray
    error: FloatArray
    rmse: float
    exact_rmse: float
    structures: tuple[str, ...]


def field_named(name: str, directory: Path) -> SeaField:
    """`patch-0`, `bight-1` (the simulator's), `matern-2`, `smooth-0` (drawn), or one of `REAL` in `directory`."""
    family, _, rest = name.partition("-")
    if family in ("patch", "bight"):
        return sim_field(family, int(rest))
    if family == "matern":
        return drawn_field(family, _matern32, int(rest))
    if family == "smooth":
        return drawn_field(family, _squared_exponential, int(rest))
    return real_field(directory, name)


@lru_cache
def examine(case: Case, directory: Path) -> Examination:
    """Survey a field and examine the learner after each tenth of it."""
    name, length, across = case
    field = field_named(name, directory)
    sailed = survey(field, length, across)
    rng = np.random.default_rng([length, across, *name.encode(), 1])
    chosen = rng.permutation(len(field.truth))[:_HELD_OUT]
    points, truth = field.points[chosen], field.truth[chosen]
    noisy, unit = truth + sailed.noise * rng.normal(size=len(truth)), float(field.truth.std())
    coverage, nlpd, error, structures = [], [], [], []
    for learner in learners(sailed):
        prediction = learner.model().predict(points)
        variance = prediction.variance + learner.gp.kernel.noise_variance
        coverage.append(inside_95(prediction.mean, variance, noisy))
        nlpd.append(negative_log_density(prediction.mean, variance, noisy) - np.log(unit))
        error.append(rmse(prediction.mean, truth) / unit)
        structures.append("+".join(f"{c.space.name}.{c.time.name}" for c in learner.gp.kernel.components))
    times_s = INTERVAL_S * np.arange(1.0, len(sailed.x) + 1.0)
    exact = ExactGP(learner.gp.kernel, sailed.x, sailed.y, times_s).mean(field.points, times_s[-1])
    mean = learner.model().predict(field.points).mean
    return Examination(
        sailed,
        np.array(coverage),
        np.array(nlpd),
        np.array(error),
        rmse(mean, field.truth),
        rmse(exact, field.truth),
        tuple(structures),
    )


def _matern32(distance: FloatArray) -> FloatArray:
    u = np.sqrt(3.0) * distance / 0.25
    return np.asarray((1.0 + u) * np.exp(-u))


def _squared_exponential(distance: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * (distance / 0.15) ** 2))
