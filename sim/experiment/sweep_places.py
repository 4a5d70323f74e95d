"""Where cells are computed: processes of this machine, or the workers of a Dask cluster. Both are executors."""

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

from sim.experiment.cells import SweepError

_CONNECTING_S = 10.0


@dataclass(frozen=True)
class Place:
    """`executor(workers)` opens one; `workers` are as many as shall be used, None for as many as there are."""

    executor: Callable[[int | None], AbstractContextManager[Executor]]
    workers: int | None


def this_machine(jobs: int) -> Place:
    """`jobs` spawned processes. They end with this one, however it ends."""
    return Place(_processes, jobs)


def dask_cluster(address: str) -> Place:
    """All workers of a Dask scheduler, "tcp://host:8786"."""
    return Place(lambda workers: _dask(address), None)


@contextmanager
def _processes(workers: int | None) -> Iterator[Executor]:
    others = set(multiprocessing.active_children())
    spawn = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, mp_context=spawn, initializer=_begin)
    try:
        yield executor
    except BaseException:
        # Ctrl-C, mostly: cells under way are given up, they would be waited for otherwise.
        executor.shutdown(wait=False, cancel_futures=True)
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        executor.shutdown()


def _begin() -> None:
    """In a new worker: Ctrl-C is for the process that asks, and once that is gone nobody wants an answer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _dask(address: str) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise SweepError("a cluster needs Dask: pip install 'halocline[cluster]'") from error
    try:
        client = Client(address, timeout=_CONNECTING_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise SweepError(f"no Dask scheduler answers at {address}: {error}") from error
    if not client.scheduler_info()["workers"]:
        print(f"the scheduler at {address} has no workers yet: waiting for some", file=sys.stderr)
    executor = client.get_executor(pure=False)
    try:
        yield executor
    finally:
        # Whatever is still under way is given up.
        executor.shutdown(wait=False)
        client.close()
