"""What computes one cell, on a core of this machine or on a worker of a cluster."""

import importlib
import json
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np  # noqa: F401 -- its BLAS and scipy's have to be there to be kept to one thread
import scipy.linalg  # noqa: F401
from threadpoolctl import threadpool_limits

from sim.experiment.cells import Value
from sim.experiment.storage import encode
from sim.experiment.sweep_provenance import Version, machine, version_here

_ONE_AT_A_TIME = threading.Lock()
"""How many threads BLAS has, and how much CPU time went by, is true of a process, which may have many workers."""


@dataclass(frozen=True)
class Task:
    """A cell on its way to a worker: `arguments` as JSON, `provenance` what is known before it is computed."""

    fingerprint: str
    function: str
    arguments: str
    version: Version
    provenance: Mapping[str, Any]


@dataclass(frozen=True)
class Failure:
    """Why there is no result: one line, and the traceback, if it was raised in the cell."""

    reason: str
    details: str = ""


def compute(task: Task) -> bytes | Failure:
    """Call the function and return the cell's file, or why there is none."""
    module, _, name = task.function.partition(":")
    try:
        here = version_here(module)
        if here != task.version:
            return Failure(f"the worker's software is not the one that asks: {here}, asked by {task.version}")
        function = getattr(importlib.import_module(module), name)
        return _computed(task, function)
    except Exception as error:  # noqa: BLE001 -- whatever a cell raises is its outcome; the others go on
        reason = traceback.format_exception_only(error)[-1].strip()
        return Failure(reason, traceback.format_exc())


def _computed(task: Task, function: Callable[[Any], Mapping[str, Value]]) -> bytes:
    """BLAS works on one thread: how many it has changes the last digits."""
    with _ONE_AT_A_TIME, threadpool_limits(1):
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        values = function(json.loads(task.arguments))
        spent = {"wall_s": time.perf_counter() - wall_s, "cpu_s": time.process_time() - cpu_s}
    finished = {"finished": datetime.now(UTC).isoformat(timespec="seconds")}
    return encode(values, {**task.provenance, **asdict(task.version), **machine(), **spent, **finished})
