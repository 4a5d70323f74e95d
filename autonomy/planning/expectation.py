"""What the map will be worth once a plan has been sailed."""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.planning.errors import PlanningError
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea

MOST_READINGS = 150
"""Readings along the route that are thought of; more of them stand for one another."""

_AT_ONCE = 500
"""Sites whose covariances are held at once."""


@dataclass(frozen=True)
class Expectation:
    """What readings all along a route are worth, as of the model's time: what moves meanwhile is not counted.

    Attributes:
        rmse: root of the mean posterior variance at the sites after them, in the model's latent units.
        rmse_before: the same without them.
        information_nats: mutual information between them and the field.
    """

    rmse: float
    rmse_before: float
    information_nats: float


def along_route(plan: Plan, request: PlanRequest, survey: SurveyArea) -> Expectation:
    """The worth of a plan for the map at the request's candidate sites, by the request's model.

    Raises:
        PlanningError: no candidate site is over navigable water.
    """
    sites = survey.candidate_sites(*request.lattice)
    if not len(sites):
        raise PlanningError(
            f"no site of the {request.lattice[0]} × {request.lattice[1]} lattice is over water"
        )
    readings_m, each = readings_along(np.vstack([plan.start_m, plan.route_m]), request.sample_spacing_m)
    noise = request.model.kernel.noise_variance / each
    before, after = variances(request.model, sites, readings_m, noise)
    factor = _noisy_factor(request.model.covariance(readings_m), noise)
    information = float(np.log(np.diag(factor)).sum()) - 0.5 * len(factor) * math.log(noise)
    return Expectation(math.sqrt(float(after.mean())), math.sqrt(float(before.mean())), information)


def readings_along(points_m: FloatArray, spacing_m: float) -> tuple[FloatArray, float]:
    """Places (n, 2) of at most `MOST_READINGS` readings along a polyline (k, 2), and how many each stands for.

    With spacing 0 readings are as dense as they are thought of, and each stands for itself.
    """
    legs = np.diff(points_m, axis=0)
    ends_m = np.concatenate([[0.0], np.cumsum(np.hypot(legs[:, 0], legs[:, 1]))])
    taken = MOST_READINGS if spacing_m <= 0.0 else max(1, math.ceil(ends_m[-1] / spacing_m))
    n = min(taken, MOST_READINGS)
    # The last at the end: what was measured at the start is known already.
    at_m = ends_m[-1] * np.arange(1, n + 1) / n
    columns = [np.interp(at_m, ends_m, points_m[:, axis]) for axis in range(2)]
    return np.stack(columns, axis=1), taken / n


def variances(
    model: FieldModel, sites_m: FloatArray, readings_m: FloatArray, noise_variance: float
) -> tuple[FloatArray, FloatArray]:
    """Variance of the latent field at sites (N, 2), before and after readings at (n, 2) with this noise: (N,) each."""
    n = len(readings_m)
    before, after = np.empty(len(sites_m)), np.empty(len(sites_m))
    for first in range(0, len(sites_m), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        joint = model.covariance(np.concatenate([readings_m, sites_m[part]]))
        explained = solve_triangular(_noisy_factor(joint[:n, :n], noise_variance), joint[:n, n:], lower=True)
        before[part] = np.maximum(0.0, np.diag(joint)[n:])
        after[part] = np.maximum(0.0, before[part] - np.einsum("ij,ij->j", explained, explained))
    return before, after


def _noisy_factor(covariance: FloatArray, noise_variance: float) -> FloatArray:
    return np.asarray(np.linalg.cholesky(covariance + noise_variance * np.eye(len(covariance))))
