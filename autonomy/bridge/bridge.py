"""The bridge without its sockets: lines and MAVLink messages in, MAVLink messages and words for the log out.

Times are this computer's, of a clock that only goes forward, and come as arguments.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from autonomy.bridge.condition import Complaints, Condition
from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.gate import PUMP_OFF, PUMP_UNKNOWN
from autonomy.bridge.lines import LONGEST_LINE
from autonomy.bridge.link import VehicleLink
from autonomy.bridge.translator import Translator

_TELL_S = 5.0
_GRACE_S = 2.0
_REPORT_S = 600.0
_WARNINGS = frozenset({Condition.TIMELESS, Condition.UNREADABLE, Condition.SILENT, Condition.UNPLUGGED})


@dataclass(frozen=True)
class Outcome:
    """What became of a line.

    Attributes:
        line: as it came.
        messages: to the vehicle.
        sent: value and `time_boot_ms`, by name.
        unreadable, withheld, unsent: why not, if so; else empty.
    """

    line: str
    messages: list[Any]
    sent: Mapping[str, tuple[float, int]]
    unreadable: str = ""
    withheld: str = ""
    unsent: str = ""

    def record(self) -> dict[str, Any]:
        """For the recording of lines."""
        reasons = {name: getattr(self, name) for name in ("unreadable", "withheld", "unsent")}
        told = {name: reason for name, reason in reasons.items() if reason}
        sent = {name: list(pair) for name, pair in self.sent.items()}
        return {"line": self.line, **({"sent": sent} if sent else {}), **told}


@dataclass
class News:
    """Lines for the log that have not been written yet: severity as `logging` has it, and text."""

    lines: list[tuple[int, str]] = field(default_factory=list)

    def take(self) -> list[tuple[int, str]]:
        """All of them, once."""
        lines, self.lines = self.lines, []
        return lines


class Bridge:
    """Turns lines into readings and knows how it is."""

    def __init__(self, configuration: BridgeConfiguration, now: float) -> None:
        self._name = configuration.instrument.name
        self._silence_s = configuration.instrument.silence_s
        self._translator = Translator(configuration)
        self._link = VehicleLink(configuration)
        self._complaints = Complaints()
        self._port = "not open yet"
        self._line_s = self._read_s = now
        self._withheld = ""
        self._told: tuple[Condition, str] = (Condition.STARTING, "")
        self._tell_due = now + _GRACE_S
        self._report_due = now + _REPORT_S
        self.news = News()
        self.lines = 0
        """Lines that came."""
        self.sent = 0
        """Readings that were sent."""

    @property
    def system_id(self) -> int | None:
        """The vehicle's, once it is known: readings are its own."""
        return None if self._link.vehicle is None else self._link.vehicle.system_id

    @property
    def status(self) -> str:
        """How it is, in words."""
        condition, why = self._told
        return why or condition.value

    def port_up(self, now: float) -> None:
        """The instrument's port is open."""
        self._port = ""
        self._line_s = self._read_s = now

    def port_down(self, reason: str) -> None:
        """The instrument's port is not open any more, or can't be opened."""
        self._port = reason

    def link_down(self) -> None:
        """The link to the vehicle is not open any more."""
        self._link.clock.forget()

    def knows_time(self, now: float) -> bool:
        """Whether the vehicle's clock is known, without which nothing can be sent."""
        return self._link.clock.is_known(now)

    def on_noise(self, now: float) -> None:
        """Bytes came that make no line."""
        self._line_s = now
        self._complaints.add("", f"more than {LONGEST_LINE} bytes without an end; another baud rate?")

    def on_line(self, now: float, line: str) -> Outcome:
        """Take in a line that came at `now`."""
        self.lines += 1
        self._line_s = now
        translation = self._translator.take(now, line)
        if translation.unreadable:
            self._complaints.add(line, translation.unreadable)
            return Outcome(line, [], {}, unreadable=translation.unreadable)
        self._read_s, self._withheld = now, translation.withheld
        if translation.withheld:
            return Outcome(line, [], {}, withheld=translation.withheld)
        made = {name: self._link.reading(now, name, timed) for name, timed in translation.values.items()}
        messages = [message for message in made.values() if message is not None]
        self.sent += len(messages)
        sent = {
            name: (float(message.value), int(message.time_boot_ms))
            for name, message in made.items()
            if message is not None
        }
        unsent = Condition.TIMELESS.value if len(messages) < len(made) else ""
        return Outcome(line, messages, sent, unsent=unsent)

    def on_message(self, now: float, message: Any) -> list[Any]:
        """Take in a MAVLink message; returns what is to be sent."""
        messages, pump = self._link.handle(now, message)
        if pump is not None:
            self._translator.gate.on_message(now, pump)
        return messages

    def step(self, now: float) -> list[Any]:
        """What is to be sent by now; to be called several times a second."""
        self._tell(now)
        complaint = self._complaints.due(now)
        if complaint is not None:
            self.news.lines.append((logging.WARNING, f"{self._name}: {complaint}"))
        if now >= self._report_due:
            self._report_due = now + _REPORT_S
            self.news.lines.append((logging.INFO, self.report()))
        return self._link.step(now, active=self._told[0] is Condition.SENDING)

    def report(self) -> str:
        """What came and what became of it, since the start."""
        counts = {**self._translator.unreadable, **self._translator.withheld}
        told = "".join(f", {reason}: {count}" for reason, count in counts.items())
        return f"{self._name}: lines: {self.lines}, readings sent: {self.sent}{told}"

    def _tell(self, now: float) -> None:
        condition = self._condition(now)
        if condition == self._told or now < self._tell_due:
            return
        self._told, self._tell_due = condition, now + _TELL_S
        kind, why = condition
        warning = kind in _WARNINGS or why in (PUMP_OFF, PUMP_UNKNOWN)
        text = f"{self._name}: {self.status}"
        self._link.tell(
            f"{self._name}: {kind.value}" if kind is Condition.UNPLUGGED else text, warning=warning
        )
        self.news.lines.append((logging.WARNING if warning else logging.INFO, text))

    def _condition(self, now: float) -> tuple[Condition, str]:
        if self._port:
            return Condition.UNPLUGGED, self._port
        if now - self._line_s > self._silence_s:
            return Condition.SILENT, ""
        if now - self._read_s > self._silence_s:
            return Condition.UNREADABLE, ""
        if not self._translator.read:
            return Condition.STARTING, ""
        if self._withheld:
            return Condition.WITHHOLDING, self._withheld
        if not self._link.clock.is_known(now):
            return Condition.TIMELESS, ""
        return Condition.SENDING, ""
