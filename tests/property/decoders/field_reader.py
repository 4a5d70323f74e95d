"""A child that reads field files one after another, since a process for each of them takes a tenth of a second.

What ends it, or holds it for long, is given to `open_netcdf`, whose guard is there for that: it has to refuse it.
"""

import json
import os
import resource
import select
import subprocess
import sys
import time
from pathlib import Path

from sim.field import FieldError
from sim.field_netcdf import open_netcdf, read_unguarded
from sim.netcdf_guard import LIMITS

LONGEST_S = 1.0
"""Of CPU time, and much more of a busy machine's."""

MOST_KIB = 100 * 1024
"""More than the child has after its first file."""

_PATIENCE_S = 30.0
_MOST_CPU_S = 10
"""Then a copy that hangs ends by itself, whoever still waits for it."""


class FieldReader:
    """Reads files in a child; to be called with a file's name."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._at_first_kib = 0

    def __call__(self, path: Path) -> None:
        """Read the file.

        Raises:
            FieldError: it can't be read.
            AssertionError: something else was raised, or it took too long, or too much memory.
        """
        if self._child is None:
            self._child = subprocess.Popen(
                [sys.executable, __file__],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
        child = self._child
        assert child.stdin is not None
        assert child.stdout is not None
        child.stdin.write(f"{path}\n".encode())
        child.stdin.flush()
        line = child.stdout.readline() if select.select([child.stdout], [], [], _PATIENCE_S)[0] else b""
        if not line:
            child.kill()
            print(f"netcdf: the guard is needed: {child.wait()}")
            self.close()
            open_netcdf(path)
            raise AssertionError("the guard has let pass what ends a process")
        answer = json.loads(line)
        self._at_first_kib = self._at_first_kib or answer["peak_kib"]
        assert answer["cpu_s"] < LONGEST_S, answer
        assert answer["peak_kib"] - self._at_first_kib < MOST_KIB, answer
        assert answer["error"] in ("", "FieldError"), answer
        if answer["error"]:
            raise FieldError(answer["words"])

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
        self._child, self._at_first_kib = None, 0


def main() -> None:
    """What the child does: a name on each line, an answer on each."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for line in sys.stdin:
        # What a damaged file leaves behind in the library would spoil the next: each is read by a copy.
        copy = os.fork()
        if not copy:
            answer(Path(line.rstrip("\n")))
            os._exit(0)
        _, status = os.waitpid(copy, 0)
        if status:
            sys.exit(1)


def answer(path: Path) -> None:
    """Read one file and say what came of it."""
    begun = time.process_time()
    error, words = "", ""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_CPU, (_MOST_CPU_S, _MOST_CPU_S))
    most = pages * resource.getpagesize() + LIMITS.memory(path.stat().st_size)
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
    try:
        read_unguarded(path, None)
    except MemoryError:
        # The guard says so in words.
        error = FieldError.__name__
    except Exception as problem:  # noqa: BLE001 -- the parent judges it
        error, words = type(problem).__name__, str(problem)
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cost = {"cpu_s": time.process_time() - begun, "peak_kib": peak_kib}
    print(json.dumps({"error": error, "words": words, **cost}), flush=True)


if __name__ == "__main__":
    main()
