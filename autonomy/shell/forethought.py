"""No mission goes out before the disk has what led to it."""

import asyncio
from collections.abc import Callable
from typing import Any

from autonomy.shell.journal import Journal
from autonomy.shell.resumption import Continuity

PATIENCE_S = 3.0
"""Longest wait for the disk: a mission is tried for four times as long, and a disk that refuses ends no survey."""

_FIRST_WORD = "MISSION_COUNT"


class Forethought:
    """Sends messages; the first word of an upload once the journal, or a checkpoint, has the plan that it brings.

    A service that is killed, or loses its power, in mid-upload knows its own mission again by what it remembers of
    it. What its disk had not got then would be somebody else's mission, and the boat would wait for its operator.

    For the thread of the loop.

    Args:
        journal: of this run, if there is one.
        continuity: the checkpoints, if there are any; without a journal they must do.
        upload: the transfer under way; None: there is none.
        send: sends a message at once.
    """

    def __init__(
        self,
        journal: Journal | None,
        continuity: Continuity | None,
        upload: Callable[[], object | None],
        send: Callable[[Any], None],
    ) -> None:
        self._journal = journal
        self._continuity = continuity
        self._upload = upload
        self._send = send
        self._kept_back: Any = None
        self._awaited: object | None = None
        self._remembered: object | None = None

    def send(self, message: Any) -> None:
        """Send a message, or keep it back for a moment; of an upload's first words the newest is sent then."""
        upload = self._upload() if message.get_type() == _FIRST_WORD else None
        wait = None if upload is None or upload is self._remembered else self._wait()
        if wait is None:
            self._send(message)
            return
        self._kept_back = message
        if upload is not self._awaited:
            self._awaited = upload
            waiting = asyncio.get_running_loop().run_in_executor(None, wait)
            waiting.add_done_callback(lambda _: self._go_on(upload))

    def _wait(self) -> Callable[[], object] | None:
        """What waits for the disk to have all that is known now; None where nothing is kept."""
        if self._journal is not None:
            journal, position = self._journal, self._journal.position
            return lambda: journal.sync(position, PATIENCE_S)
        if self._continuity is not None:
            continuity = self._continuity
            return lambda: continuity.settle(PATIENCE_S)
        return None

    def _go_on(self, upload: object) -> None:
        if upload is not self._awaited:
            return
        self._awaited = None
        # Who has taken the boat meanwhile hears nothing more of it.
        if upload is self._upload():
            self._remembered = upload
            self._send(self._kept_back)
