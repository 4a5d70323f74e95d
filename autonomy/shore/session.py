"""The zenoh session of one who follows vehicles: what comes in waits in an inbox, and questions go out."""

import logging
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Literal

import zenoh

from autonomy import wire
from autonomy.endpoints import Certificates, session_settings
from autonomy.shore.inbox import Arrival, Inbox
from autonomy.wire_questions import Piece
from autonomy.zenoh_session import zenoh_config

log = logging.getLogger(__name__)

ROLL_CALL_S = 20.0
"""Between two roll calls."""
_QUERY_TIMEOUT_S = 60.0
_RETRY_S = 1.0


class ShoreSession:
    """Of one of the two kinds: a router's client, or a router. Used from one thread, but for `open`.

    Args:
        selector: name of the vehicle, or "*" for all.
        connect: endpoints of routers to be a client of.
        listen: endpoints at which to be the router itself.
        certificates: for addresses that begin with tls/ or quic/.
        inbox: gets what comes, from threads of zenoh's.
        count: called with refused=1 or dropped=1 for what does not get there, by the same threads.

    Raises:
        ValueError: an endpoint isn't one.
    """

    def __init__(
        self,
        selector: str,
        connect: Sequence[str],
        listen: Sequence[str],
        certificates: Certificates | None,
        inbox: Inbox,
        count: Callable[..., None],
    ) -> None:
        mode: Literal["router", "client"] = "router" if listen else "client"
        self._settings = session_settings(mode, connect=connect, listen=listen, certificates=certificates)
        self._listen = list(listen)
        self._selector = selector
        self._inbox = inbox
        self._count = count
        self._zenoh: zenoh.Session | None = None
        self.queries = 0
        """How many questions were asked; each has the number that this was then."""

    @property
    def is_open(self) -> bool:
        """Whether there is a session; a client has none while it dials."""
        return self._zenoh is not None

    def listen(self) -> None:
        """Open a router's session. OSError if the address cannot be had. A client's is opened by `following`."""
        if self._listen:
            try:
                self._zenoh = zenoh.open(zenoh_config(self._settings))
            except zenoh.ZError as error:
                raise OSError(f"cannot listen at {', '.join(self._listen)}: {error}") from error

    @contextmanager
    def following(self, stopping: threading.Event) -> Iterator[None]:
        """Dial until a router is there, or it is time to stop; then everything goes into the inbox, until the end."""
        session = self._zenoh = self._zenoh or self._dial(stopping)
        if session is None:
            yield
            return
        with (
            session,
            session.declare_subscriber(f"usv/{self._selector}/*", self._on_sample),
            session.liveliness().declare_subscriber(
                wire.alive_key(self._selector), self._on_token, history=True
            ),
        ):
            yield

    def ask(self, key: str, piece: Piece | None = None) -> None:
        """Send a question; the answers arrive as if by themselves, and their end under the same key."""
        assert self._zenoh is not None
        self.queries += 1
        self._zenoh.get(
            key if piece is None else f"{key}?{piece.parameters}",
            zenoh.handlers.Callback(
                partial(self._on_reply, query=self.queries, piece=piece),
                partial(self._arrive, key, closed=True, piece=piece),
            ),
            timeout=_QUERY_TIMEOUT_S,
            # Also storages on the way may have something; what is no news is left out here.
            target=zenoh.QueryTarget.ALL,
            # Keeps every answer: values of different topics, never of different times.
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def call_roll(self) -> None:
        """Ask who is there: after a break in the line a token is not always told again."""
        assert self._zenoh is not None
        self._zenoh.liveliness().get(
            wire.alive_key(self._selector), self._on_roll_call, timeout=ROLL_CALL_S / 2.0
        )

    def _dial(self, stopping: threading.Event) -> zenoh.Session | None:
        """A client's session; zenoh raises while there is no router."""
        complained = False
        while not stopping.is_set():
            try:
                return zenoh.open(zenoh_config(self._settings))
            except zenoh.ZError as error:
                if not complained:
                    log.info("no router yet (%s); dialling on", error)
                complained = True
            stopping.wait(_RETRY_S)
        return None

    def _arrive(self, key: str, **details: Any) -> None:
        if not self._inbox.put(Arrival(key, time.time(), **details)):
            self._count(dropped=1)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        # The size is looked at before anything is copied.
        if sample.kind == zenoh.SampleKind.PUT and len(sample.payload) <= wire.MAXIMUM_BYTES:
            self._arrive(str(sample.key_expr), encoding=str(sample.encoding), payload=bytes(sample.payload))
        else:
            self._count(refused=1)

    def _on_token(self, sample: zenoh.Sample) -> None:
        self._arrive(str(sample.key_expr), alive=sample.kind == zenoh.SampleKind.PUT)

    def _on_roll_call(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._arrive(str(reply.ok.key_expr), alive=True, roll_call=True)

    def _on_reply(self, reply: zenoh.Reply, query: int, piece: Piece | None) -> None:
        sample = reply.ok
        if sample is not None and len(sample.payload) <= wire.MAXIMUM_BYTES:
            self._arrive(
                str(sample.key_expr),
                encoding=str(sample.encoding),
                payload=bytes(sample.payload),
                query=query,
                piece=piece,
            )
