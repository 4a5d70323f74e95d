"""In one word, how a bridge is; and how often it says so."""

from dataclasses import dataclass, field
from enum import Enum

_COMPLAINT_S = 60.0
_SHOWN = 80


class Condition(Enum):
    """What a bridge does, or what keeps it from sending."""

    SENDING = "sending"
    WITHHOLDING = "withholding"
    TIMELESS = "the vehicle's time is not known"
    UNREADABLE = "no line can be read"
    SILENT = "the instrument is silent"
    UNPLUGGED = "the instrument's port is not open"
    STARTING = "starting"


@dataclass
class Complaints:
    """Lines that can't be read, told at a bounded rate: the first, then at most once a minute, with the newest."""

    _due_s: float = float("-inf")
    _count: int = 0
    _newest: str = field(default="")

    def add(self, line: str, reason: str) -> None:
        """Another one."""
        self._count += 1
        shown = line if len(line) <= _SHOWN else line[: _SHOWN - 3] + "..."
        self._newest = f"{reason}: {shown!a}" if line else reason

    def due(self, now: float) -> str | None:
        """What is to be told now, if anything."""
        if not self._count or now < self._due_s:
            return None
        count, self._count, self._due_s = self._count, 0, now + _COMPLAINT_S
        lines = "a line" if count == 1 else f"{count} lines, the newest"
        return f"can't read {lines}: {self._newest}"
