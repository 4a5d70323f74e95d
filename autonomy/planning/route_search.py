"""Whole routes by local search: chains of lattice cells changed leg by leg until the budget is well spent.

A route is a chain of cells in which neighbours are joined by a short clear leg. A move takes out a cell, puts one in,
puts one elsewhere, or turns a stretch around (2-opt); it is made if ΔJ + μ Δlength < 0, J the weighted variance that
all readings along the way leave. The price of length, μ, is steered so that the route's length settles at the budget.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.planning.raster import BoolArray, IntArray
from autonomy.planning.water_lattice import WaterLattice
from autonomy.planning.weighted_variance import NOISE, WeightedVariance

__all__ = ["Found", "RouteSearch"]

_DELETE, _INSERT, _MOVE, _TURN = range(4)
_BATCH = 64
"""Moves of each kind looked at in a round."""
_TOGETHER = 6
"""At most so many of them, apart from each other, are made before the next."""
_STEERING = 3.0
"""By how much the logarithm of the price changes in a round for a length twice the budget."""
_STEEPEST = 0.15
_FIRST_PRICE = 0.85
"""Of J over the budget: about J ~ 1/length."""
_SLACK, _FREE = 0.04, 0.7
"""At first a route may become so much longer than the budget, for so large a share of the rounds."""
_TOO_LITTLE = 1e-12


@dataclass(frozen=True, eq=False)
class Found:
    """A route: the chain of its cells, its first included, its length in metres, and J."""

    chain: tuple[int, ...]
    length_m: float
    objective: float


@dataclass(frozen=True, eq=False)
class _Moves:
    """Candidate moves: each replaces what is between two positions of the chain.

    Shapes (B,) and, for the legs taken out and put in (the lattice's numbers, `no_leg` for none), (B, 2).
    `first`, `last`: the outermost positions that must stay for the move to mean the same; `cell`: what is put in.
    """

    kind: IntArray
    first: IntArray
    last: IntArray
    cell: IntArray
    out: IntArray
    into: IntArray

    def take(self, index: IntArray | BoolArray) -> "_Moves":
        return _Moves(*(getattr(self, name)[index] for name in self.__dataclass_fields__))

    @staticmethod
    def joined(parts: Sequence["_Moves"]) -> "_Moves":
        return _Moves(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in _Moves.__dataclass_fields__)
        )


class RouteSearch:
    """One search from one chain.

    Args:
        lattice: the water.
        objective: J with the readings along `chain` counted in; changed by the search.
        chain: cells, the first where the route begins, neighbours joined by legs. Its first cell stays.
        budget_m: what the chain's length may be at most.
        spacing_m: between readings.
        is_closed: whether the last cell stays as well.
        seed: of the moves that are looked at.
    """

    def __init__(
        self,
        lattice: WaterLattice,
        objective: WeightedVariance,
        chain: Sequence[int],
        budget_m: float,
        spacing_m: float,
        is_closed: bool,
        seed: int,
    ) -> None:
        self._lattice, self._objective = lattice, objective
        self._chain = np.asarray(chain, dtype=np.intp)
        self._budget_m, self._is_closed = budget_m, is_closed
        self._precision_per_m = 1.0 / (spacing_m * NOISE)
        self._rng = np.random.default_rng(seed)
        legs = lattice.leg_number[self._chain[:-1], self._chain[1:]]
        self._length_m = float(lattice.leg_length_m[legs].sum())
        self._best: Found | None = None
        self._remember()
        self._price = _FIRST_PRICE * objective.value / budget_m
        self._longest_m = budget_m

    @property
    def best(self) -> Found | None:
        """The best route so far that is within the budget."""
        return self._best

    def run(self, rounds: int) -> Found | None:
        """Search for so many rounds; `best` after them."""
        for number in range(rounds):
            # Towards the end nothing longer than the budget is gone into any more.
            slack = _SLACK * max(0.0, 1.0 - number / (_FREE * rounds))
            self._longest_m = (1.0 + slack) * self._budget_m
            self._round()
            excess = self._length_m / self._budget_m - 1.0
            self._price *= float(np.exp(np.clip(_STEERING * excess, -_STEEPEST, _STEEPEST)))
        return self._best

    def _round(self) -> None:
        moves = self._candidates()
        if not len(moves.kind):
            return
        merit, longer = self._merits(moves)
        order = np.argsort(merit, kind="stable")
        order = order[merit[order] < -_TOO_LITTLE]
        chosen = self._apart(moves, order)
        # From the end of the chain to its beginning: positions before a change stay what they are.
        for k in sorted(chosen, key=lambda k: -int(moves.first[k])):
            move = moves.take(np.array([k]))
            merit, longer = self._merits(move)
            if merit[0] < -_TOO_LITTLE and (
                longer[0] <= 0.0 or self._length_m + longer[0] <= self._longest_m
            ):
                self._make(move, float(longer[0]))
                self._remember()

    def _apart(self, moves: _Moves, order: IntArray) -> list[int]:
        """The best moves that do not touch each other's legs."""
        free = np.ones(len(self._chain) + 1, dtype=bool)
        chosen: list[int] = []
        for k in order:
            first, last = int(moves.first[k]), int(moves.last[k])
            # Neighbours may share the corner between them, but no leg.
            if free[first : max(last, first + 1)].all():
                free[first : max(last, first + 1)] = False
                chosen.append(int(k))
                if len(chosen) == _TOGETHER:
                    break
        return chosen

    def _merits(self, moves: _Moves) -> tuple[FloatArray, FloatArray]:
        """ΔJ + μ Δlength and Δlength of each move, shapes (B,)."""
        cells, precisions = self._readings(moves)
        lengths = self._lattice.leg_length_m
        longer = lengths[moves.into].sum(axis=1) - lengths[moves.out].sum(axis=1)
        return self._objective.changes(cells, precisions) + self._price * longer, longer

    def _readings(self, moves: _Moves) -> tuple[IntArray, FloatArray]:
        """Cells whose readings a move changes, shape (B, t), and the precisions; padded with precision 0."""
        lattice, count = self._lattice, len(moves.kind)
        legs = np.concatenate([moves.out, moves.into], axis=1)
        sign = np.array([-1.0, -1.0, 1.0, 1.0]) * self._precision_per_m
        cells = lattice.leg_cells[legs].reshape(count, -1)
        precisions = (lattice.leg_parts_m[legs] * sign[:, None]).reshape(count, -1)
        order = np.argsort(precisions == 0.0, axis=1, kind="stable")
        width = int((precisions != 0.0).sum(axis=1).max(initial=1))
        order = order[:, : max(1, width)]
        return np.take_along_axis(cells, order, axis=1), np.take_along_axis(precisions, order, axis=1)

    def _make(self, move: _Moves, longer_m: float) -> None:
        cells, precisions = self._readings(move)
        unique, at = np.unique(cells[0], return_inverse=True)
        total = np.asarray(np.bincount(at, precisions[0]), dtype=float)
        changed = np.abs(total) > 1e-9 * self._precision_per_m * self._lattice.side_m
        if changed.any():
            self._objective.add(unique[changed], total[changed])
        first, last = int(move.first[0]), int(move.last[0])
        chain, kind = self._chain, int(move.kind[0])
        is_whole = self._is_closed and first == 0 and last == len(chain) - 1
        if kind == _DELETE and last < len(chain) and chain[first] == chain[last] and not is_whole:
            last += 1  # the cell taken out was a spur's end
        turned = chain[first + 1 : last][::-1]
        middle = {_DELETE: chain[:0], _TURN: turned}.get(kind, move.cell)
        self._chain = np.concatenate([chain[: first + 1], middle, chain[last:]])
        self._length_m += longer_m

    def _remember(self) -> None:
        if self._length_m <= self._budget_m and (
            self._best is None or self._objective.value < self._best.objective
        ):
            self._best = Found(tuple(self._chain.tolist()), self._length_m, self._objective.value)

    def _candidates(self) -> _Moves:
        """Moves of each kind, drawn at random."""
        kinds = [self._deletions(_BATCH), self._insertions(), self._displacements(), self._turns()]
        return _Moves.joined(kinds)

    def _inner(self) -> IntArray:
        """Positions whose cells may change."""
        return np.arange(1, len(self._chain) - 1 if self._is_closed else len(self._chain))

    def _legs(self, a: IntArray, b: IntArray) -> IntArray:
        """Numbers of the legs between cells, where −1, beyond the chain's end, is joined to nothing."""
        none = self._lattice.no_leg
        legs: IntArray = np.where((a < 0) | (b < 0), none, self._lattice.leg_number[a, b])
        return legs

    def _after(self, position: IntArray) -> IntArray:
        """The cell after a position; −1 after the last."""
        return np.append(self._chain, -1)[position + 1]

    def _valid(self, moves: _Moves, wanted: IntArray) -> _Moves:
        """Moves all of whose new legs exist: as many as `wanted` (B,)."""
        return moves.take((moves.into != self._lattice.no_leg).sum(axis=1) == wanted)

    def _deletions(self, at_most: int | None = None) -> _Moves:
        at = self._inner()
        if at_most is not None and len(at) > at_most:
            at = np.sort(self._rng.choice(at, at_most, replace=False))
        before, here, after = self._chain[at - 1], self._chain[at], self._after(at)
        out = np.column_stack([self._legs(before, here), self._legs(here, after)])
        joint = self._legs(before, after)
        into = np.column_stack([joint, np.full(len(at), self._lattice.no_leg)])
        moves = _Moves(np.full(len(at), _DELETE), at - 1, at + 1, here, out, into)
        return self._valid(moves, (after >= 0).astype(int))

    def _insertions(self) -> _Moves:
        positions = np.arange(len(self._chain) - (1 if self._is_closed else 0))
        at = np.sort(self._rng.choice(positions, _BATCH))
        here, after = self._chain[at], self._after(at)
        cell = self._drawn_near(here)
        none = np.full(len(at), self._lattice.no_leg)
        out = np.column_stack([self._legs(here, after), none])
        into = np.column_stack([self._legs(here, cell), self._legs(cell, after)])
        moves = _Moves(np.full(len(at), _INSERT), at, at + 1, cell, out, into)
        return self._valid(moves, 1 + (after >= 0))

    def _displacements(self) -> _Moves:
        inner = self._inner()
        at = np.sort(self._rng.choice(inner, _BATCH)) if len(inner) else inner
        before, here, after = self._chain[at - 1], self._chain[at], self._after(at)
        cell = self._drawn_near(here)
        out = np.column_stack([self._legs(before, here), self._legs(here, after)])
        into = np.column_stack([self._legs(before, cell), self._legs(cell, after)])
        moves = _Moves(np.full(len(at), _MOVE), at - 1, at + 1, cell, out, into)
        return self._valid(moves, 1 + (after >= 0))

    def _turns(self) -> _Moves:
        """Stretches i..j turned around: legs (i−1, i), (j, j+1) become (i−1, j), (i, j+1)."""
        chain, none = self._chain, self._lattice.no_leg
        inner = self._inner()
        number = self._lattice.leg_number[np.ix_(chain, chain)]
        possible = np.ones((len(chain), len(chain)), dtype=bool)
        possible[:, :-1] = number[:, 1:] != none
        possible[1:] &= number[:-1] != none
        possible = np.triu(possible, 1)
        keep = np.zeros(len(chain), dtype=bool)
        keep[inner] = True
        i, j = np.nonzero(possible & keep[:, None] & keep)
        if len(i) > _BATCH:
            drawn = np.sort(self._rng.choice(len(i), _BATCH, replace=False))
            i, j = i[drawn], j[drawn]
        before, after = chain[i - 1], self._after(j)
        out = np.column_stack([self._legs(before, chain[i]), self._legs(chain[j], after)])
        into = np.column_stack([self._legs(before, chain[j]), self._legs(chain[i], after)])
        moves = _Moves(np.full(len(i), _TURN), i - 1, j + 1, chain[i], out, into)
        return self._valid(moves, 1 + (after >= 0))

    def _drawn_near(self, cells: IntArray) -> IntArray:
        """One cell for each, drawn from those near it."""
        near, count = self._lattice.near, self._lattice.near_count
        drawn: IntArray = near[cells, (self._rng.random(len(cells)) * count[cells]).astype(np.intp)]
        return drawn
