"""Everything that can happen to the core."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class LinkUp:
    """The transport to the vehicle is open (or open again)."""


@dataclass(frozen=True)
class LinkDown:
    """The transport to the vehicle is gone; the shell keeps trying to get it back."""

    reason: str


@dataclass(frozen=True)
class MessageReceived:
    """One decoded MAVLink message; `message` is the dialect's own object."""

    message: Any


@dataclass(frozen=True)
class JobFinished:
    """The worker's answer to a `StartJob` with the same `job_id`."""

    job_id: int
    result: Any


@dataclass(frozen=True)
class JobFailed:
    """The worker crashed, raised or ran out of time on the job with this `job_id`."""

    job_id: int
    reason: str


@dataclass(frozen=True)
class DeadlineReached:
    """The time named by `Core.next_deadline()` has come."""


@dataclass(frozen=True)
class StopRequested:
    """The service is asked to stop; the core says its last words."""


@dataclass(frozen=True)
class CommandReceived:
    """Somebody ashore who may command wants something done.

    Attributes:
        command_id: equal for repetitions of the same command, and for nothing else.
        verb: one of `autonomy.wire_commands.VERBS`.
        issued_utc_s: when it was issued, seconds since 1970.
        valid_s: it is to be carried out within so many seconds, or not at all.
        received_utc_s: when it came, by the clock of the computer on board.
    """

    command_id: bytes
    verb: str
    issued_utc_s: float
    valid_s: float
    received_utc_s: float


Event = (
    LinkUp
    | LinkDown
    | MessageReceived
    | JobFinished
    | JobFailed
    | DeadlineReached
    | StopRequested
    | CommandReceived
)
