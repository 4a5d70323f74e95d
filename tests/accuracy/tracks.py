"""Tracks over a field: the lawnmower that a surveyor would sail, clipped to the water, detours counted."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from sea_fields import FloatArray, SeaField

SAMPLES_PER_SIDE = 50
"""One sample every √(water area) / 50."""


def lawnmower(field: SeaField, length: float, across: bool) -> FloatArray:
    """Sample positions (n, 2), in order, of a back-and-forth track of `length` × √(water area).

    Lanes run along x, or along y if `across`; their spacing is such that one cover of the water uses the
    length. Where land lies between the end of a lane and the next, the shortest way over water is sailed.
    """
    passages = _Passages(field)
    tracks = [_track(field, passages, lanes, across) for lanes in np.linspace(0.5 * length, 2.0 * length, 25)]
    track = max((t for t in tracks if _length(t) <= length * field.side_m), key=_length)
    samples = resample(track, field.side_m / SAMPLES_PER_SIDE)
    return samples[: round(length * SAMPLES_PER_SIDE)]


def resample(track: FloatArray, spacing_m: float) -> FloatArray:
    """Places every `spacing_m` along a polyline (n, 2), the first of them its start."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))])
    wanted = np.arange(0.0, travelled[-1], spacing_m)
    return np.column_stack([np.interp(wanted, travelled, track[:, axis]) for axis in range(2)])


def _length(track: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(track, axis=0), axis=1).sum())


def _track(field: SeaField, passages: "_Passages", lanes: float, across: bool) -> FloatArray:
    points = field.points
    low, high = points.min(axis=0), points.max(axis=0)
    side = 0 if across else 1
    spacing = (high[side] - low[side]) / lanes
    legs: list[FloatArray] = []
    # Lanes that do not fill the box evenly leave the same margin on both sides.
    margin = 0.5 * (lanes - np.floor(lanes) + 1.0) * spacing
    for number in range(int(lanes)):
        level = low[side] + margin + number * spacing
        forward = number % 2 == 0
        for leg in _stretches(field, level, low, high, across, forward):
            if legs:
                legs.append(passages.between(legs[-1][-1], leg[0]))
            legs.append(leg)
    return np.vstack(legs)


def _stretches(
    field: SeaField, level: float, low: FloatArray, high: FloatArray, across: bool, forward: bool
) -> list[FloatArray]:
    """The water along one lane as pieces (start, end), in sailing order; pieces of one cell are not worth it."""
    along = 1 if across else 0
    places = np.arange(low[along], high[along], 0.5 * field.step_m)
    line = np.empty((len(places), 2))
    line[:, along], line[:, 1 - along] = places, level
    wet = np.concatenate([[False], field.is_water(line), [False]])
    starts, ends = np.flatnonzero(wet[1:] & ~wet[:-1]), np.flatnonzero(~wet[1:] & wet[:-1]) - 1
    pieces = [line[[i, j]] for i, j in zip(starts, ends, strict=True) if j - i >= 4]
    return pieces if forward else [piece[::-1] for piece in reversed(pieces)]


class _Passages:
    """Shortest ways over the water's cells, along their eight directions, corners of land not cut."""

    def __init__(self, field: SeaField) -> None:
        self._field = field
        water = field.water
        self._points = field.points
        number = np.full(water.shape, -1)
        number[water] = np.arange(len(self._points))
        rows, columns = water.shape
        pairs = []
        for di, dj in ((0, 1), (1, 0), (1, 1), (1, -1)):
            i, j = np.nonzero(water)
            near = (i + di < rows) & (j + dj >= 0) & (j + dj < columns)
            i, j = i[near], j[near]
            free = water[i + di, j + dj] & water[i + di, j] & water[i, j + dj]
            pairs.append(np.column_stack([number[i, j][free], number[i + di, j + dj][free]]))
        edges = np.vstack(pairs)
        weights = np.linalg.norm(self._points[edges[:, 0]] - self._points[edges[:, 1]], axis=1)
        size = len(self._points)
        self._graph = csr_matrix((weights, (edges[:, 0], edges[:, 1])), shape=(size, size))

    def between(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """The way from `start` to `end`, both included, (n, 2): straight where no land is between them."""
        line = np.linspace(start, end, 2 + int(np.linalg.norm(end - start) / (0.25 * self._field.step_m)))
        if self._field.is_water(line).all():
            return np.vstack([start, end])
        first, last = (int(np.linalg.norm(self._points - place, axis=1).argmin()) for place in (start, end))
        _, before = dijkstra(self._graph, directed=False, indices=first, return_predecessors=True)
        way = [last]
        while way[-1] != first:
            if before[way[-1]] < 0:
                raise ValueError("the water is not in one piece along its cells' eight directions")
            way.append(int(before[way[-1]]))
        return np.vstack([start, self._points[way[::-1]], end])
