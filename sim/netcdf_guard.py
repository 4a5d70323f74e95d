"""NetCDF files are tried in a process of their own first: a damaged one may hang the library, or end the process.

HDF5 checks little of what it reads, and follows whatever addresses a file holds. So a child reads the file as it will
be read here, under limits of time and memory; only what it has survived is opened. To start a child takes half a
second, which is why it is done once per file. All that reading needs is imported before the limits hold: a linear
algebra library takes as much memory as they leave. It leaves no helper of its own behind.
"""

import contextlib
import functools
import pickle
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sim.field import FieldError

_MIB = 2**20
_LONGEST_TEXT = 10_000
_REFUSED = 65
_REMEMBERED = 64
_CHILD = (
    "import pickle, sys; told = sys.stdin.buffer; sys.path[:] = pickle.load(told); "
    "from sim.netcdf_guard import try_reading; try_reading(*pickle.load(told))"
)


@dataclass(frozen=True)
class Limits:
    """What reading a file may cost: so much, and so much more for each byte of it.

    A sound file is read at some hundred MB/s; compressed, and as numbers of eight bytes, it takes fifty times its size.
    Of time the first MiBs get more, for slow computers; a damaged file of 64 KiB holds nobody up for a second.
    """

    cpu_s: float = 0.5
    cpu_s_per_mib: float = 5.0
    large_cpu_s: float = 20.0
    large_cpu_s_per_mib: float = 0.5
    waiting_s: float = 120.0
    memory_mib: float = 64.0
    memory_per_byte: float = 256.0

    def seconds(self, size: int) -> float:
        """Of CPU time, once all is imported."""
        mib = size / _MIB
        return self.cpu_s + min(self.cpu_s_per_mib * mib, self.large_cpu_s + self.large_cpu_s_per_mib * mib)

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
    wanted = pickle.dumps(sys.path) + pickle.dumps((path, variable, read, limits, size))
    seconds = limits.seconds(size)
    try:
        child = subprocess.run(
            [sys.executable, "-c", _CHILD],
            input=wanted,
            capture_output=True,
            timeout=seconds + limits.waiting_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise FieldError(f"{path}: it is damaged: {_ending(-signal.SIGPROF, seconds)}") from None
    if child.returncode == _REFUSED:
        raise FieldError(child.stdout.decode(errors="replace"))
    if child.returncode:
        raise FieldError(f"{path}: it is damaged: {_ending(child.returncode, seconds)}")


def try_reading(
    path: Path, variable: str | None, read: Callable[[Path, str | None], object], limits: Limits, size: int
) -> None:
    """What the child does: read the file under limits, and say why if it can't be read."""
    limit_time(limits.seconds(size))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with contextlib.suppress(ValueError):  # where address space can't be limited
        resource.setrlimit(resource.RLIMIT_AS, (_address_space() + limits.memory(size),) * 2)
    try:
        read(path, variable)
    except FieldError as error:
        problem = str(error)[:_LONGEST_TEXT]
    except MemoryError:
        problem = f"{path}: it is damaged: reading it takes more memory than a sound file of its size would"
    else:
        return
    sys.stdout.buffer.write(problem.encode())
    sys.stdout.flush()
    sys.exit(_REFUSED)


def limit_time(seconds: float) -> None:
    """End this process, whatever code it runs, after so much CPU time from now; 0: do not."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, seconds)


def _address_space() -> int:
    """Bytes that this process has mapped; 0 where nobody tells."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        return 0


def _ending(exit_code: int, seconds: float) -> str:
    if exit_code in (-signal.SIGPROF, -signal.SIGKILL):
        return f"reading it does not end within {seconds:.1f} s"
    name = signal.Signals(-exit_code).name if exit_code < 0 else f"exit {exit_code}"
    return f"reading it ends the process ({name})"
