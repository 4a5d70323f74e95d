"""Everything the core may ask its shell to do."""

from dataclasses import dataclass
from enum import Enum
from typing import Any


@dataclass(frozen=True)
class SendMessage:
    """Pack one MAVLink message (the dialect's own object) and send it to the vehicle."""

    message: Any


@dataclass(frozen=True)
class StartJob:
    """Run `autonomy.jobs.run(name, request, survey)` in the worker; answer with JobFinished or JobFailed."""

    job_id: int
    name: str
    request: Any
    deadline_s: float


class Topic(Enum):
    """What is published for people ashore; the value is the last part of the key."""

    MODEL = "model"
    PLAN = "plan"
    OBSERVATIONS = "observations"
    HEALTH = "health"
    LOG = "log"
    SURVEY = "survey"
    STATUS = "status"


@dataclass(frozen=True)
class Publish:
    """Publish `payload` (one of `autonomy.wire`'s values) under `usv/<vehicle>/<topic>`, without waiting."""

    topic: Topic
    payload: Any


class Level(Enum):
    """Severity of a log line."""

    DEBUG = 10
    INFO = 20
    WARNING = 30
    ERROR = 40


@dataclass(frozen=True)
class Log:
    """A line for the person who reads the log."""

    level: Level
    text: str


class Outcome(Enum):
    """What became of a command from ashore."""

    DONE = "done"
    REFUSED = "refused"
    EXPIRED = "expired"
    """Nothing was done: by the vehicle's clock it is too late, or not yet time."""
    BUSY = "busy"
    """Nothing was done: there are too many commands; the same may be asked for again."""
    UNKNOWN = "unknown"
    """An earlier run of the software may have carried it out."""


@dataclass(frozen=True)
class Answer:
    """The answer to a command from ashore.

    Attributes:
        command_id: the command's.
        verb: what was wanted.
        outcome: what became of it.
        text: what was done, or why not.
        state: what the service was doing after it, as health has it.
        reason: why.
        mode: the autopilot's.
        armed: whether the vehicle was.
        utc_s: the clock on board when the command came, or the one it was held against, if that is later: see
            `autonomy.command_memory`.
    """

    command_id: bytes
    verb: str
    outcome: Outcome
    text: str
    state: str
    reason: str
    mode: str
    armed: bool
    utc_s: float


Effect = SendMessage | StartJob | Publish | Log | Answer
