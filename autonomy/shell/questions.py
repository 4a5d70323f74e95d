"""What people ashore ask of the vehicle, answered one reply at a time, so that a thin link is shared with the rest."""

import logging
import threading
import time
from collections import deque
from dataclasses import dataclass

import zenoh

from autonomy import predicting, wire
from autonomy.effects import Topic
from autonomy.shell.outbox import LATEST_WINS, NUMBERED, Outbox
from autonomy.shell.rate_limit import RateLimit
from autonomy.wire_questions import Piece, wanted_piece

log = logging.getLogger(__name__)

_MOST = 200
_KEY_LETTERS, _KEY_STARS = 200, 3
"""Of the key of a question. With each further `$*` zenoh compares longer by a factor, within one call in which no other
thread of ours can run: with ten of them and a vehicle's name of 32 letters for seconds."""
_STALE_S = 60.0
"""Whoever asked so long ago does not wait any more."""
_PREDICTION_S = 20.0
"""On a limited link the answer to a request for predictions may take so long."""


@dataclass
class _Question:
    """A query and what is still to be answered of it."""

    query: zenoh.Query
    asked_s: float
    topics: deque[Topic]
    piece: Piece | None
    predict: bool


class Questions:
    """A queue of queries: any thread adds to it, one answers.

    Args:
        vehicle: name in the keys.
        outbox: has what is asked for.
        limit: what the link can take.
    """

    def __init__(self, vehicle: str, outbox: Outbox, limit: RateLimit) -> None:
        self._vehicle = vehicle
        self._outbox = outbox
        self._limit = limit
        self._lock = threading.Lock()
        self._waiting: deque[_Question] = deque()

    def __len__(self) -> int:
        return len(self._waiting)

    def add(self, query: zenoh.Query) -> None:
        """Take a query; what makes no sense is refused at once."""
        asked = str(query.key_expr)
        if len(asked) > _KEY_LETTERS or asked.count("$*") > _KEY_STARS:
            _refuse(query, f"a key must have at most {_KEY_LETTERS} characters and {_KEY_STARS} times $*")
            return
        try:
            piece = wanted_piece(query.parameters.get("from"), query.parameters.get("count"))
        except wire.WireError as error:
            _refuse(query, str(error))
            return
        if query.payload is not None and len(query.payload) > predicting.MAXIMUM_REQUEST:
            # It would be kept until its turn comes.
            _refuse(query, f"a request must have at most {predicting.MAXIMUM_REQUEST} bytes")
            return
        in_order = (*LATEST_WINS, *NUMBERED)
        wanted = [topic for topic in in_order if query.key_expr.intersects(wire.key(self._vehicle, topic))]
        topics = deque(topic for topic in wanted if topic in LATEST_WINS or piece is not None)
        # A request for predictions has a payload; whoever asks for everything has none.
        predict = query.payload is not None and query.key_expr.intersects(wire.predict_key(self._vehicle))
        with self._lock:
            if len(self._waiting) < _MOST:
                self._waiting.append(_Question(query, time.monotonic(), topics, piece, predict))
                return
        _refuse(query, "too many questions at once: ask again later")

    def wait_s(self, now: float) -> float:
        """How long the link is not free for an answer."""
        return self._limit.wait_s(now)

    def clear(self) -> None:
        """The session is at its end."""
        with self._lock:
            self._waiting.clear()

    def answer_one(self, now: float) -> bool:
        """Send the next reply if the link is free; False if there is none to send now."""
        if not self._waiting or self._limit.wait_s(now) > 0.0:
            return False
        question = self._waiting[0]
        if now - question.asked_s > _STALE_S:
            question.topics.clear()
            question.predict = False
        try:
            if question.predict:
                question.predict = False
                self._predict(question.query)
            elif question.topics:
                self._reply(question, question.topics.popleft())
        except zenoh.ZError as error:
            # Whoever asked may be gone; that is no reason to begin a new session.
            log.info("a question could not be answered: %s", error)
            question.topics.clear()
        if not question.topics and not question.predict:
            with self._lock:
                self._waiting.popleft()
            with question.query:  # which closes it
                return True
        return True

    def _reply(self, question: _Question, topic: Topic) -> None:
        if topic in LATEST_WINS:
            payload = self._outbox.latest(topic)
        elif question.piece is None:
            return
        else:
            payload = self._outbox.piece(topic, question.piece.first, question.piece.count)
        if payload is not None:
            self._limit.spend(len(payload))
            name, form = wire.key(self._vehicle, topic), encoding(wire.schema(topic))
            question.query.reply(name, payload, encoding=form)

    def _predict(self, query: zenoh.Query) -> None:
        rate = self._limit.bytes_per_s
        most = predicting.MAXIMUM_POINTS
        if rate is not None:
            most = min(most, max(1, int(_PREDICTION_S * rate / predicting.BYTES_PER_POINT)))
        request = b"" if query.payload is None else bytes(query.payload)
        try:
            payload = predicting.answer(request, self._outbox.newest_model, most)
        except wire.WireError as error:
            self._limit.spend(len(str(error)))
            query.reply_err(str(error))
            return
        self._limit.spend(len(payload))
        query.reply(wire.predict_key(self._vehicle), payload, encoding=encoding(wire.predict_schema()))


def encoding(schema: str) -> zenoh.Encoding:
    """Zenoh's encoding of a payload of ours."""
    return zenoh.Encoding.APPLICATION_CBOR.with_schema(schema)


def _refuse(query: zenoh.Query, why: str) -> None:
    with query:
        query.reply_err(why)
