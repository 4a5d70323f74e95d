"""Short straight legs between cells of the water that see each other, and ways through channels where none do."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from autonomy.geometry import FloatArray, path_length_m
from autonomy.planning.passage import passage_of
from autonomy.planning.raster import BoolArray, IntArray
from autonomy.planning.survey import SurveyArea

__all__ = ["Legs", "legs_between", "parts_of"]

LONGEST = 0.16
"""Straight legs are at most this long, as a share of √(water area)."""
_PARTS_PER_LEG = 16
"""A leg is looked at in pieces of a sixteenth of the longest, each of which lies in one cell."""


@dataclass(frozen=True, eq=False)
class Legs:
    """P legs between N cells.

    Attributes:
        ends: shape (P, 2), cells, the smaller number first.
        length_m: shape (P,).
        cells: shape (P, c): cells that each leg passes, padded with 0.
        parts_m: shape (P, c): how far through each of them; 0 in the padding.
        bends: corners between the ends, (k, 2), of the few legs that are ways through a channel.
    """

    ends: IntArray
    length_m: FloatArray
    cells: IntArray
    parts_m: FloatArray
    bends: dict[int, FloatArray]

    def graph(self, cells: int) -> csr_array:
        """Lengths between cells; each leg once."""
        return csr_array((self.length_m, (self.ends[:, 0], self.ends[:, 1])), shape=(cells, cells))


def legs_between(survey: SurveyArea, points: FloatArray, navigable: BoolArray, side_m: float) -> Legs:
    """All clear straight legs of at most .16 of the side between navigable cells, centres `points` (N, 2).

    Channels too narrow for the lattice are bridged: water that the vessel can reach is in one piece.
    """
    tree = cKDTree(points)
    pairs = tree.query_pairs(LONGEST * side_m, output_type="ndarray")
    pairs = pairs[navigable[pairs].all(axis=1)]
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    pairs = pairs[_clear(survey, points[pairs[:, 0]], points[pairs[:, 1]])]
    bridges = _bridges(survey, points, navigable, pairs)
    ends = np.concatenate([pairs, np.array([pair for pair, _ in bridges], dtype=np.intp).reshape(-1, 2)])
    ways = [points[pair] for pair in pairs] + [way for _, way in bridges]
    legs, cells, parts = parts_of(tree, ways, LONGEST * side_m / _PARTS_PER_LEG)
    table, share = _padded(legs, cells, parts, len(ends))
    lengths = np.array([path_length_m(way) for _, way in bridges])
    straight = np.hypot(*(points[pairs[:, 1]] - points[pairs[:, 0]]).T)
    bends = {len(pairs) + k: way[1:-1] for k, (_, way) in enumerate(bridges)}
    return Legs(ends, np.concatenate([straight, lengths]), table, share, bends)


def _clear(survey: SurveyArea, starts: FloatArray, ends: FloatArray) -> BoolArray:
    """`SurveyArea.legs_are_clear`, asked only of legs that the raster cannot vouch for: its cells are all water."""
    clear = passage_of(survey).raster.lines_are_clear(starts, ends)
    unsure = np.flatnonzero(~clear)
    clear[unsure] = survey.legs_are_clear(starts[unsure], ends[unsure])
    return clear


def parts_of(
    tree: cKDTree, ways: list[FloatArray], longest_m: float
) -> tuple[IntArray, IntArray, FloatArray]:
    """What of polylines, each (k, 2), lies in which cell: number of the polyline, cell, metres; shapes (n,).

    Every straight piece is looked at in the middles of parts of at most `longest_m`.
    """
    count = np.array([len(way) for way in ways], dtype=np.intp)
    corners = np.concatenate(ways) if ways else np.empty((0, 2))
    way = np.repeat(np.arange(len(ways)), count)
    first = np.flatnonzero(way[:-1] == way[1:])
    steps = corners[first + 1] - corners[first]
    length = np.hypot(*steps.T)
    split = np.maximum(1, np.ceil(length / longest_m - 1e-9)).astype(np.intp)
    piece = np.repeat(np.arange(len(first)), split)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(split) - split, split)
    places = corners[first[piece]] + ((number + 0.5) / split[piece])[:, None] * steps[piece]
    cells = np.asarray(tree.query(places)[1], dtype=np.intp)
    return way[first[piece]], cells, length[piece] / split[piece]


def _padded(legs: IntArray, cells: IntArray, parts_m: FloatArray, count: int) -> tuple[IntArray, FloatArray]:
    """`Legs.cells` and `Legs.parts_m`, each cell of a leg once."""
    base = int(cells.max(initial=0)) + 1
    key, where = np.unique(legs * base + cells, return_inverse=True)
    leg, cell = np.divmod(key, base)
    slot = np.arange(len(key)) - np.searchsorted(leg, leg)
    shape = (count, int(slot.max(initial=0)) + 1)
    table, parts = np.zeros(shape, dtype=np.intp), np.zeros(shape)
    table[leg, slot] = cell
    parts[leg, slot] = np.bincount(where, parts_m, len(key))
    return table, parts


def _bridges(
    survey: SurveyArea, points: FloatArray, navigable: BoolArray, pairs: IntArray
) -> list[tuple[tuple[int, int], FloatArray]]:
    """Ways that join the pieces of water between which no leg leads but a channel does: cells and corners."""
    cells = np.flatnonzero(navigable)
    graph = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    label = connected_components(graph, directed=False)[1]
    pieces = [cells[label[cells] == k] for k in np.unique(label[cells])]
    pieces.sort(key=lambda piece: -len(piece))
    found: list[tuple[tuple[int, int], FloatArray]] = []
    if len(pieces) < 2:
        return found
    passage = passage_of(survey)
    # Every piece is joined to the nearest larger one that it is connected with.
    for k, piece in enumerate(pieces[1:], start=1):
        larger = np.concatenate(pieces[:k])
        larger = larger[passage.reachable(points[piece[0]], points[larger])]
        if len(larger):
            distance, nearest = cKDTree(points[larger]).query(points[piece])
            best = int(np.argmin(distance))
            a, b = sorted((int(piece[best]), int(larger[nearest[best]])))
            found.append(((a, b), passage.path(points[a], points[b])))
    return found
