"""Travelling salesman: start at the vessel, visit everything, and end anywhere or come back."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray

EXACT_UP_TO = 13
"""Number of nodes, the start included, up to which the tour is optimal for certain."""

_CHAINS = 4
"""Independent searches, the first from the nearest-neighbour tour, the others from random ones.

A single chain of the same total length ends 3–5 % above the optimum once in forty problems of 20–30 nodes;
with four, one in 480 was more than 0.6 % above it.
"""

_LARGE = 60
"""Up to this many nodes there are several chains, each with as many kicks as nodes; beyond, one with fewer, because a
descent's step takes time with the square of their number."""

_KICKS_LARGE = 15_000
"""Kicks × nodes of a large problem: five seconds at 1000 nodes, one at 300."""

_TOLERANCE = 0.03
"""A chain goes on from a tour that is at most this much longer than the best it has seen."""

_LONGEST_MOVED = 3
"""Or-opt moves up to this many consecutive nodes."""

_NO_TOUR = "found no tour: some nodes cannot be reached from the others (infinite distances)"


def open_tour(
    distances: ArrayLike, start: int, *, ends: ArrayLike | None = None, seed: int = 0
) -> tuple[int, ...]:
    """A shortest path that begins at `start`, visits every node once and ends anywhere.

    Exact (Held & Karp 1962) up to `EXACT_UP_TO` nodes; beyond, a seeded iterated local search with 2-opt and
    Or-opt moves. The free end is a dummy last node that every node reaches, at no cost or at that of `ends`: the
    form that stays sound for asymmetric distances, unlike a matrix with a free way back to the start.

    Args:
        distances: shape (n, n), from row to column, not negative; inf where there is no way. The diagonal is
            ignored.
        start: index of the first node.
        ends: shape (n,), what it costs to end at each node, such as the way home; None: nothing.
        seed: of the perturbations.

    Returns:
        All n indices in sailing order, `start` first.

    Raises:
        ValueError: distances or start are no such thing, or no tour was found over the finite distances.
    """
    D = _checked(distances, start)
    after = np.zeros(len(D)) if ends is None else np.asarray(ends, dtype=np.float64)
    if after.shape != (len(D),) or not np.all(after >= 0.0):
        raise ValueError(f"ends must be {len(D)} numbers, one for each node, not negative; not {after}")
    return _shortest(D, after, start, seed)


def closed_tour(distances: ArrayLike, start: int = 0, *, seed: int = 0) -> tuple[int, ...]:
    """A shortest round that begins at `start`, visits every node once and returns: as `open_tour`, which see.

    The dummy last node is the start again. The way back from the last of the returned nodes belongs to the round.
    """
    D = _checked(distances, start)
    return _shortest(D, D[:, start], start, seed)


def _shortest(D: FloatArray, end: FloatArray, start: int, seed: int) -> tuple[int, ...]:
    """The nodes from `start` on; the path ends where `end` (n,) is to be paid."""
    nodes = np.array([start, *(node for node in range(len(D)) if node != start)], dtype=np.intp)
    n = len(nodes)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = D[np.ix_(nodes, nodes)], end[nodes]
    order = _held_karp(whole) if n <= EXACT_UP_TO else _local_search(whole, np.random.default_rng(seed))
    if not np.isfinite(_length(whole, np.append(order, n))):
        raise ValueError(_NO_TOUR)
    return tuple(nodes[order].tolist())


def _checked(distances: ArrayLike, start: int) -> FloatArray:
    D = np.array(distances, dtype=np.float64)
    if D.ndim != 2 or D.shape[0] != D.shape[1] or not len(D):
        raise ValueError(f"distances must be a square matrix, not of shape {D.shape}")
    if not 0 <= start < len(D):
        raise ValueError(f"start must lie in 0 … {len(D) - 1}, not {start}")
    np.fill_diagonal(D, 0.0)
    if np.any(np.isnan(D)) or np.any(D < 0.0):
        raise ValueError("distances must be numbers, not negative; inf where there is no way")
    for node in np.flatnonzero(np.isinf(np.where(np.eye(len(D), dtype=bool), np.inf, D)).all(axis=0)):
        if node != start:
            raise ValueError(f"there is no tour: no way leads to node {node}")
    return D


def _held_karp(D: FloatArray) -> NDArray[np.intp]:
    """Optimal order by dynamic programming over subsets; node 0 is the start, the last one the dummy end."""
    m = len(D) - 2
    if m == 0:
        return np.zeros(1, dtype=np.intp)
    masks = np.arange(1 << m)
    size = np.array([mask.bit_count() for mask in range(1 << m)])
    cost = np.full((1 << m, m), np.inf)
    before = np.zeros((1 << m, m), dtype=np.intp)
    cost[1 << np.arange(m), np.arange(m)] = D[0, 1:-1]
    for k in range(2, m + 1):
        layer = masks[size == k]
        for last in range(m):
            here = layer[(layer >> last) & 1 == 1]
            ways = cost[here ^ (1 << last)] + D[1:-1, last + 1]
            before[here, last] = np.argmin(ways, axis=1)
            cost[here, last] = np.min(ways, axis=1)
    ends = cost[-1] + D[1:-1, -1]
    mask, last = (1 << m) - 1, int(np.argmin(ends))
    if np.isinf(ends[last]):
        raise ValueError(_NO_TOUR)
    backwards = []
    while mask:
        backwards.append(last + 1)
        mask, last = mask ^ (1 << last), int(before[mask, last])
    return np.array([0, *reversed(backwards)], dtype=np.intp)


def _local_search(D: FloatArray, rng: np.random.Generator) -> NDArray[np.intp]:
    """Iterated local search; node 0 is the start, the last one the dummy end."""
    n = len(D) - 1
    finite = D[np.isfinite(D)]
    # No way at all is worse than any tour, yet leaves the search able to compare.
    whole = np.where(np.isfinite(D), D, 1.0 + n * float(finite.max()))
    chains = _CHAINS if n <= _LARGE else 1
    starts = [_nearest_neighbour(whole[:n, :n])]
    starts += [np.concatenate([[0], 1 + rng.permutation(n - 1), [n]]) for _ in range(chains - 1)]
    kicks = max(1, min(n, _KICKS_LARGE // n))
    ends = [_chain(whole, start, kicks, rng) for start in starts]
    return min(ends, key=lambda order: _length(whole, order))[:-1]


def _chain(D: FloatArray, order: NDArray[np.intp], kicks: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Perturb and descend a fixed number of times, so that a problem has one answer."""
    current = best = _descend(D, order)
    shortest = _length(D, best)
    for _ in range(kicks):
        order = _descend(D, _double_bridge(current, rng))
        length = _length(D, order)
        if length <= (1.0 + _TOLERANCE) * shortest:
            current = order
        if length < shortest:
            best, shortest = order, length
    return best


def _length(D: FloatArray, order: NDArray[np.intp]) -> float:
    return float(np.sum(D[order[:-1], order[1:]]))


def _nearest_neighbour(D: FloatArray) -> NDArray[np.intp]:
    """Always on to the nearest node not yet visited, then to the dummy end."""
    n = len(D)
    free = np.ones(n, dtype=bool)
    order = [0]
    for _ in range(n - 1):
        free[order[-1]] = False
        order.append(int(np.argmin(np.where(free, D[order[-1]], np.inf))))
    return np.array([*order, n], dtype=np.intp)


def _double_bridge(order: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.intp]:
    """Exchange two neighbouring stretches: a change that 2-opt and Or-opt cannot undo in one step."""
    a, b, c = np.sort(rng.choice(np.arange(1, len(order)), size=3, replace=False))
    return np.concatenate([order[:a], order[b:c], order[a:b], order[c:]])


def _descend(D: FloatArray, order: NDArray[np.intp]) -> NDArray[np.intp]:
    """Best 2-opt or Or-opt move until none shortens the tour; its first node and the dummy end stay."""
    least = 1e-12 * max(1.0, _length(D, order))
    while True:
        moves = _Moves(D[np.ix_(order, order)])
        gain, apply = moves.best()
        if gain >= -least:
            return order
        order = order[apply]


class _Moves:
    """All 2-opt and Or-opt moves of one tour. M[a, b] is the distance from its a-th to its b-th node.

    Reversing a stretch changes the length inside it, too, when distances are asymmetric: prefix sums of the
    tour forwards and backwards give that for every stretch at once.
    """

    def __init__(self, M: FloatArray) -> None:
        self._M = M
        self._next = np.diagonal(M, 1)
        forward = np.concatenate([[0.0], np.cumsum(self._next)])
        backward = np.concatenate([[0.0], np.cumsum(np.diagonal(M, -1))])
        # Turning round positions i … j costs turn[j] − turn[i] inside.
        self._turn = backward - forward

    def best(self) -> tuple[float, NDArray[np.intp]]:
        """The best move's change of length and the new order of positions."""
        gain, apply = self._two_opt()
        for stretch in range(1, min(_LONGEST_MOVED, len(self._M) - 3) + 1):
            other = self._or_opt(stretch)
            if other[0] < gain:
                gain, apply = other
        return gain, apply

    def _two_opt(self) -> tuple[float, NDArray[np.intp]]:
        """Turn positions i … j round, 1 ≤ i < j ≤ n − 2."""
        M, n = self._M, len(self._M)
        change = M[:-2, 1:-1] + M[1:-1, 2:] - self._next[:-1, None] - self._next[None, 1:]
        change = change + self._turn[None, 1:-1] - self._turn[1:-1, None]
        change[np.tril_indices(n - 2)] = np.inf
        at = int(np.argmin(change))
        i, j = at // (n - 2) + 1, at % (n - 2) + 1
        p = np.arange(n)
        return float(change.flat[at]), np.concatenate([p[:i], p[i : j + 1][::-1], p[j + 1 :]])

    def _or_opt(self, stretch: int) -> tuple[float, NDArray[np.intp]]:
        """Move positions i … i + stretch − 1 between k and k + 1, either way round."""
        M, n = self._M, len(self._M)
        i = np.arange(1, n - stretch)
        j = i + stretch - 1
        k = np.arange(n - 1)
        removed = M[i - 1, j + 1] - M[i - 1, i] - M[j, j + 1]
        same = M[:-1, i].T + M[j, 1:]
        turned = M[:-1, j].T + M[i, 1:] + (self._turn[j] - self._turn[i])[:, None]
        change = np.minimum(same, turned) - self._next[None, :] + removed[:, None]
        change[(k >= i[:, None] - 1) & (k <= j[:, None])] = np.inf
        at = int(np.argmin(change))
        row, k_best = at // (n - 1), at % (n - 1)
        i_best, p = int(i[row]), np.arange(n)
        moved = p[i_best : i_best + stretch]
        if turned[row, k_best] < same[row, k_best]:
            moved = moved[::-1]
        rest = np.concatenate([p[:i_best], p[i_best + stretch :]])
        place = k_best + 1 if k_best < i_best else k_best + 1 - stretch
        return float(change.flat[at]), np.concatenate([rest[:place], moved, rest[place:]])
