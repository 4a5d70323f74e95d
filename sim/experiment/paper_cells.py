"""One voyage of the paper's experiment, as a sweep computes it: a launch, a threshold, a seed, and what came of it."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from autonomy.geometry import FloatArray
from sim.experiment.cells import Value
from sim.experiment.logbook import Judgement, Replan, Voyage
from sim.experiment.orders import Orders
from sim.experiment.paper_numbers import LAUNCHES, NOISE_SHARE
from sim.experiment.paper_setting import launch_m, paper_waters, profile, random_readings
from sim.experiment.voyage import sail
from sim.field_grid import IntArray

JUDGEMENTS = 100
"""The map is judged so often, at equal numbers of samples."""

PATHS, VARIANCE_MAPS = 6, 10
"""Panels of the figures of paths and models, and of variances."""


_Found = TypeVar("_Found", Judgement, Replan)


def voyage_cell(arguments: Mapping[str, Any]) -> dict[str, Value]:
    """A voyage: arguments are `field`, `variable`, `rows`, `columns`, `launch`, `rho0`, `seed`, `samples`, `ablations`.

    `launch` is the index of one of `LAUNCHES`; with `detail` the maps of the figures are among the values.

    Returns:
        `samples`, `mse`, `rho`, `basis_size`, shape (n,): at equal parts of the voyage, from the first model on.
        `plan_samples`, `plan_rho`, shape (p,): when each plan came. `fit_samples`, `fit_kept`, `fit_before`,
        `fit_after`, shape (r,): when each re-estimate was adopted, whether the fit found nothing better, and the MSE
        with the model before and after it. `fit_signal_sd`, `fit_noise_sd`, shape (r,), `fit_lengthscales_m`, shape
        (r, 2). `field_sd`, `distance_m`, `refused`, `launch_shift_m`, and `spacing_m`, shape (k,): between samples.
    """
    ablations = arguments["ablations"]
    waters = paper_waters(arguments["field"], arguments["variable"], arguments["rows"], arguments["columns"])
    configuration = profile(waters, arguments["rho0"], arguments["seed"], ablations)
    start_m, shift_m = launch_m(waters, *LAUNCHES[arguments["launch"]])
    spots_only = "spots-only" in ablations
    pilot = (None, None) if "no-pilot" in ablations else random_readings(waters, arguments["seed"])
    samples = arguments["samples"]
    voyage = sail(
        Orders(
            waters,
            configuration,
            start_m,
            # At the spots alone there are few: the same distance is sailed then.
            samples=None if spots_only else samples,
            distance_m=samples * configuration.sampling.spacing_m if spots_only else None,
            noise=NOISE_SHARE * float(np.nanstd(waters.truth(0.0))),
            seed=arguments["seed"],
            judgements=JUDGEMENTS,
            keep_models=arguments["detail"],
            known_m=pilot[0],
            known=pilot[1],
            spots_only=spots_only,
        )
    )
    values = _course(voyage) | _fits(voyage)
    values |= {
        "field_sd": voyage.field_std,
        "distance_m": voyage.distance_m,
        "refused": voyage.refused,
        "launch_shift_m": shift_m,
        "spacing_m": np.hypot(*np.diff(voyage.samples.points_m, axis=0).T),
    }
    if arguments["detail"]:
        values |= _paths(voyage, waters.x_axis_m, waters.y_axis_m)
    return values


def _course(voyage: Voyage) -> dict[str, Value]:
    curve, plans = voyage.curve, voyage.plans
    return {
        "samples": np.array([each.samples for each in curve]),
        "sailed_m": np.array([each.distance_m for each in curve]),
        "mse": np.array([each.rmse**2 for each in curve]),
        "rho": np.array([each.rho for each in curve]),
        "basis_size": np.array([each.basis_size for each in curve]),
        "plan_samples": np.array([each.samples for each in plans]),
        "plan_rho": np.array([each.rho for each in plans]),
    }


def _fits(voyage: Voyage) -> dict[str, Value]:
    """The re-estimates that were adopted; one that the end of the voyage overtook was not."""
    before = [each for each in voyage.judgements if each.occasion == "before re-estimate"]
    after = [each for each in voyage.judgements if each.occasion == "after re-estimate"]
    adopted = voyage.reestimates[: len(before)]
    theta = [each.kernel.hyperparameters for each in adopted]
    return {
        "fit_samples": np.array([each.samples for each in before], dtype=np.int64),
        "fit_kept": np.array([each.kept for each in adopted], dtype=bool),
        "fit_before": np.array([each.rmse**2 for each in before]),
        "fit_after": np.array([each.rmse**2 for each in after]),
        "fit_signal_sd": np.array([each.signal_variance**0.5 for each in theta]),
        "fit_noise_sd": np.array([each.noise_variance**0.5 for each in theta]),
        "fit_lengthscales_m": np.array([each.lengthscales_m for each in theta]).reshape(-1, 2),
    }


def _paths(voyage: Voyage, x_axis_m: FloatArray, y_axis_m: FloatArray) -> dict[str, Value]:
    """Paths with what was believed when they were made, and how sure the belief was along the voyage.

    Arrays are padded with NaN to the longest; maps are of single precision.
    """
    plans, moments = _spread(voyage.plans, PATHS), _spread(voyage.curve, VARIANCE_MAPS)
    models = [each.model for each in plans if each.model is not None]
    beliefs = [model.mean_grid(x_axis_m, y_axis_m) for model in models]
    doubts = [each.model.predict_grid(x_axis_m, y_axis_m) for each in moments if each.model is not None]
    return {
        "path_number": np.array([voyage.plans.index(each) + 1 for each in plans]),
        "path_samples": np.array([each.samples for each in plans]),
        "path_start_m": np.array([each.plan.start_m for each in plans]),
        "path_route_m": _padded([each.plan.route_m for each in plans]),
        "path_spots_m": _padded([each.plan.spots_m for each in plans]),
        "path_basis_m": _padded([model.basis for model in models]),
        "path_mean": np.array(beliefs, dtype=np.float32),
        "variance_samples": np.array([each.samples for each in moments]),
        "variance": np.array([each.variance for each in doubts], dtype=np.float32),
        "track_m": voyage.track_m,
        "path_track": _reached(voyage.track_m, [each.distance_m for each in plans]),
    }


def _reached(track_m: FloatArray, distances_m: Sequence[float]) -> IntArray:
    """How many places of a track (k, 2) lie behind a boat that has sailed so far, for each distance."""
    sailed_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track_m, axis=0).T))])
    return np.searchsorted(sailed_m, np.asarray(distances_m, dtype=float))


def _spread(found: Sequence[_Found], count: int) -> list[_Found]:
    """So many of them, evenly spread, the first and the last among them; all, if there are no more."""
    if len(found) <= count:
        return list(found)
    return [found[k] for k in np.rint(np.linspace(0, len(found) - 1, count)).astype(int)]


def _padded(places: Sequence[FloatArray]) -> FloatArray:
    """Places (n_i, 2) as one array (len(places), longest, 2)."""
    longest = max((len(each) for each in places), default=0)
    padded = np.full((len(places), longest, 2), np.nan)
    for row, each in zip(padded, places, strict=True):
        row[: len(each)] = each
    return padded
