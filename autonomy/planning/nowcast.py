"""How well a round that is sailed for ever will keep up with a field that moves: the nowcast's expected variance."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from autonomy.geometry import FloatArray
from autonomy.learning.kernel import Kernel

_ROUNDS = 3
"""Of the past that count: what is older has been seen again."""

_MOMENTS = 4
"""Of a round, at which the nowcast is looked at."""

_READINGS = 600
"""At most, of all rounds together, and so in groups: the work grows with their cube."""


def nowcast_variance(
    kernel: Kernel, round_m: FloatArray, speed_mps: float, spacing_m: float, points_m: FloatArray
) -> float:
    """Expected variance of the field now, over points (n, 2) and over a round, with readings all along it.

    Args:
        kernel: what is believed of the field; its components' memory decides.
        round_m: shape (k, 2), corners of the closed round, the first not repeated.
        speed_mps: over ground.
        spacing_m: between readings.
        points_m: where the nowcast counts.

    Returns:
        Mean variance, in the kernel's units; it grows with the time a round takes and with the gaps it leaves.
    """
    corners = np.concatenate([round_m, round_m[:1]])
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
    length_m = float(travelled[-1])
    groups = max(1, min(_READINGS // _ROUNDS, round(length_m / spacing_m)))
    noise = kernel.noise_variance * groups * spacing_m / length_m
    ago_m = np.asarray((np.arange(groups * _ROUNDS) + 0.5) * (length_m / groups), dtype=np.float64)
    total = 0.0
    for moment in range(_MOMENTS):
        along_m = (moment / _MOMENTS * length_m - ago_m) % length_m
        places = np.column_stack([np.interp(along_m, travelled, corners[:, axis]) for axis in (0, 1)])
        total += _variance(kernel, places, np.asarray(ago_m / speed_mps), noise, points_m)
    return total / _MOMENTS


def _variance(
    kernel: Kernel, places: FloatArray, ages_s: FloatArray, noise: float, points: FloatArray
) -> float:
    """Mean posterior variance at the points now, of readings at places so long ago."""
    K = kernel.covariance(places, places, np.abs(ages_s[:, None] - ages_s[None]))
    K[np.diag_indices_from(K)] += noise
    cross = kernel.covariance(places, points, np.repeat(ages_s[:, None], len(points), axis=1))
    explained = np.einsum("ij,ij->j", cross, cho_solve(cho_factor(K, lower=True), cross))
    return kernel.signal_variance - float(np.mean(explained))
