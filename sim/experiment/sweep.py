"""Sweeps: many cells on this machine's cores or on a Dask cluster, the finished ones kept.

Theory of operation. A cell's fingerprint is a digest of its function, its arguments, the content of its input files
and the version of all code it can reach. A finished cell is a file under that name; what has one is not computed
again. The others go through an executor of `concurrent.futures`, which spawned processes and Dask both have. The
worker hands back the file's bytes, and this process alone writes: workers need no common disk. Results are read from
these files, whether they are of today or of an earlier, interrupted run. Nothing that a cell is given depends on the
order or on the number of workers.
"""

import hashlib
import json
import sys
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tqdm import tqdm

from sim.experiment.cells import Cell, Result, SweepError
from sim.experiment.storage import CellFolder, decode, digest_of
from sim.experiment.sweep_places import Place, dask_cluster, this_machine
from sim.experiment.sweep_provenance import commit, version_here
from sim.experiment.sweep_worker import Failure, Task, compute

_Keep = Callable[[Task, bytes | Failure], None]


def run(
    cells: Sequence[Cell],
    folder: Path,
    jobs: int = 1,
    cluster: str | None = None,
    progress: bool = True,
) -> list[Result]:
    """Compute the cells that `folder` does not hold yet; the results of all, in the cells' order.

    `jobs` processes on this machine, or the workers of the Dask scheduler `cluster` ("tcp://host:8786"). The values
    are the same either way. A cell that fails does not keep the others from being computed. Raises `SweepError`
    in the end if any has failed, or at once if the sweep can't begin.
    """
    known, inputs = commit(), _digests(cells)
    tasks = [_task(cell, inputs, known) for cell in cells]
    place = this_machine(jobs) if cluster is None else dask_cluster(cluster)
    store = CellFolder(folder)
    with store.held():
        failures = _complete(tasks, store, place, progress)
        if failures:
            raise SweepError(_told(cells, tasks, failures))
        return [_result(cell, task, store) for cell, task in zip(cells, tasks, strict=True)]


def _digests(cells: Sequence[Cell]) -> dict[Path, str]:
    """Of every input file, read once however many cells name it."""
    try:
        return {
            path: digest_of(path.read_bytes()) for path in {path for cell in cells for path in cell.inputs}
        }
    except OSError as error:
        raise SweepError(f"a cell's input can't be read: {error}") from error


def _task(cell: Cell, inputs: Mapping[Path, str], known: Mapping[str, Any]) -> Task:
    module, colon, name = cell.function.partition(":")
    if not (module and colon and name):
        raise SweepError(f"cell {cell.name}: function must be module:function (got {cell.function!r})")
    try:
        arguments = json.dumps(cell.arguments, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise SweepError(f"cell {cell.name}: its arguments must be what JSON knows: {error}") from error
    version = version_here(module)
    read = {str(path): inputs[path] for path in cell.inputs}
    asked = [cell.function, arguments, list(read.values()), asdict(version)]
    fingerprint = hashlib.sha256(json.dumps(asked).encode()).hexdigest()[:32]
    plain = json.loads(arguments)
    provenance = {
        "cell": cell.name,
        "function": cell.function,
        "arguments": plain,
        "seed": plain.get("seed"),
        "inputs": read,
        **known,
    }
    return Task(fingerprint, cell.function, arguments, version, provenance)


def _complete(tasks: Sequence[Task], store: CellFolder, place: Place, progress: bool) -> dict[str, Failure]:
    """Compute what the store lacks; the failures, by fingerprint."""
    wanted = {task.fingerprint: task for task in tasks}
    missing = [task for task in wanted.values() if not _is_kept(task, store)]
    failures: dict[str, Failure] = {}
    # Without smoothing the time left counts with the mean of all cells: they come back in bursts.
    bar = tqdm(
        total=len(wanted), initial=len(wanted) - len(missing), unit="cell", smoothing=0, disable=not progress
    )

    def keep(task: Task, outcome: bytes | Failure) -> None:
        if isinstance(outcome, Failure):
            failures[task.fingerprint] = outcome
            _say(f"cell {_named(task)} failed: {outcome.details or outcome.reason}")
        else:
            store.keep(task.fingerprint, outcome)
        bar.update()

    with bar:
        _compute_all(missing, place, keep)
    return failures


def _compute_all(tasks: Sequence[Task], place: Place, keep: _Keep) -> None:
    """Hand every task's outcome to `keep`.

    If a process dies all cells under way fail, and who was to blame can't be seen. So each of them is tried again
    alone.
    """
    waiting, suspects = deque(tasks), list[Task]()
    while waiting:
        with place.executor(place.workers) as executor:
            _compute_many(waiting, executor, place.workers or len(waiting), keep, suspects)
    for task in suspects:
        with place.executor(1) as executor:
            try:
                keep(task, executor.submit(compute, task).result())
            except BrokenExecutor:
                keep(task, Failure("its process died: of too little memory, or of a crash in compiled code"))


def _compute_many(
    waiting: deque[Task], executor: Executor, at_once: int, keep: _Keep, suspects: list[Task]
) -> None:
    """Take tasks from `waiting`, so many at once, until none is left or the executor breaks."""
    under_way: dict[Future[bytes | Failure], Task] = {}
    while True:
        try:
            while waiting and len(under_way) < at_once:
                under_way[executor.submit(compute, waiting[0])] = waiting[0]
                waiting.popleft()
        except BrokenExecutor:
            at_once = 0
        if not under_way:
            return
        for future in wait(under_way, return_when=FIRST_COMPLETED).done:
            task = under_way.pop(future)
            try:
                outcome = future.result()
            except BrokenExecutor:
                suspects.append(task)
                continue
            except Exception as error:  # noqa: BLE001 -- a cluster has many ways to lose a cell; each is its outcome
                outcome = Failure(f"lost by the cluster: {type(error).__name__}: {error}")
            keep(task, outcome)
        # A cluster keeps what somebody may still ask for, and computes it once more if a worker is lost.
        del future


def _is_kept(task: Task, store: CellFolder) -> bool:
    data, damaged = store.load(task.fingerprint)
    if data is None and damaged:
        _say(f"{', '.join(map(str, damaged))}: damaged; cell {_named(task)} is computed again")
    return data is not None


def _result(cell: Cell, task: Task, store: CellFolder) -> Result:
    data, _ = store.load(task.fingerprint)
    if data is None:
        raise SweepError(f"the file of cell {_named(task)} has gone")
    return Result(cell, *decode(data))


def _named(task: Task) -> str:
    return f"{task.provenance['cell']!r} {task.function}({task.arguments})"


def _told(cells: Sequence[Cell], tasks: Sequence[Task], failures: Mapping[str, Failure]) -> str:
    lines = [
        f"  {_named(task)}: {failures[task.fingerprint].reason}"
        for task in tasks
        if task.fingerprint in failures
    ]
    return f"{len(lines)} of {len(cells)} cells failed; the others are kept\n" + "\n".join(lines)


def _say(text: str) -> None:
    tqdm.write(text, file=sys.stderr)
