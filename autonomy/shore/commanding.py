"""Asking a vehicle to do something, again and again with the same id until it answers or the time is over."""

import logging
import queue
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

import zenoh

from autonomy import wire_commands as wire
from autonomy.effects import Answer, Outcome
from autonomy.wire_kinds import WireError
from autonomy.zenoh_session import zenoh_config

log = logging.getLogger(__name__)

FIRST_RETRY_S, LONGEST_RETRY_S = 1.0, 8.0
"""Pauses between repetitions, doubled from the first to the longest; earlier ones may still be answered."""
_DIAL_S = 0.5
_LOOK_S = 0.2
CLOCKS_APART_S = 2.0
"""A command that came too late or too early is issued once more, by the vehicle's clock, if clocks differ by this."""
_REPLIES, _NOTES = 200, 10
"""Replies that wait to be looked at, and different things said while waiting: anybody can send us any number."""


@dataclass(frozen=True)
class Result:
    """What became of a command.

    Attributes:
        answer: the vehicle's own; None: it has given none.
        recorded: whether command and answer are on its disk.
        error: why it is refused, or could not be asked for; empty if neither is known.
        sent: how often the command was sent.
        command_id: the last one's.
        unverified: what was said last that can't be verified as the vehicle's; empty if nothing was.
    """

    answer: Answer | None
    recorded: bool
    error: str
    sent: int
    command_id: bytes
    unverified: str = ""


class Commander:
    """One command to one vehicle.

    Args:
        settings: of the zenoh session, see `autonomy.endpoints.session_settings`.
        vehicle: its name.
        token: that the command is sealed with, and the answer must be; None: neither is.
        stopping: ends it early when set.
        note: told what happens meanwhile, in words.
    """

    def __init__(
        self,
        settings: Mapping[str, Any],
        vehicle: str,
        token: wire.Token | None,
        stopping: threading.Event,
        note: Callable[[str], None],
    ) -> None:
        self._settings = dict(settings)
        self._vehicle, self._token = vehicle, token
        self._stopping, self._note = stopping, note
        self._replies: queue.Queue[tuple[bytes, bool, bytes]] = queue.Queue(_REPLIES)
        self._offset_s = 0.0
        self._sent = 0
        self._noted: set[str] = set()
        self._unverified = ""

    def ask(self, verb: str, timeout_s: float) -> Result:
        """Have it done, and say what became of it; returns after `timeout_s` at the latest, or a little later.

        Raises:
            OSError: the address to listen at can't be had.
        """
        deadline = time.monotonic() + timeout_s
        session = self._dial(deadline)
        if session is None:
            return Result(None, False, "no router answers", 0, b"")
        with session:
            result = self._ask(session, verb, deadline)
            while self._clocks_differ(result.answer) and time.monotonic() < deadline:
                # Nothing was done, and with this id nothing ever will be.
                result = self._ask(session, verb, deadline)
        return result

    def _ask(self, session: zenoh.Session, verb: str, deadline: float) -> Result:
        left_s = deadline - time.monotonic()
        valid_s = min(max(left_s, 1.0), wire.LONGEST_VALID_S)
        command_id = secrets.token_bytes(wire.ID_BYTES)
        issued_s = time.time() + self._offset_s
        request = wire.Request(command_id, self._vehicle, verb, issued_s, valid_s)
        payload = wire.encode_request(request, self._token)
        retry_s, due = FIRST_RETRY_S, time.monotonic()
        while not self._stopping.is_set() and (now := time.monotonic()) < deadline:
            if now >= due:
                self._send(session, command_id, payload, deadline - now)
                retry_s, due = min(LONGEST_RETRY_S, 2.0 * retry_s), now + retry_s
            try:
                found = self._understood(*self._replies.get(timeout=_LOOK_S), command_id)
            except queue.Empty:
                continue
            if isinstance(found, Result):
                return found
        return Result(None, False, "", self._sent, command_id, self._unverified)

    def _send(self, session: zenoh.Session, command_id: bytes, payload: bytes, left_s: float) -> None:
        self._sent += 1
        try:
            session.get(
                wire.command_key(self._vehicle),
                partial(self._on_reply, command_id),
                payload=payload,
                encoding=zenoh.Encoding.APPLICATION_CBOR.with_schema(wire.command_schema()),
                timeout=max(left_s, 1.0),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_HIGH,
            )
        except zenoh.ZError as error:
            log.info("not sent: %s", error)

    def _on_reply(self, command_id: bytes, reply: zenoh.Reply) -> None:
        sample = reply.ok if reply.ok is not None else reply.err
        if sample is not None and len(sample.payload) <= wire.MAXIMUM_BYTES:
            with suppress(queue.Full):
                self._replies.put_nowait((command_id, reply.ok is not None, bytes(sample.payload)))

    def _understood(self, asked: bytes, is_answer: bool, payload: bytes, command_id: bytes) -> Result | None:
        """What a reply settles; None if nothing."""
        if asked != command_id:
            return None
        if not is_answer:
            text = payload.decode("utf-8", "replace")[:400]
            if self._token is None:
                return Result(None, False, text, self._sent, command_id)
            self._distrust(text)
            return None
        try:
            answer, recorded = wire.decode_answer(payload, self._token)
        except WireError as error:
            self._distrust(str(error))
            return None
        if answer.command_id != command_id:
            return None
        if answer.outcome is Outcome.BUSY:
            self._say_once(f"{self._vehicle}: {answer.text}")
            return None
        return Result(answer, recorded, "", self._sent, command_id)

    def _distrust(self, text: str) -> None:
        """Anybody can say this: the vehicle's own answer may still come, so we go on asking."""
        self._unverified = text
        self._say_once(f"not verified as {self._vehicle}'s: {text}; asking on")

    def _say_once(self, text: str) -> None:
        if text not in self._noted and len(self._noted) < _NOTES:
            self._noted.add(text)
            self._note(text)

    def _clocks_differ(self, answer: Answer | None) -> bool:
        """Whether it came too late or too early since the vehicle's clock is not what we took it for; it counts now."""
        if answer is None or answer.outcome is not Outcome.EXPIRED:
            return False
        taken_for_s, self._offset_s = self._offset_s, answer.utc_s - time.time()
        if abs(self._offset_s - taken_for_s) < CLOCKS_APART_S:
            return False
        word = "ahead of" if self._offset_s > 0.0 else "behind"
        self._say_once(
            f"{self._vehicle}'s clock is {abs(self._offset_s):.0f} s {word} ours: its clock counts"
        )
        return True

    def _dial(self, deadline: float) -> zenoh.Session | None:
        """A session; None if no router answers in time. OSError if the address to listen at can't be had."""
        while not self._stopping.is_set() and time.monotonic() < deadline:
            try:
                return zenoh.open(zenoh_config(self._settings))
            except zenoh.ZError as error:
                if self._settings["listen/endpoints"]:
                    raise OSError(f"cannot listen: {error}") from error
                self._say_once(f"no router yet ({error}); dialling on")
            self._stopping.wait(_DIAL_S)
        return None
