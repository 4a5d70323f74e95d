"""The paper's method offline: its planner along a trial's still field, and its learner on what is read there."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from sea_fields import FloatArray, SeaField

from autonomy.config import Configuration, load
from autonomy.exploration import Exploration
from autonomy.geometry import path_length_m
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.learner import Learner
from autonomy.learning.rebuild import reestimate
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.planning.planners import paper
from autonomy.planning.request import PlanRequest
from autonomy.replanning import figures
from sim.trials import Readings, Trial, parted

PROFILE = Path(__file__).resolve().parents[2] / "config" / "paper.yaml"
_INTERVAL_S = 120.0


@dataclass(frozen=True, eq=False)
class Voyage:
    """The track (k, 2) of the whole budget, and after how many metres each path but the last was finished."""

    track_m: FloatArray
    finished_m: tuple[float, ...]


def paper_profile() -> Configuration:
    """The shipped configuration of the paper."""
    return load(PROFILE, {})


def paper_voyage(trial: Trial, profile: Configuration) -> Voyage:
    """Path after path of the paper's planner until the budget is spent; the last is cut there.

    The model that it plans with has read all along the legs, and is spared what the paper has to learn: its
    hyperparameters are those that `paper_learner` starts with, and stay.
    """
    kernel, mean = _hyperparameters(trial, profile), trial.sea.judge.mean
    gp = SparseOnlineGP(kernel, profile.model.capacity or 100, profile.model.novelty, prior_mean=mean)
    track, heard, finished = trial.start_m[None], 0, list[float]()
    while (left_m := trial.budget_m - path_length_m(track)) > 1e-6 * trial.budget_m:
        if len(track) > 1:
            finished.append(trial.budget_m - left_m)
        readings = trial.read(track)
        for x, y in zip(readings.points_m[heard:], readings.values[heard:], strict=True):
            gp.update(x, float(y))
        heard = len(readings.values)
        planning = profile.planning
        request = PlanRequest(gp.model(), track[-1], planning.spots, planning.lattice, "path finished")
        route = paper.plan(request, trial.sea.survey).route_m
        track = np.concatenate([track, parted(np.concatenate([track[-1:], route]), left_m)[0][1:]])
    return Voyage(track, tuple(finished))


def paper_learner(
    trial: Trial, field: SeaField, voyage: Voyage, readings: Readings, profile: Configuration
) -> Learner:
    """The paper's learner at the end of the voyage, re-estimated by the paper's rule.

    It starts with the judge's, as those of the profile were set by hand for another map; only the noise keeps the
    profile's share of the signal. With the true noise, 2 % of the field's standard deviation, this learner believes
    too much in its kernel: RMSE of .76 and .52 where it has .26 and .34 now (nordic-temp-0, sst-0, launch 0).
    """
    model = profile.model
    learner = Learner(
        field.span_m,
        model.capacity,
        model.novelty,
        model.jitter,
        model.centring_samples,
        model.history_cells,
        _hyperparameters(trial, profile),
        area_m2=field.side_m**2,
    )
    exploration, estimates = Exploration(profile.exploration), 0
    ends = {int(length_m // trial.spacing_m) for length_m in voyage.finished_m}
    for number, (x, y) in enumerate(zip(readings.points_m, readings.values, strict=True)):
        time_s = number * _INTERVAL_S
        learner.add(x, float(y), time_s)
        while learner.catch_up():
            continue
        decision = (
            exploration.decide(figures(learner, time_s, path_finished=number in ends))
            if learner.born
            else None
        )
        if decision is None:
            continue
        if decision.reestimate:
            learner.adopt(reestimate(learner.reestimate_request(estimates, profile.estimation)))
            exploration.reestimated(time_s, len(learner.history))
            estimates += 1
        # A new path begins with rho = 0.
        learner.mark()
    while learner.catch_up():
        continue
    return learner


def _hyperparameters(trial: Trial, profile: Configuration) -> Hyperparameters:
    judge, given = trial.sea.judge, profile.model.hyperparameters
    if given is None:
        raise ValueError("the paper's profile says no model.hyperparameters")
    noise_share = given.noise_variance / given.signal_variance
    return Hyperparameters(
        judge.signal_variance, noise_share * judge.signal_variance, (judge.lengthscale_m, judge.lengthscale_m)
    )
