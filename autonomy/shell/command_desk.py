"""Commands from ashore on their way in, and their answers on the way out: who may, how many, and what is on the disk.

Three threads meet here. zenoh's brings a query: it is opened and judged there, which takes microseconds. What is
authorised is handed to the loop, which brings it to the core. The answer is given by a thread of the desk's own, when
the journal has command and answer on the disk: what somebody was told is done is still known after a power cut. The
control loop waits for nothing of this.
"""

import logging
import queue
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from autonomy import wire_commands as wire
from autonomy.command_memory import STOPPING
from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived
from autonomy.shell.journal import Journal
from autonomy.shell.journal_files import Position
from autonomy.shell.questions import encoding
from autonomy.wire_kinds import WireError

log = logging.getLogger(__name__)

SYNC_S = 5.0
"""So long an answer waits for the disk; then it goes without, and says so."""
WAITING = 32
"""Commands that may wait for the core or the disk; further ones are told to come again."""
_BURST, _PER_S = 10.0, 1.0
"""Commands that reach the core: so many at once, and per second."""
_OFF = "commands are off on this vehicle: shore.commands says who may give them (token_file or trust_router)"


class _Lane:
    """One kind of queries: so many at once and so many per second on average, and so many that wait for an answer."""

    def __init__(self) -> None:
        self._left, self._at = _BURST, 0.0
        self.waiting = 0

    def take(self, now: float) -> bool:
        """Whether one more may be, at a time that only goes forward; it waits from now on if so."""
        self._left = min(_BURST, self._left + (now - self._at) * _PER_S)
        self._at = now
        if self._left < 1.0 or self.waiting >= WAITING:
            return False
        self._left -= 1.0
        self.waiting += 1
        return True


@dataclass(frozen=True)
class _Asked:
    """A query, and the lane in which it waits."""

    query: zenoh.Query
    lane: _Lane


@dataclass(frozen=True)
class _Reply:
    """An answer, or an error in words; `position`: of the journal, which must be on the disk first."""

    asked: _Asked
    what: Answer | str
    position: Position | None = None


class CommandDesk:
    """See the module's description.

    Args:
        vehicle: its name.
        accepted: whether anybody may command.
        token: that commands must be sealed with; None: none.
        journal: where commands and answers are recorded; None: nowhere.
        fresh: whether this run knows nothing of earlier ones: it can't tell then what these have carried out.
        utc_s: the wall clock.
        clock: seconds that only go forward.
    """

    def __init__(
        self,
        vehicle: str,
        *,
        accepted: bool,
        token: wire.Token | None,
        journal: Journal | None = None,
        fresh: bool = True,
        utc_s: Callable[[], float] = time.time,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._vehicle = vehicle
        self._accepted = accepted
        self._token = token
        self._journal = journal
        self._fresh = fresh
        self._utc_s, self._clock = utc_s, clock
        self._began = clock()
        self._handed: Callable[[CommandReceived], object] | None = None
        self._lock = threading.Lock()
        self._open: defaultdict[bytes, list[_Asked]] = defaultdict(list)
        # What stops the boat has a lane of its own: who asks for too much else shall keep nobody from it.
        self._commands, self._stops, self._turned_away = _Lane(), _Lane(), _Lane()
        self._refused: Counter[str] = Counter()
        self._told = 0
        self._last = ""
        self._replies: queue.SimpleQueue[_Reply | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="commands", daemon=True)

    @property
    def report(self) -> str:
        """What was refused, for health; empty if nothing was."""
        with self._lock:
            counts = ", ".join(f"{count} {what}" for what, count in self._refused.items())
            return f"commands from ashore: {counts}; the last: {self._last}" if counts else ""

    def start(self, hand_over: Callable[[CommandReceived], object]) -> None:
        """From now on commands are taken: each is given to `hand_over`, in zenoh's thread."""
        self._handed = hand_over
        self._thread.start()
        seal = "sealed with the vehicle's token" if self._token else "as routers let them through"
        log.info("commands from ashore: %s", seal if self._accepted else "off")

    def close(self) -> None:
        """Answer what waits for the disk, and end."""
        self._handed = None
        if self._thread.is_alive():
            self._replies.put(None)
            self._thread.join(SYNC_S)
        with self._lock:
            self._open.clear()

    def take(self, query: zenoh.Query) -> None:
        """Somebody asks for something to be done; for zenoh's thread."""
        try:
            request = self._opened(query)
        except WireError as error:
            self._turn_away(query, "unauthorised" if self._is_stranger(error) else "malformed", str(error))
            return
        command = CommandReceived(
            request.command_id, request.verb, request.issued_utc_s, request.valid_s, self._utc_s()
        )
        lane = self._stops if command.verb in STOPPING else self._commands
        with self._lock:
            hand_over = self._handed
            admitted = hand_over is not None and lane.take(self._clock())
            if admitted:
                self._open[command.command_id].append(_Asked(query, lane))
        if hand_over is None or not admitted:
            why = "the service is starting or stopping" if hand_over is None else "too many commands at once"
            self._say(query, self._bare(command, Outcome.BUSY, f"{why}: it is asked again"))
        elif self._is_older_than_this_run(command):
            text = "it was issued before the service began anew, which may have carried it out"
            self.answered(self._bare(command, Outcome.UNKNOWN, text))
        else:
            hand_over(command)

    def answered(self, answer: Answer) -> None:
        """The core has answered, and what it was told is recorded up to where the journal is now."""
        with self._lock:
            waiting = self._open.pop(answer.command_id, [])
            if answer.outcome is Outcome.REFUSED:
                self._count("refused", f"{answer.verb}: {answer.text}")
        recorded = self._journal is not None and answer.verb != wire.STATUS
        position = self._journal.position if self._journal is not None and recorded else None
        for asked in waiting:
            self._replies.put(_Reply(asked, answer, position))

    def _opened(self, query: zenoh.Query) -> wire.Request:
        if not self._accepted:
            raise WireError(_OFF)
        payload = query.payload
        if payload is None or len(payload) > wire.MAXIMUM_BYTES:
            raise WireError(f"a command must have a payload of at most {wire.MAXIMUM_BYTES} bytes")
        return wire.decode_request(bytes(payload), self._vehicle, self._token)

    def _is_stranger(self, error: WireError) -> bool:
        return isinstance(error, wire.UnauthorisedError) or not self._accepted

    def _turn_away(self, query: zenoh.Query, what: str, why: str) -> None:
        """Whoever may not command is told so, but not as often as he likes, for the link may be thin."""
        with self._lock:
            self._count(what, why)
            total = sum(self._refused.values())
            loud = not self._told or total >= 10 * self._told
            self._told = total if loud else self._told
        if loud:
            log.warning("%s", self.report)
        self._say(query, why)

    def _say(self, query: zenoh.Query, what: Answer | str) -> None:
        """Answer what the core has not heard of; too often it is not answered at all."""
        with self._lock:
            told = self._turned_away.take(self._clock())
        if told:
            self._replies.put(_Reply(_Asked(query, self._turned_away), what))
            return
        with query:  # which closes it
            return

    def _count(self, what: str, why: str) -> None:
        self._refused[what] += 1
        self._last = why

    def _is_older_than_this_run(self, command: CommandReceived) -> bool:
        """Whether a run before this one may have carried it out, of which nothing is known.

        Not if it looks twice as old as it is valid. Nobody asks for longer than that: then clocks differ by more, it
        was too late from the beginning, and the core will say so.
        """
        age_s = command.received_utc_s - command.issued_utc_s
        up_s = self._clock() - self._began
        return self._fresh and command.verb != wire.STATUS and up_s < age_s <= 2.0 * command.valid_s

    def _bare(self, command: CommandReceived, outcome: Outcome, text: str) -> Answer:
        """An answer that the core has no part in."""
        about = (command.command_id, command.verb, outcome, text)
        return Answer(*about, "", "", "", armed=False, utc_s=command.received_utc_s)

    # The thread ----------------------------------------------------------------------------------------------

    def _work(self) -> None:
        while (reply := self._replies.get()) is not None:
            try:
                with reply.asked.query:
                    self._give(reply)
            except zenoh.ZError as error:
                # Whoever asked may be gone; he asks again, and gets the same answer.
                log.info("a command could not be answered: %s", error)
            except WireError as error:
                log.error("a command was carried out, and its answer can't be written: %s", error)
            except Exception:
                # A bug; but if the thread ended, no command would be answered any more, and nobody would hear why.
                log.exception("a command could not be answered")
            with self._lock:
                reply.asked.lane.waiting -= 1

    def _give(self, reply: _Reply) -> None:
        if isinstance(reply.what, str):
            reply.asked.query.reply_err(reply.what)
            return
        payload = wire.encode_answer(
            reply.what, recorded=self._is_recorded(reply.position), token=self._token
        )
        reply.asked.query.reply(
            wire.command_key(self._vehicle), payload, encoding=encoding(wire.command_schema())
        )

    def _is_recorded(self, position: Position | None) -> bool:
        """Whether the disk has it, which is waited for."""
        if self._journal is None or position is None:
            return False
        return self._journal.sync(position, SYNC_S) and not self._journal.status.trouble
