"""Jobs for the worker's tests; imported by the worker process."""

import ctypes
import os
import sys
import time
from typing import Any

import numpy as np


class Unpicklable:
    """Refuses to travel."""

    def __reduce__(self) -> Any:
        raise TypeError("stays at home")


def run(name: str, request: Any, context: Any) -> Any:
    """What the tests ask for by name."""
    match name:
        case "add":
            return context + request
        case "big":
            return np.full(request, 1.5)
        case "raise":
            raise KeyError(request)
        case "exit":
            os._exit(request)
        case "print":
            print("not an answer", flush=True)
            sys.stdout.buffer.write(b"\0" * 100)
            sys.stdout.flush()
            return "printed"
        case "sleep":
            time.sleep(request)
        case "hold":
            # Sleeps inside C with the GIL held, as a runaway extension would.
            ctypes.PyDLL(None).usleep(request)
        case "unpicklable":
            return Unpicklable()
        case "environment":
            return {key: os.environ.get(key) for key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
        case "pid":
            return os.getpid()
    return None
