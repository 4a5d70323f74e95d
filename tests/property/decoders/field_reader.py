"""A child that has field files read by copies of itself, since a process for each of them takes a tenth of a second.

What ends a fresh copy, or holds it for long, is given to `open_netcdf`, whose guard is there for that: it has to
refuse it.
"""

import json
import os
import resource
import select
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from sim.field import FieldError
from sim.field_netcdf import open_netcdf, read_unguarded
from sim.netcdf_guard import LIMITS, limit_time

LONGEST_S = 1.0
"""Of CPU time, and much more of a busy machine's."""

MOST_KIB = 100 * 1024
"""More than the child has after its first file."""

FILES_EACH = 25 if "HALOCLINE_FUZZ" in os.environ else 1
"""What a damaged file leaves behind in the library may spoil the next: a copy reads few, in a short run one. Where
anything unusual comes of a file, a fresh copy reads it again and is believed."""

_ENDED = "ended"
_PATIENCE_S = 30.0


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
        answer = self._ask(path)
        if _is_unusual(answer, self._at_first_kib):
            answer = self._ask(path)
        if answer["error"] == _ENDED:
            print("netcdf: the guard is needed")
            open_netcdf(path)
            raise AssertionError("the guard has let pass what ends a process")
        self._at_first_kib = self._at_first_kib or answer["peak_kib"]
        assert not _is_unusual(answer, self._at_first_kib), answer
        if answer["error"]:
            raise FieldError(answer["words"])

    def _ask(self, path: Path) -> dict[str, Any]:
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
        if not select.select([child.stdout], [], [], _PATIENCE_S)[0]:
            self.close()
            return {"error": _ENDED}
        line = child.stdout.readline()
        assert line, "the child has ended, which reads nothing itself"
        answer: dict[str, Any] = json.loads(line)
        return answer

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            self._child.kill()
            self._child.communicate()
        self._child, self._at_first_kib = None, 0


def _is_unusual(answer: dict[str, Any], at_first_kib: int) -> bool:
    """Whether a file ended its reader, or took too long, too much memory or another error than the documented one."""
    if answer["error"] not in ("", FieldError.__name__):
        return True
    return (
        answer["cpu_s"] >= LONGEST_S or answer["peak_kib"] - (at_first_kib or answer["peak_kib"]) >= MOST_KIB
    )


def main() -> None:
    """What the child does: a name on each line, an answer on each."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    at_first_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    while line := sys.stdin.readline():
        copy = os.fork()
        if not copy:
            left = FILES_EACH
            while line and not _is_unusual(answer(Path(line.rstrip("\n"))), at_first_kib) and left > 1:
                left, line = left - 1, sys.stdin.readline()
            os._exit(0)
        _, status = os.waitpid(copy, 0)
        if status:
            print(json.dumps({"error": _ENDED}), flush=True)


def answer(path: Path) -> dict[str, Any]:
    """Read one file; says, and returns, what came of it."""
    begun = time.process_time()
    error, words = "", ""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit_time(LIMITS.seconds(path.stat().st_size))
    most = pages * resource.getpagesize() + LIMITS.memory(path.stat().st_size)
    resource.setrlimit(resource.RLIMIT_AS, (most, resource.RLIM_INFINITY))
    try:
        read_unguarded(path, None)
    except MemoryError:
        # The guard says so in words.
        error = FieldError.__name__
    except Exception as problem:  # noqa: BLE001 -- the parent judges it
        error, words = type(problem).__name__, str(problem)
    limit_time(0.0)
    peak_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cpu_s = time.process_time() - begun
    told = {"error": error, "words": words, "cpu_s": cpu_s, "peak_kib": peak_kib}
    print(json.dumps(told), flush=True)
    return told


if __name__ == "__main__":
    main()
