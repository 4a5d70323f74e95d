"""Cells that are water in part: a point in each piece, and the legs by which it hangs together with its neighbours.

Cells that are water altogether make a graph that knows no channel narrower than two of them, and no bay. Here legs
are tested against the polygons one by one, which only these few can afford.
"""

from itertools import pairwise

import numpy as np
import shapely
from scipy.sparse import coo_array, csr_array
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from autonomy.geometry import FloatArray
from autonomy.planning.raster import Raster

_LEAST_SHARE = 0.01
"""Of a cell: smaller pieces of water get no point."""

_REACH = 1.8
"""In cells: points this close may be neighbours."""


def with_shore_cells(water: BaseGeometry, raster: Raster, graph: csr_array) -> tuple[FloatArray, csr_array]:
    """The raster's graph, shape (n, n), with points in cells that are water in part added to it.

    Returns:
        Places of all nodes, the raster's first, shape (n + m, 2), and distances in metres between neighbours, (n + m,
        n + m), symmetric: every edge lies in the water.
    """
    added = _points(water, raster)
    nodes = np.concatenate([raster.centres_m, added])
    n = len(raster.centres_m)
    if not len(added):
        return nodes, graph
    reach_m = _REACH * max(np.diff(raster.x_edges_m[:2])[0], np.diff(raster.y_edges_m[:2])[0])
    close = cKDTree(added).sparse_distance_matrix(cKDTree(nodes), reach_m, output_type="coo_matrix")
    tail, head = close.row + n, close.col
    once = (head < n) | (tail < head)
    tail, head = tail[once], head[once]
    shapely.prepare(water)
    clear = shapely.covers(water, shapely.linestrings(np.stack([nodes[tail], nodes[head]], axis=1)))
    tail, head = tail[clear], head[clear]
    length = np.hypot(*(nodes[head] - nodes[tail]).T)
    old = graph.tocoo()
    rows, columns = np.concatenate([old.row, tail, head]), np.concatenate([old.col, head, tail])
    lengths = np.concatenate([old.data, length, length])
    return nodes, coo_array((lengths, (rows, columns)), shape=(len(nodes), len(nodes))).tocsr()


def _points(water: BaseGeometry, raster: Raster) -> FloatArray:
    """A point in every piece of water that shares its cell with land or stand-off, shape (m, 2)."""
    y = raster.y_edges_m
    found = [np.empty((0, 2))]
    for column, (west, east) in enumerate(pairwise(raster.x_edges_m)):
        rows = np.flatnonzero(~raster.passable[column])
        # The column's strip first: cutting each cell out of all the water would take seconds.
        strip = shapely.clip_by_rect(water, west, y[0], east, y[-1])
        if strip.is_empty or not len(rows):
            continue
        cells = shapely.box(west, y[rows], east, y[rows + 1])
        shapely.prepare(strip)
        cells = cells[shapely.intersects(strip, cells)]
        pieces = shapely.get_parts(shapely.intersection(shapely.make_valid(strip), cells))
        cell_m2 = (east - west) * (y[1] - y[0])
        pieces = pieces[shapely.area(pieces) >= _LEAST_SHARE * cell_m2]
        found.append(shapely.get_coordinates(shapely.point_on_surface(pieces)))
    return np.concatenate(found)
