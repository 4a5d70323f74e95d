"""A service that takes notes: how long the vehicle's messages have waited, when jobs ran, what it believed.

python witness.py CONFIG EPOCH_S BURN_S NOTES: EPOCH_S is the monotonic clock at the vehicle's time zero, BURN_S how
long every re-estimate burns a core beforehand. NOTES, a pickle, is written when the service has stopped.
"""

import asyncio
import logging
import os
import pickle
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from autonomy import jobs
from autonomy.commands.configuration import load_with_survey
from autonomy.effects import Effect, Publish, StartJob, Topic
from autonomy.events import Event, JobFinished, MessageReceived
from autonomy.learning.field_model import FieldModel
from autonomy.planning.survey import SurveyArea
from autonomy.shell.daemon import Daemon

BURN_S = "HALOCLINE_TEST_BURN_S"


def run(name: str, request: jobs.ExploreRequest, survey: SurveyArea) -> Any:
    """The real job, after some seconds of what slow jobs do: Python and linear algebra without a pause."""
    until = time.monotonic() + (float(os.environ[BURN_S]) if request.reestimate is not None else 0.0)
    matrix = np.random.default_rng(0).normal(size=(300, 300))
    while time.monotonic() < until:
        np.linalg.svd(matrix)
        sum(number * number for number in range(100_000))
    return jobs.run(name, request, survey)


@dataclass
class Notes:
    """Of every stamped message its age once it had been handled; jobs' beginnings and ends; models published."""

    waits_s: list[float] = field(default_factory=list)
    jobs: list[tuple[str, float]] = field(default_factory=list)
    models: dict[int, FieldModel] = field(default_factory=dict)


class NotingDaemon(Daemon):
    """Notes what goes in and out of its core."""

    def __init__(self, *arguments: Any, epoch_s: float) -> None:
        super().__init__(*arguments, job_runner="witness:run")
        self.notes = notes = Notes()
        handle = self._core.handle

        def noting(now: float, event: Event) -> list[Effect]:
            effects = handle(now, event)
            after = time.monotonic() - epoch_s
            if isinstance(event, MessageReceived) and hasattr(event.message, "time_boot_ms"):
                notes.waits_s.append(after - event.message.time_boot_ms / 1000)
            if isinstance(event, JobFinished):
                notes.jobs.append(("finished", after))
            for effect in effects:
                if isinstance(effect, StartJob):
                    notes.jobs.append(("started", after))
                elif isinstance(effect, Publish) and effect.topic is Topic.MODEL:
                    notes.models[effect.payload.sequence] = effect.payload.model
            return effects

        self._core.handle = noting


if __name__ == "__main__":
    config, epoch_s, seconds, file = sys.argv[1:]
    os.environ[BURN_S] = seconds
    logging.basicConfig(level="INFO", format="%(message)s")
    loaded, survey = load_with_survey(config, [])
    daemon = NotingDaemon(loaded.configuration, survey, epoch_s=float(epoch_s))
    asyncio.run(daemon.run())
    Path(file).write_bytes(pickle.dumps(vars(daemon.notes)))
