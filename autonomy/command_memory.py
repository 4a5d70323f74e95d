"""Commands from ashore that were answered: each is carried out once, however often it comes, and never too late.

Nobody ashore asks again for longer than a command is valid, so that it need not be known by its id for longer. What
is forgotten is kept out by time: commands are held against the *command clock*, the clock on board, but never behind
what was valid until when it was forgotten. Who is told that he is late or early issues his command anew by that clock.
So neither a wrong clock, nor one that is set back, nor a message that somebody has kept, makes a command count
twice; and none of them keeps the operator out.
"""

import math
from dataclasses import dataclass

from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived

CAPACITY = 256
"""Commands that are remembered. Who asks for one may still repeat it if it is younger than it is valid: of more
such, further ones must wait."""

RESERVED = 64
"""Commands beyond these, of the verbs that stop the boat."""

STOPPING = frozenset({"pause", "finish", "return"})
"""Verbs that must get through where others may wait."""

EARLY_S = 5.0
"""A command may be so far ahead of the command clock, in seconds."""


@dataclass(frozen=True)
class _Remembered:
    verb: str
    expires_utc_s: float
    repeated_until: float
    """Core's time after which nobody asks for it any more."""
    answer: Answer


class CommandMemory:
    """See the module's description. `now` is the core's time, which goes on from run to run."""

    def __init__(self) -> None:
        self._known: dict[bytes, _Remembered] = {}
        self._floor_utc_s = -math.inf
        self._floor_at = 0.0

    def __len__(self) -> int:
        return len(self._known)

    def known(self, command: CommandReceived) -> Answer | None:
        """What the same command was answered before; None if it is new."""
        known = self._known.get(command.command_id)
        return None if known is None or not _is_same(known, command) else known.answer

    def clock_utc_s(self, now: float, utc_s: float) -> float:
        """The command clock, where that on board says `utc_s`."""
        return max(utc_s, self._floor_utc_s + max(0.0, now - self._floor_at))

    def objection(self, now: float, command: CommandReceived) -> tuple[Outcome, str] | None:
        """Why a command that is not known is not to be carried out, as far as ids and times go; room is made for it."""
        if command.command_id in self._known:
            return Outcome.REFUSED, "another command had the same id: give each one of its own"
        verdict = self._verdict(now, command)
        # Who is told that he is late or early asks once more by the command clock: it must not leap before he does.
        if self._make_room(now, command.received_utc_s, places=1 if verdict is None else 2):
            verdict = self._verdict(now, command)
        return verdict

    def remember(self, now: float, command: CommandReceived, answer: Answer) -> None:
        """A command was answered, for good."""
        if command.command_id in self._known:
            return
        expires_utc_s = _expires(command)
        if len(self._known) < CAPACITY + RESERVED:
            repeated_until = now + command.valid_s
            self._known[command.command_id] = _Remembered(command.verb, expires_utc_s, repeated_until, answer)
        else:
            self._keep_out(now, expires_utc_s)

    def _verdict(self, now: float, command: CommandReceived) -> tuple[Outcome, str] | None:
        clock_utc_s = self.clock_utc_s(now, command.received_utc_s)
        age_s = clock_utc_s - command.issued_utc_s
        if clock_utc_s >= _expires(command):
            return Outcome.EXPIRED, f"issued {age_s:.0f} s ago and valid for {command.valid_s:.0f} s"
        if len(self._known) >= CAPACITY + (RESERVED if command.verb in STOPPING else 0):
            return (
                Outcome.BUSY,
                f"{len(self._known)} commands are valid at once: wait until some have expired",
            )
        if age_s < -EARLY_S:
            return Outcome.EXPIRED, f"issued {-age_s:.0f} s ahead of the clock on board"
        return None

    def _make_room(self, now: float, utc_s: float, places: int) -> bool:
        """Have so many places free, if it can be; whether anything had to be forgotten.

        Of what nobody repeats any more that which has expired; if that is too little, since clocks differ, half of it.
        Half, and the earlier: a few that came from a clock far ahead shall not take the command clock with them.
        """
        excess = len(self._known) + places - CAPACITY
        if excess <= 0:
            return False
        over = [(each.expires_utc_s, key) for key, each in self._known.items() if each.repeated_until < now]
        over.sort()
        expired = sum(expires_utc_s <= self.clock_utc_s(now, utc_s) for expires_utc_s, _ in over)
        gone = over[: expired if expired >= excess else max(expired, (len(over) + 1) // 2)]
        for _, key in gone:
            del self._known[key]
        if gone:
            self._keep_out(now, gone[-1][0])
        return bool(gone)

    def _keep_out(self, now: float, expires_utc_s: float) -> None:
        """From now on whatever expires by then has expired."""
        self._floor_utc_s = self.clock_utc_s(now, expires_utc_s)
        self._floor_at = now


def _expires(command: CommandReceived) -> float:
    return command.issued_utc_s + command.valid_s


def _is_same(known: _Remembered, command: CommandReceived) -> bool:
    return (known.verb, known.expires_utc_s) == (command.verb, _expires(command))
