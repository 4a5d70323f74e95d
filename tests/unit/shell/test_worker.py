"""The worker against a real process: answers, failures, crashes, overruns, orphans."""

import asyncio
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from autonomy.shell.worker import Worker
from autonomy.shell.worker_process import OOM_SCORE

HERE = Path(__file__).parent
LONG_S = 60.0


class Desk:
    """A worker and what it answered, in order."""

    def __init__(self, run="worker_jobs:run", context=100):
        self.answers: asyncio.Queue = asyncio.Queue()
        self.worker = Worker(
            context,
            lambda job_id, result: self.answers.put_nowait((job_id, "finished", result)),
            lambda job_id, reason: self.answers.put_nowait((job_id, "failed", reason)),
            run,
        )

    async def __aenter__(self):
        self.worker.start()
        return self

    async def __aexit__(self, *_):
        await self.worker.close()

    async def ask(self, job_id, name, request=None, deadline_s=LONG_S):
        self.worker.submit(job_id, name, request, deadline_s)
        return await asyncio.wait_for(self.answers.get(), LONG_S)


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.syspath_prepend(str(HERE))


def in_loop(coroutine):
    return asyncio.run(coroutine)


def test_answers_raises_and_goes_on_in_the_same_process():
    async def scenario():
        async with Desk() as desk:
            assert await desk.ask(1, "add", 11) == (1, "finished", 111)
            _, _, first = await desk.ask(2, "pid")
            assert await desk.ask(3, "raise", "no such key") == (3, "failed", "KeyError: 'no such key'")
            assert await desk.ask(4, "print") == (4, "finished", "printed")
            job_id, kind, reason = await desk.ask(5, "unpicklable")
            assert (job_id, kind, reason) == (5, "failed", "TypeError: stays at home")
            assert await desk.ask(6, "environment") == (
                6,
                "finished",
                {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            )
            _, _, big = await desk.ask(7, "big", 3_000_000)
            assert np.all(big == 1.5)
            assert await desk.ask(8, "pid") == (8, "finished", first)
            job_id, kind, reason = await desk.ask(9, "add", lambda: None)
            assert (job_id, kind) == (9, "failed")
            assert "can't be pickled" in reason
            assert not desk.worker.busy

    in_loop(scenario())


def test_the_loop_turns_while_a_big_result_comes_in():
    async def scenario():
        async with Desk() as desk:
            turns = 0
            desk.worker.submit(1, "big", 4_000_000, LONG_S)
            while desk.answers.empty():
                turns += 1
                await asyncio.sleep(0)
            assert turns > 100

    in_loop(scenario())


def test_the_kernel_takes_the_worker_before_the_service():
    async def scenario():
        async with Desk() as desk:
            _, _, pid = await desk.ask(1, "pid")
            of_worker, of_service = (
                int(Path(f"/proc/{process}/oom_score_adj").read_text()) for process in (pid, "self")
            )
            assert of_worker == max(of_service, OOM_SCORE)

    in_loop(scenario())


def test_a_crash_fails_its_job_alone():
    async def scenario():
        async with Desk() as desk:
            desk.worker.submit(1, "exit", 3, LONG_S)
            desk.worker.submit(2, "add", 1, LONG_S)
            assert await desk.answers.get() == (
                1,
                "failed",
                "the worker process ended by itself with exit code 3",
            )
            assert await desk.answers.get() == (2, "finished", 101)
            os.kill(desk.worker.pid, signal.SIGKILL)
            assert await desk.ask(3, "add", 2) in (
                (3, "finished", 102),
                (3, "failed", "the worker process was killed by signal 9"),
            )
            assert await desk.ask(4, "add", 3) == (4, "finished", 103)

    in_loop(scenario())


@pytest.mark.parametrize("hang", [("sleep", 1000), ("hold", 1_000_000_000)])
def test_an_overrun_is_killed_and_replaced(hang):
    async def scenario():
        async with Desk() as desk:
            _, _, first = await desk.ask(1, "pid")
            job_id, kind, reason = await desk.ask(2, *hang, deadline_s=0.2)
            assert (job_id, kind, reason) == (2, "failed", "took longer than 0.2 s and was killed")
            _, kind, second = await desk.ask(3, "pid")
            assert kind == "finished"
            assert second != first
            with pytest.raises(ProcessLookupError):
                os.kill(first, 0)

    in_loop(scenario())


def test_signals_for_the_daemon_leave_the_worker_alone():
    async def scenario():
        async with Desk() as desk:
            _, _, pid = await desk.ask(1, "pid")
            os.kill(pid, signal.SIGINT)
            os.kill(pid, signal.SIGTERM)
            assert await desk.ask(2, "pid") == (2, "finished", pid)

    in_loop(scenario())


def test_a_worker_that_cannot_start_says_why():
    async def scenario():
        async with Desk(run="no_such_module:run") as desk:
            job_id, kind, reason = await desk.ask(1, "add", 1)
            assert (job_id, kind) == (1, "failed")
            assert reason == "can't start: ModuleNotFoundError: No module named 'no_such_module'"

    in_loop(scenario())


def test_closing_kills_and_forgets():
    async def scenario():
        desk = Desk()
        async with desk:
            _, _, pid = await desk.ask(1, "pid")
            desk.worker.submit(2, "hold", 1_000_000_000, LONG_S)
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
        assert desk.answers.empty()
        await desk.worker.close()
        with pytest.raises(RuntimeError, match="isn't started"):
            desk.worker.submit(3, "add", 1, LONG_S)

    in_loop(scenario())


def test_closing_at_once_leaves_nothing():
    async def scenario():
        async with Desk():
            pass

    in_loop(scenario())


PARENT = """
    import asyncio, sys
    sys.path.insert(0, {here!r})
    from autonomy.shell.worker import Worker

    async def main():
        worker = Worker(0, lambda *_: print(_[1], flush=True), lambda *_: None, "worker_jobs:run")
        worker.start()
        worker.submit(1, "pid", None, 60)
        worker.submit(2, "hold", 1_000_000_000, 60)
        await asyncio.sleep(1000)

    asyncio.run(main())
"""


def test_no_orphan_when_the_daemon_is_killed():
    program = textwrap.dedent(PARENT.format(here=str(HERE)))
    # The worker inherits standard error: it reaches its end only when both processes are gone.
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as parent:
        pid = int(parent.stdout.readline())
        os.kill(pid, 0)
        parent.kill()
        assert parent.stderr.read() == ""


def test_a_moment_without_processes_fails_one_job_and_passes(monkeypatch):
    """The kernel may have no process to give (EAGAIN) or no memory; the next start succeeds."""
    real, attempts = asyncio.create_subprocess_exec, []

    async def scarce(*arguments, **settings):
        attempts.append(1)
        if len(attempts) == 1:
            raise BlockingIOError(11, "Resource temporarily unavailable")
        return await real(*arguments, **settings)

    monkeypatch.setattr(asyncio, "create_subprocess_exec", scarce)

    async def scenario():
        async with Desk() as desk:
            job_id, kind, reason = await desk.ask(1, "add", 1)
            assert (job_id, kind) == (1, "failed")
            assert "can't start" in reason
            assert await desk.ask(2, "add", 11) == (2, "finished", 111)
            assert not desk.worker.keeper.done()

    in_loop(scenario())


def test_what_only_the_worker_needs_does_not_hold_up_the_service():
    said = "import sys, autonomy.shell.daemon; print('scipy.optimize' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", said], capture_output=True, text=True, check=True, timeout=100
    )
    assert done.stdout == "False\n"
