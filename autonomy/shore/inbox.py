"""What zenoh's threads have brought and the subscriber's has not yet looked at: bounded in number and in bytes."""

import threading
from collections import deque
from dataclasses import dataclass

from autonomy.wire_questions import Piece

_SPARE = 4


@dataclass(frozen=True)
class Arrival:
    """Something came.

    Attributes:
        key: under which.
        received_utc_s: when, seconds since 1970 by this machine's clock.
        encoding: zenoh's, as text.
        payload: its bytes.
        query: number of the query that it answers; None if it came by itself.
        alive: for a change of presence, whether the vehicle is there now; None for all else.
        roll_call: whether that is what we asked for, and perhaps no news.
        closed: the question that is closed with this; None for all else.
        piece: the question that it answers, if that was for a piece.
    """

    key: str
    received_utc_s: float
    encoding: str = ""
    payload: bytes = b""
    query: int | None = None
    alive: bool | None = None
    roll_call: bool = False
    closed: bool = False
    piece: Piece | None = None


class Inbox:
    """A queue between threads. What finds no room is refused; news of presence and ends of questions have four times as
    much.

    Args:
        number: of arrivals, at most.
        size_bytes: of their payloads together, at most.
    """

    def __init__(self, number: int, size_bytes: int) -> None:
        self._number = number
        self._room_bytes = size_bytes
        self._arrivals: deque[Arrival] = deque()
        self._changed = threading.Condition()

    def put(self, arrival: Arrival) -> bool:
        """Leave something; False if there is no room for it. Never waits."""
        with self._changed:
            # News of presence and ends of questions are small, and losing one would mean to wait for ever.
            spare = 1 if arrival.alive is None and not arrival.closed else _SPARE
            if len(self._arrivals) >= spare * self._number or len(arrival.payload) > self._room_bytes:
                return False
            self._room_bytes -= len(arrival.payload)
            self._arrivals.append(arrival)
            self._changed.notify()
            return True

    def take(self, timeout_s: float) -> Arrival | None:
        """The next, waited for so long; None if nothing comes."""
        with self._changed:
            if not self._arrivals:
                self._changed.wait(timeout_s)
            if not self._arrivals:
                return None
            arrival = self._arrivals.popleft()
            self._room_bytes += len(arrival.payload)
            return arrival
