"""What a vehicle tells in order, put together again ashore: nothing left out, nothing twice. Knows no network or clock.

A vehicle numbers its observations and lines. What comes by itself may have gaps: the way was lost, or we came late.
A `Stream` gives on only what follows what it gave before. For what lies between it asks, one piece at a time, and keeps
what came too early until then.
"""

from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

from autonomy.shore.greeting import LONGEST_S, PATIENCE_S
from autonomy.wire_questions import Piece
from autonomy.wire_values import LogBatch, ObservationBatch

Batch = TypeVar("Batch", ObservationBatch, LogBatch)

PIECE = 4096
"""Items asked for at a time, at most."""
GRACE_S = 0.5
"""What is missing for less may just have been overtaken."""
_EARLY = 4096
"""Items that came too early, kept at most; others are asked for later."""
_RUNS = 8
"""Runs of the vehicle's software whose place is remembered."""
_IN_VAIN = 5
"""First questions without an answer after which what came by itself has to do."""


@dataclass
class _Place:
    """How far a run has been given on: number of the next item, and the end of what is known to have been told."""

    next: int
    end: int


class Stream(Generic[Batch]):
    """One vehicle's observations, or its log.

    Args:
        history: how many of those that were told before we came are wanted; None: all that the vehicle has kept.
    """

    def __init__(self, history: int | None) -> None:
        self._history = history
        self._places: OrderedDict[int, _Place] = OrderedDict()
        self._run: int | None = None
        self._early: list[Batch] = []
        self._open: Piece | None = None
        self._asked_s = 0.0
        self._in_vain = 0
        self._greeting = False
        self._missing_since: float | None = None
        self._not_before = 0.0
        self._pause_s = PATIENCE_S[0]
        self.missed = 0
        """How many the vehicle had dropped before we could ask for them."""

    def greet(self) -> None:
        """The vehicle has appeared: ask it at once."""
        self._greeting, self._open = True, None
        self._be_patient_again()

    def told(self, run: int, end: int) -> None:
        """The vehicle says that its items below `end` have been sent in this run."""
        self._turn_to(run)
        place = self._places.get(run)
        if place is not None:
            place.end = max(place.end, end)

    def take(self, batch: Batch, *, asked: bool = False) -> list[Batch]:
        """Take in what came, by itself or because we asked; gives what follows what was given before, in order."""
        self._turn_to(batch.run)
        place = self._places.get(batch.run)
        joining = asked and self._open is not None and self._is_first(self._open)
        if place is None and joining:
            place = self._begin(batch.run, batch.first)
        if place is not None and asked and batch.first == batch.oldest > place.next:
            self.missed += batch.oldest - place.next
            place.next = batch.oldest
        if batch.items:
            self._early.append(batch)
        if place is None:
            self._bound_early()
            return []
        place.end = max(place.end, batch.end)
        given = self._follow(place)
        if asked and (given or place.next >= place.end):
            self._be_patient_again()
        return given

    def question(self, now: float) -> Piece | None:
        """What to ask the vehicle now, if anything; `closed` must be called when the answer is complete."""
        place = self._places.get(self._run) if self._run is not None else None
        missing = self._run is not None and (place is None or place.next < place.end)
        if not missing:
            self._missing_since = None
        elif self._missing_since is None:
            self._missing_since = now
        due = self._greeting or (self._missing_since is not None and now - self._missing_since >= GRACE_S)
        given_up = self._open is not None and now >= self._asked_s + LONGEST_S
        if not due or now < self._not_before or not (self._open is None or given_up):
            return None
        self._asked_s = now
        self._greeting = False
        self._not_before = now + self._pause_s
        self._pause_s = min(2.0 * self._pause_s, PATIENCE_S[1])
        self._open = self._first_question() if place is None else Piece(place.next, PIECE)
        return self._open

    def closed(self, piece: Piece) -> list[Batch]:
        """No more answers to a question will come; gives what there is if it turns out that nobody answers."""
        if piece is not self._open:
            return []
        self._open = None
        self._in_vain += 1
        if self._run is None or self._run in self._places or not self._early or self._in_vain < _IN_VAIN:
            return []
        return self._follow(self._begin(self._run, min(batch.first for batch in self._early)))

    def _first_question(self) -> Piece:
        return Piece(0 if self._history is None else -self._history, PIECE)

    def _is_first(self, piece: Piece) -> bool:
        return piece == self._first_question()

    def _be_patient_again(self) -> None:
        self._pause_s, self._not_before = PATIENCE_S[0], 0.0

    def _turn_to(self, run: int) -> None:
        if run != self._run:
            self._run = run
            self._early.clear()
            self._in_vain = 0
            self._missing_since = None

    def _begin(self, run: int, first: int) -> _Place:
        self._places[run] = place = _Place(first, first)
        while len(self._places) > _RUNS:
            self._places.popitem(last=False)
        return place

    def _follow(self, place: _Place) -> list[Batch]:
        """Those of what came early that need not wait any more, without what was given before."""
        given: list[Batch] = []
        self._early.sort(key=lambda batch: batch.first)
        while self._early and self._early[0].first <= place.next:
            batch = self._early.pop(0)
            place.end = max(place.end, batch.end)
            items = batch.items[place.next - batch.first :]
            if items:
                whole = len(items) == len(batch.items)
                given.append(batch if whole else replace(batch, first=place.next, items=items))
                place.next += len(items)
        self._bound_early()
        return given

    def _bound_early(self) -> None:
        held = sum(len(batch.items) for batch in self._early)
        while self._early and held > _EARLY:
            held -= len(self._early.pop().items)
