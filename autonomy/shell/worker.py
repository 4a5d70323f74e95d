"""One process beside the daemon for slow, pure jobs; it can be killed at any moment and is replaced."""

import asyncio
import logging
import os
import pickle
import sys
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from autonomy.shell.worker_process import LENGTH, frame, last_line

log = logging.getLogger(__name__)

_MAXIMUM_ANSWER_BYTES = 2**30
_UNPICKLE_IN_THREAD_BYTES = 200_000
_PIECE_BYTES = 2**18
_FIRST_RESTART_PAUSE_S = 0.5
_LONGEST_RESTART_PAUSE_S = 30.0
_END_S = 2.0
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@dataclass(frozen=True)
class _Job:
    job_id: int
    deadline_s: float
    frame: bytes


class Worker:
    """Runs `function(name, request, context)` in one process of its own, one job after the other.

    The process imports and unpickles at once, so that the first job finds it warm. A job that raises is
    answered and the process lives on; a process that dies, or overruns a job's deadline and is therefore
    killed, fails that job alone and is replaced. Everything happens on the event loop that ran `start`, and
    nothing blocks it.

    Args:
        context: handed to every job (the survey area); pickled once.
        run: `package.module:function`, importable where the daemon's modules are.
        on_finished: called on the loop with job_id and result.
        on_failed: called on the loop with job_id and reason, a line for a person.
    """

    def __init__(
        self,
        context: Any,
        on_finished: Callable[[int, Any], None],
        on_failed: Callable[[int, str], None],
        run: str = "autonomy.jobs:run",
    ) -> None:
        self._first_frame = frame((run, context))
        self._on_finished = on_finished
        self._on_failed = on_failed
        self._waiting: deque[_Job] = deque()
        self._current: _Job | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self._deadline: asyncio.TimerHandle | None = None
        self._kill_reason: str | None = None
        self._pause_s = 0.0

    @property
    def busy(self) -> bool:
        """Whether a job is under way or waits."""
        return self._current is not None or bool(self._waiting)

    @property
    def keeper(self) -> "asyncio.Task[None]":
        """The task that keeps a process there; it ends only by `close`, or by a bug. RuntimeError before `start`."""
        if self._task is None:
            raise RuntimeError("the worker isn't started")
        return self._task

    @property
    def pid(self) -> int | None:
        """The present process, None between two."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the process; to be called on the running event loop."""
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._keep_alive())

    def submit(self, job_id: int, name: str, request: Any, deadline_s: float) -> None:
        """Queue a job; exactly one callback follows, unless `close` comes first.

        The request is pickled here and now, so the caller may change it afterwards. The deadline counts from
        the moment the job is handed to the process (while that is starting, start-up counts too).
        """
        if self._task is None:
            raise RuntimeError("the worker isn't started")
        try:
            job = _Job(job_id, deadline_s, frame((job_id, name, request)))
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            asyncio.get_running_loop().call_soon(
                self._on_failed, job_id, f"can't be pickled: {last_line(error)}"
            )
            return
        self._waiting.append(job)
        self._hand_over()

    async def close(self) -> None:
        """Kill the process and wait until it is gone; its jobs are forgotten without a callback."""
        self._waiting.clear()
        self._current = None
        self._disarm()
        if self._task is None:
            return
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        self._task = None

    async def _keep_alive(self) -> None:
        while True:
            await asyncio.sleep(self._pause_s)
            try:
                await self._live_once()
            except OSError as error:
                # No memory or no process left for the moment. Whoever waits hears of it and may ask again.
                self._kill_reason = f"can't start: {last_line(error)}"
                if self._current is None and self._waiting:
                    self._current = self._waiting.popleft()
                self._mourn(None)

    async def _live_once(self) -> None:
        """One process from its start to its end."""
        self._kill_reason = None
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", "autonomy.shell.worker_process"),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=_environment(),
            # Ctrl-C in a terminal is for the daemon.
            process_group=0,
        )
        self._process = process
        try:
            assert process.stdin is not None
            process.stdin.write(self._first_frame)
            self._hand_over()
            await self._listen(process)
        finally:
            self._process = None
            if process.returncode is None:
                process.kill()
            # A wait interrupted by a second cancellation would leave a zombie behind.
            await asyncio.shield(process.wait())
        self._mourn(process.returncode)

    async def _listen(self, process: asyncio.subprocess.Process) -> None:
        """Take answers until the process ends or sends what cannot be understood."""
        assert process.stdout is not None
        while True:
            try:
                (length,) = LENGTH.unpack(await process.stdout.readexactly(LENGTH.size))
                if length > _MAXIMUM_ANSWER_BYTES:
                    self._kill_reason = f"sent an answer of {length} bytes"
                    return
                body = await _read(process.stdout, length)
            except asyncio.IncompleteReadError:
                await self._end(process)
                return
            try:
                answer = (
                    await asyncio.to_thread(pickle.loads, body)
                    if length > _UNPICKLE_IN_THREAD_BYTES
                    else pickle.loads(body)
                )
            except Exception as error:  # noqa: BLE001 -- unpickling runs code of the result's classes
                self._finish(self._on_failed, f"its result can't be unpickled: {last_line(error)}")
                continue
            self._take(answer)

    async def _end(self, process: asyncio.subprocess.Process) -> None:
        """The process has closed its side: let it end by itself, for killing it now would hide how it does."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_END_S):
                await process.wait()

    def _take(self, answer: tuple[Any, ...]) -> None:
        match answer:
            case ("ready",):
                self._pause_s = 0.0
            case ("broken", reason):
                self._kill_reason = f"can't start: {reason}"
            case ("finished", job_id, result) if self._current is not None and job_id == self._current.job_id:
                self._finish(self._on_finished, result)
            case ("failed", job_id, reason) if self._current is not None:
                self._finish(self._on_failed, reason)

    def _finish(self, callback: Callable[[int, Any], None], outcome: Any) -> None:
        """Report the current job; through the loop, lest an exception of the caller's end the worker."""
        self._disarm()
        if self._current is not None:
            asyncio.get_running_loop().call_soon(callback, self._current.job_id, outcome)
            self._current = None
        self._hand_over()

    def _hand_over(self) -> None:
        process = self._process
        if process is None or process.stdin is None or process.returncode is not None:
            return
        if self._current is not None or not self._waiting:
            return
        job = self._waiting.popleft()
        self._current = job
        # The transport buffers what the pipe doesn't take, and the loop writes it on.
        process.stdin.write(job.frame)
        self._deadline = asyncio.get_running_loop().call_later(job.deadline_s, self._overrun, job)

    def _overrun(self, job: _Job) -> None:
        self._kill_reason = f"took longer than {job.deadline_s:g} s and was killed"
        if self._process is not None and self._process.returncode is None:
            self._process.kill()

    def _disarm(self) -> None:
        if self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def _mourn(self, returncode: int | None) -> None:
        """The process is gone: fail the job it had, and decide how soon the next one starts."""
        reason = self._kill_reason or _cause(returncode)
        log.warning("the worker process is replaced: %s", reason)
        if self._kill_reason is None or self._kill_reason.startswith("can't start"):
            self._pause_s = min(_LONGEST_RESTART_PAUSE_S, max(_FIRST_RESTART_PAUSE_S, 2 * self._pause_s))
        self._finish(self._on_failed, reason)


async def _read(stream: asyncio.StreamReader, length: int) -> bytearray:
    """Exactly `length` bytes, copied in small pieces, lest the loop wait for many megabytes."""
    body = bytearray(length)
    filled = 0
    while filled < length:
        piece = await stream.read(min(_PIECE_BYTES, length - filled))
        if not piece:
            raise asyncio.IncompleteReadError(b"", length)
        body[filled : filled + len(piece)] = piece
        filled += len(piece)
    return body


def _cause(returncode: int | None) -> str:
    if returncode is not None and returncode < 0:
        return f"the worker process was killed by signal {-returncode}"
    return f"the worker process ended by itself with exit code {returncode}"


def _environment() -> dict[str, str]:
    """One thread for BLAS, because the cores are needed elsewhere; and the modules the daemon sees."""
    paths = [path if path else os.getcwd() for path in sys.path]
    threads = dict.fromkeys(_THREAD_VARIABLES, "1")
    return {**os.environ, **threads, "PYTHONPATH": os.pathsep.join(paths)}
