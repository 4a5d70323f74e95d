"""Commands from ashore that were answered: each is carried out once, however often it comes, and never too late."""

from dataclasses import dataclass

from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived

CAPACITY = 256
"""Commands that are remembered. Those whose time is not over are never forgotten: of more, further ones must wait."""

EARLY_S = 5.0
"""A command may be so far ahead of the clock on board, in seconds."""


@dataclass(frozen=True)
class _Remembered:
    verb: str
    expires_utc_s: float
    answer: Answer


class CommandMemory:
    """See the module's description. What is forgotten is what expired first; what expires before that is too old.

    So not even a clock that is set back, or a message that somebody has kept, makes a command count twice.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, _Remembered] = {}
        self._forgotten_utc_s = 0.0

    def __len__(self) -> int:
        return len(self._known)

    def known(self, command: CommandReceived) -> Answer | None:
        """What the same command was answered before; None if it is new."""
        known = self._known.get(command.command_id)
        return None if known is None or not _is_same(known, command) else known.answer

    def objection(self, command: CommandReceived) -> tuple[Outcome, str] | None:
        """Why a command that is not known is not to be carried out, as far as ids and times go."""
        if command.command_id in self._known:
            return Outcome.REFUSED, "another command had the same id: give each one of its own"
        age_s = command.received_utc_s - command.issued_utc_s
        if age_s > command.valid_s:
            return Outcome.EXPIRED, f"issued {age_s:.0f} s ago and valid for {command.valid_s:.0f} s"
        if age_s < -EARLY_S:
            return Outcome.EXPIRED, f"issued {-age_s:.0f} s ahead of the clock on board"
        if _expires(command) <= self._forgotten_utc_s:
            return Outcome.EXPIRED, "older than commands that are forgotten by now: it may be one of them"
        if len(self._known) >= CAPACITY and self._oldest().expires_utc_s >= command.received_utc_s:
            return Outcome.BUSY, f"{CAPACITY} commands are valid at once: wait until some have expired"
        return None

    def remember(self, command: CommandReceived, answer: Answer) -> None:
        """A command was answered, for good."""
        if command.command_id in self._known:
            return
        self._known[command.command_id] = _Remembered(command.verb, _expires(command), answer)
        while len(self._known) > CAPACITY:
            oldest = self._oldest()
            self._forgotten_utc_s = max(self._forgotten_utc_s, oldest.expires_utc_s)
            del self._known[oldest.answer.command_id]

    def _oldest(self) -> _Remembered:
        return min(self._known.values(), key=lambda known: known.expires_utc_s)


def _expires(command: CommandReceived) -> float:
    return command.issued_utc_s + command.valid_s


def _is_same(known: _Remembered, command: CommandReceived) -> bool:
    return (known.verb, known.expires_utc_s) == (command.verb, _expires(command))
