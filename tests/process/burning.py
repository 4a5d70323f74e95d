"""A service whose re-estimates burn a core, and which notes how long every message of the vehicle has waited.

python burning.py CONFIG EPOCH_S SECONDS NOTES.json; EPOCH_S is the monotonic clock at the vehicle's time zero.
"""

import asyncio
import json
import logging
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from autonomy import jobs
from autonomy.commands.configuration import load_with_survey
from autonomy.effects import Effect, StartJob
from autonomy.events import Event, JobFinished, MessageReceived
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


class NotingDaemon(Daemon):
    """Notes when jobs began and ended, and of every stamped message how old it was once it had been handled."""

    def __init__(self, *arguments: Any, epoch_s: float) -> None:
        super().__init__(*arguments, job_runner="burning:run")
        self.waits_s: list[float] = []
        self.jobs: list[tuple[str, float]] = []
        handle = self._core.handle

        def noting(now: float, event: Event) -> list[Effect]:
            effects = handle(now, event)
            after = time.monotonic() - epoch_s
            if isinstance(event, MessageReceived) and hasattr(event.message, "time_boot_ms"):
                self.waits_s.append(after - event.message.time_boot_ms / 1000)
            if isinstance(event, JobFinished):
                self.jobs.append(("finished", after))
            self.jobs += [("started", after) for effect in effects if isinstance(effect, StartJob)]
            return effects

        self._core.handle = noting


if __name__ == "__main__":
    config, epoch_s, seconds, notes = sys.argv[1:]
    os.environ[BURN_S] = seconds
    logging.basicConfig(level="INFO", format="%(message)s")
    loaded, survey = load_with_survey(config, [])
    daemon = NotingDaemon(loaded.configuration, survey, epoch_s=float(epoch_s))
    asyncio.run(daemon.run())
    Path(notes).write_text(json.dumps({"waits_s": daemon.waits_s, "jobs": daemon.jobs}))
