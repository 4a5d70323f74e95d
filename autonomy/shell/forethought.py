"""No mission goes out before the disk has what led to it."""

import asyncio
import logging
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.shell.resumption import Continuity

log = logging.getLogger(__name__)

PATIENCE_S = 3.0
"""Longest wait for the disk: a vehicle is asked for four times as long, and a disk that refuses ends no survey."""

_POLL_S = 0.01

_FIRST_WORDS = ("MISSION_REQUEST_LIST", "MISSION_COUNT")


class Forethought:
    """Sends messages; the first words of a conversation about the mission once all checkpoints are on the disk.

    A plan that is to be uploaded is worth a checkpoint. A service that is killed, or loses its power, in mid-upload
    knows its own mission again by that; without it the mission would be somebody else's, and the boat would wait for
    its operator. Before an upload the mission on board is read: that waits already, so that between reading it and
    replacing it there is no wait in which another could come on board.

    For the thread of the loop.

    Args:
        continuity: writes the checkpoints; None: there are none, and nothing waits.
        conversation: the one about the mission that goes on; None: there is none.
        send: sends a message at once.
    """

    def __init__(
        self,
        continuity: Continuity | None,
        conversation: Callable[[], object | None],
        send: Callable[[Any], None],
    ) -> None:
        self._continuity = continuity
        self._conversation = conversation
        self._send = send
        self._kept_back: Any = None
        self._awaited: object | None = None
        self._begun: object | None = None

    def send(self, message: Any) -> None:
        """Send a message, or keep it back for a moment; of those with which one conversation begins the newest goes."""
        conversation = self._conversation() if _is_first_word(message) else None
        if conversation is None or conversation is self._begun or self._is_written:
            self._send(message)
            return
        self._kept_back = message
        if conversation is not self._awaited:
            self._awaited = conversation
            self._look(conversation, asyncio.get_running_loop().time() + PATIENCE_S)

    @property
    def _is_written(self) -> bool:
        return self._continuity is None or self._continuity.is_settled

    def _look(self, conversation: object, until: float) -> None:
        # Who has taken the boat meanwhile, or has another mission by now, hears nothing more of this one.
        if conversation is not self._conversation():
            return
        loop = asyncio.get_running_loop()
        if not self._is_written:
            if loop.time() < until:
                loop.call_later(_POLL_S, self._look, conversation, until)
                return
            log.warning("the disk has not taken the newest plan in %g s: its mission goes out", PATIENCE_S)
        self._begun = conversation
        self._send(self._kept_back)


def _is_first_word(message: Any) -> bool:
    return message.get_type() in _FIRST_WORDS and message.mission_type == mavlink.MAV_MISSION_TYPE_MISSION
