"""NetCDF files are tried in a process of their own first: a damaged one may hang the library, or end the process.

HDF5 checks little of what it reads, and follows whatever addresses a file holds. So a child reads the file as it will
be read here, under limits of time and memory; only what it has survived is opened. Children are forked from a server
that has the library loaded already, which takes some hundredths of a second.
"""

import contextlib
import functools
import multiprocessing
import resource
import signal
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from sim.field import FieldError

_MIB = 2**20
_LONGEST_TEXT = 10_000
_REMEMBERED = 64


@dataclass(frozen=True)
class Limits:
    """What reading a file may cost: so much, and so much more for each byte of it.

    A sound file is read at some hundred MB/s; compressed, and as numbers of eight bytes, it takes fifty times its size.
    """

    cpu_s: float = 20.0
    cpu_s_per_mib: float = 0.5
    waiting_s: float = 120.0
    memory_mib: float = 512.0
    memory_per_byte: float = 64.0

    def seconds(self, size: int) -> float:
        """Of CPU time."""
        return self.cpu_s + self.cpu_s_per_mib * size / _MIB

    def memory(self, size: int) -> int:
        """Bytes beyond what the child has when it begins."""
        return int(self.memory_mib * _MIB + self.memory_per_byte * size)


LIMITS = Limits()


def check_readable(path: Path, variable: str | None, read: Callable[[Path, str | None], object]) -> None:
    """See that a file can be read; a file that has not changed since is not tried again.

    Args:
        path: the file.
        variable: which one of it is wanted.
        read: reads it, raising FieldError; a function of a module.

    Raises:
        FieldError: from `read`; or reading it ends the process, or takes more time or memory than a sound one would.
        OSError: the file is gone, or there are no processes to be had.
    """
    status = path.stat()
    _check(path.absolute(), variable, read, LIMITS, status.st_size, status.st_mtime_ns, status.st_ino)


@functools.lru_cache(maxsize=_REMEMBERED)
def _check(
    path: Path,
    variable: str | None,
    read: Callable[[Path, str | None], object],
    limits: Limits,
    size: int,
    *_identity: int,
) -> None:
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([read.__module__])
    answer, told = context.Pipe(duplex=False)
    child = context.Process(target=_try, args=(told, path, variable, read, limits, size), daemon=True)
    child.start()
    told.close()
    try:
        in_time = answer.poll(limits.seconds(size) + limits.waiting_s)
        problem = answer.recv_bytes(4 * _LONGEST_TEXT).decode(errors="replace") if in_time else None
    except (EOFError, OSError):
        problem = None
    finally:
        answer.close()
        child.kill()
        child.join()
    if problem is None:
        raise FieldError(f"{path}: it is damaged: {_ending(child.exitcode, limits.seconds(size))}")
    if problem:
        raise FieldError(problem)


def _try(
    told: Connection,
    path: Path,
    variable: str | None,
    read: Callable[[Path, str | None], object],
    limits: Limits,
    size: int,
) -> None:
    seconds = max(1, round(limits.seconds(size)))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(ValueError):  # where address space can't be limited
        resource.setrlimit(resource.RLIMIT_AS, (_address_space() + limits.memory(size),) * 2)
    problem = ""
    try:
        read(path, variable)
    except FieldError as error:
        problem = str(error)[:_LONGEST_TEXT]
    except MemoryError:
        problem = f"{path}: it is damaged: reading it takes more memory than a sound file of its size would"
    told.send_bytes(problem.encode())


def _address_space() -> int:
    """Bytes that this process has mapped; 0 where nobody tells."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        return 0


def _ending(exit_code: int | None, seconds: float) -> str:
    if exit_code in (-signal.SIGXCPU, -signal.SIGKILL):
        return f"reading it does not end within {seconds:.0f} s"
    name = signal.Signals(-exit_code).name if exit_code is not None and exit_code < 0 else f"exit {exit_code}"
    return f"reading it ends the process ({name})"
