"""What the map will be worth once a plan has been sailed."""

import math

import numpy as np
from scipy.linalg import solve_triangular

from autonomy.geometry import FloatArray
from autonomy.learning.field_model import FieldModel
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea

MOST_READINGS = 150
"""Readings along the route that are thought of; more of them stand for one another."""


def expected_rmse(plan: Plan, request: PlanRequest, survey: SurveyArea) -> float | None:
    """Root of the mean posterior variance at the request's candidate sites, with readings along all of the route.

    In the latent units of the request's model, and as of its time: what moves meanwhile is not counted. None if no
    candidate site is over navigable water.
    """
    sites = survey.candidate_sites(*request.lattice)
    if not len(sites):
        return None
    readings_m, each = readings_along(np.vstack([plan.start_m, plan.route_m]), request.sample_spacing_m)
    noise = request.model.kernel.noise_variance / each
    variance = remaining_variance(request.model, sites, readings_m, noise)
    return math.sqrt(float(np.mean(variance)))


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


def remaining_variance(
    model: FieldModel, sites_m: FloatArray, readings_m: FloatArray, noise_variance: float
) -> FloatArray:
    """Posterior variance (N,) of the latent field at sites (N, 2) after readings at (n, 2) with this noise."""
    n = len(readings_m)
    joint = model.covariance(np.concatenate([readings_m, sites_m]))
    factor = np.linalg.cholesky(joint[:n, :n] + noise_variance * np.eye(n))
    explained = solve_triangular(factor, joint[:n, n:], lower=True)
    variance: FloatArray = np.maximum(0.0, np.diag(joint)[n:] - np.einsum("ij,ij->j", explained, explained))
    return variance
