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


Effect = SendMessage | StartJob | Publish | Log
