"""Lines for the log: what happened, and whether somebody should care."""

from collections.abc import Iterable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.vehicle import StatusText

WINDOW_S = 60.0
LINES_PER_WINDOW = 20


@dataclass(frozen=True)
class Note:
    """A line for the log."""

    text: str
    is_warning: bool = False


class AutopilotWords:
    """What the autopilot writes to its operator, as notes; an autopilot that talks without end is cut short.

    In each minute of protocol time a line is shown once, and at most twenty are; how many more came is said when
    the minute is over and the autopilot speaks again.
    """

    def __init__(self) -> None:
        self._ends = 0.0
        self._shown: set[str] = set()
        self._left_out = 0

    def notes(self, now: float, texts: Iterable[StatusText]) -> list[Note]:
        """The notes that these texts are worth."""
        return [note for text in texts for note in self._take(now, text)]

    def _take(self, now: float, said: StatusText) -> list[Note]:
        notes = self._turn(now)
        text = "".join(letter if letter.isprintable() else "?" for letter in said.text).strip()
        if not text or text in self._shown:
            return notes
        if len(self._shown) >= LINES_PER_WINDOW:
            self._left_out += 1
            return notes
        self._shown.add(text)
        return [*notes, Note(f"autopilot: {text}", said.severity <= mavlink.MAV_SEVERITY_WARNING)]

    def _turn(self, now: float) -> list[Note]:
        """Begin a new minute when the last one is over."""
        if now < self._ends:
            return []
        left_out, self._left_out = self._left_out, 0
        self._ends = now + WINDOW_S
        self._shown.clear()
        return [Note(f"autopilot: {left_out} more lines were not shown", is_warning=True)] if left_out else []
