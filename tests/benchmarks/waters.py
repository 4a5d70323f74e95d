"""Surveys, covariances and models that several benchmarks use."""

from functools import cache

import numpy as np
import shapely
from shapely.geometry import box

from autonomy.geometry import LocalFrame
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.planning.survey import SurveyArea

SIDE_M = 15_000.0


@cache
def archipelago(islands, widest_m=1500.0):
    """Islands in a square of 15 km, with a stand-off."""
    rng = np.random.default_rng(1)
    places = [
        shapely.Point(*rng.uniform(1000, 14_000, 2)).buffer(rng.uniform(100, widest_m), 64)
        for _ in range(islands)
    ]
    land = shapely.union_all(places)
    return SurveyArea.from_geometry(
        LocalFrame(33, -119), box(0, 0, SIDE_M, SIDE_M), land=land, standoff_m=60.0
    )


def lattice(side, lengthscale=1.5, noise=0.05):
    """The covariance of the measurements at side² sites: shape (side², side²)."""
    axis = np.arange(float(side))
    sites = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    squared = np.sum((sites[:, None] - sites[None]) ** 2, axis=-1)
    return np.exp(-0.5 * squared / lengthscale**2) + noise * np.eye(side**2)


def distances(n):
    """Between n points in a square: shape (n, n)."""
    points = np.random.default_rng(n).random((n, 2))
    return np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))


def nearest_neighbour(D):
    """The plainest tour: always on to the nearest node that is left."""
    order, left = [0], set(range(1, len(D)))
    while left:
        order.append(min(left, key=lambda node: D[order[-1], node]))
        left.remove(order[-1])
    return order


def full(kernel, m, extent):
    """A process whose basis is full and covers the square."""
    rng = np.random.default_rng(0)
    gp = SparseOnlineGP(kernel, m)
    points = rng.uniform(0.0, extent, (m, 2))
    gp.start_basis(points, rng.normal(size=m), np.ones(m))
    gp.absorb(points, rng.normal(size=m), np.full(m, 0.01))
    return gp
