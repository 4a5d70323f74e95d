"""The far end of `Worker`: reads jobs from standard input, works, writes answers to standard output.

Frames both ways are an 8-byte big-endian length and a pickle. In: first (run, context), then (job_id, name,
request). Out: ("ready",), ("broken", reason), ("finished", job_id, result), ("failed", job_id, reason).
"""

import contextlib
import ctypes
import importlib
import os
import pickle
import queue
import signal
import struct
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

LENGTH = struct.Struct(">Q")
NICENESS = 10
OOM_SCORE = 500
"""By how many thousandths of all memory the worker looks larger than it is to the kernel that needs a victim."""

_PR_SET_PDEATHSIG = 1


def frame(value: Any) -> bytes:
    """A value as it crosses the pipe."""
    body = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(body)) + body


def last_line(error: BaseException) -> str:
    """Type and message of an exception, as the last line of its traceback has them."""
    return traceback.format_exception_only(error)[-1].strip()


def resolve(run: str) -> Callable[[str, Any, Any], Any]:
    """The function that `package.module:function` names."""
    module, _, name = run.partition(":")
    function: Callable[[str, Any, Any], Any] = getattr(importlib.import_module(module), name)
    return function


def _read_frame(stream: BinaryIO) -> bytes | None:
    header = stream.read(LENGTH.size)
    if len(header) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack(header)
    body = stream.read(length)
    return body if len(body) == length else None


def _read_jobs(stream: BinaryIO, jobs: queue.SimpleQueue[bytes]) -> None:
    while (body := _read_frame(stream)) is not None:
        jobs.put(body)
    # The daemon is gone, or has no more use for us: nobody wants the answer to a job under way.
    os._exit(0)


def _detach() -> tuple[BinaryIO, BinaryIO]:
    """Take the pipes away from everybody else's prints, and the signals meant for the daemon from us."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    if sys.platform == "linux":
        # Ends us even inside a computation that never lets another thread run.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    with contextlib.suppress(PermissionError):
        os.nice(NICENESS)
    with contextlib.suppress(OSError):
        # Where memory runs out, better no plan for a while than no service.
        Path("/proc/self/oom_score_adj").write_text(str(OOM_SCORE))
    incoming, outgoing = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    with open(os.devnull, "rb") as nothing:
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return incoming, outgoing


def _answer(run: Callable[[str, Any, Any], Any], body: bytes, context: Any) -> bytes:
    job_id = -1
    try:
        job_id, name, request = pickle.loads(body)
        return frame(("finished", job_id, run(name, request, context)))
    except Exception as error:  # noqa: BLE001 -- whatever a job raises is its answer
        traceback.print_exc()
        return frame(("failed", job_id, last_line(error)))


def main() -> None:
    """Serve until standard input ends."""
    incoming, outgoing = _detach()
    first = _read_frame(incoming)
    if first is None:
        return
    try:
        run_name, context = pickle.loads(first)
        run = resolve(run_name)
    except Exception as error:  # noqa: BLE001 -- importing and unpickling can raise anything; the daemon reports it
        outgoing.write(frame(("broken", last_line(error))))
        outgoing.flush()
        return
    outgoing.write(frame(("ready",)))
    outgoing.flush()
    jobs: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read_jobs, args=(incoming, jobs), daemon=True).start()
    while True:
        outgoing.write(_answer(run, jobs.get(), context))
        outgoing.flush()


if __name__ == "__main__":
    main()
