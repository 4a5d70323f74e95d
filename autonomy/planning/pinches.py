"""Where two pieces of land touch in a point: nothing sails through there, whatever tolerance is granted elsewhere."""

from itertools import pairwise

import numpy as np
import shapely
from shapely import STRtree
from shapely.geometry.base import BaseGeometry

from autonomy.geometry import FloatArray


def pinches(water: BaseGeometry, width_m: float) -> FloatArray:
    """Corners of the water's rings that come within `width_m` of another stretch of shore, shape (n, 2).

    Land no wider than that lies between, or water no wider.
    """
    rings = [
        shapely.get_coordinates(ring)[:-1]
        for part in shapely.get_parts(water)
        for ring in (part.exterior, *part.interiors)
    ]
    if not rings:
        return np.empty((0, 2))
    corners = np.concatenate(rings)
    edges = np.concatenate([np.stack([ring, np.roll(ring, -1, axis=0)], axis=1) for ring in rings])
    # Edge k leaves corner k; the one that comes to it has the number of the corner before.
    first = np.cumsum([0, *map(len, rings)])
    before = np.concatenate([np.roll(np.arange(a, b), 1) for a, b in pairwise(first)])
    corner, edge = STRtree(shapely.linestrings(edges)).query(
        shapely.points(corners), predicate="dwithin", distance=width_m
    )
    other = (edge != corner) & (edge != before[corner])
    corner, edge = corner[other], edge[other]
    # Along a run of very short edges the next but one is near too, and no pinch: there the shore goes on.
    length = np.hypot(*(edges[:, 1] - edges[:, 0]).T)
    after = np.argsort(before)
    runs_on = (edge == after[corner]) & (length[corner] <= width_m)
    runs_on |= (edge == before[before[corner]]) & (length[before[corner]] <= width_m)
    return np.asarray(corners[np.unique(corner[~runs_on])])
