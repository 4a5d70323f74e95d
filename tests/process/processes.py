"""Real processes for tests: started on free ports, waited for with deadlines, and none left behind."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType

SOON_S = 60.0
"""Deadlines only end tests that have failed: a busy machine takes its time."""

_POLL_S = 0.02
_THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def free_port() -> int:
    """A port of the loopback interface that was free a moment ago, for UDP and TCP alike."""
    with socket.socket() as tcp, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
        tcp.bind(("127.0.0.1", 0))
        port = int(tcp.getsockname()[1])
        udp.bind(("127.0.0.1", port))
        return port


def wait_until(condition: Callable[[], object], within_s: float = SOON_S, what: str = "it") -> None:
    """Poll a condition that another process fulfils."""
    deadline = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline, f"{what} didn't come to pass within {within_s:g} s"
        time.sleep(_POLL_S)


class Running:
    """One process, leader of a session of its own, with everything it prints in a file."""

    def __init__(self, words: tuple[str, ...], log: Path, environment: Mapping[str, str]) -> None:
        self.words = words
        self._log = log
        self._last_words: str | None = None
        with log.open("wb") as file:
            self.popen = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                env={
                    **os.environ,
                    **_THREADS,
                    "XDG_STATE_HOME": str(log.with_suffix(".state")),
                    **environment,
                },
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Of the process, which is also its session's."""
        return self.popen.pid

    @property
    def said(self) -> str:
        """Everything it has printed so far."""
        return self._log.read_text(errors="replace") if self._last_words is None else self._last_words

    def wait_for(self, words: str, within_s: float = SOON_S, count: int = 1) -> None:
        """Wait until it has said these words `count` times."""
        self.wait_until(lambda: self.said.count(words) >= count, within_s, repr(words))

    def wait_until(self, condition: Callable[[], object], within_s: float = SOON_S, what: str = "it") -> None:
        """Wait until something has come to pass that needs this process to live."""

        def fulfilled() -> object:
            done = condition()
            assert done or self.popen.poll() is None, f"ended with {self.popen.returncode}, before {what}"
            return done

        wait_until(fulfilled, within_s, what)

    def send(self, number: signal.Signals) -> None:
        """Send the process, and only it, a signal."""
        self.popen.send_signal(number)

    def wait(self, within_s: float = SOON_S) -> int:
        """Its exit code, once it has ended."""
        try:
            return self.popen.wait(within_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"still there after {within_s:g} s, saying:\n{self.said}") from None

    def stop(self, number: signal.Signals = signal.SIGTERM, within_s: float = SOON_S) -> int:
        """Ask it to end; its exit code."""
        self.send(number)
        return self.wait(within_s)

    def family(self) -> list[int]:
        """The processes of its session that are alive: itself, and whatever it started."""
        return [pid for pid, session in _sessions() if session == self.pid]

    def kill(self) -> None:
        """End it and whatever it started, at once."""
        for pid in self.family():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self.popen.wait()
        self._last_words = self.said


class Vessel(Running):
    """`sim vessel`, ready; `port` is that of its `udpin` endpoint, 0 if it has none."""

    port = 0


class Processes:
    """Starts processes; at the end of the block none of them, nor of their children, is left."""

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="halocline-test-")
        self._all: list[Running] = []

    def __enter__(self) -> "Processes":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for running in reversed(self._all):
            running.kill()
            if error is not None:
                print(f"{' '.join(running.words)} said:\n{running.said}")
        self._folder.cleanup()

    def start(self, *words: str, environment: Mapping[str, str] | None = None) -> Running:
        """Start `python WORDS`."""
        return self.program(sys.executable, *words, environment=environment)

    def program(self, *words: str, environment: Mapping[str, str] | None = None) -> Running:
        """Start any program."""
        return self._kept(Running(words, self._next_log(), environment or {}))

    def vessel(self, *options: str) -> Vessel:
        """Start `sim vessel` and wait until it is ready; it listens on a free UDP port unless told otherwise."""
        where = () if "--listen" in options else ("--listen", "udpin:127.0.0.1:0")
        vessel = Vessel((sys.executable, "-m", "sim", "vessel", *where, *options), self._next_log(), {})
        self._kept(vessel)
        vessel.wait_for("ready on")
        found = re.search(r"udpin:127\.0\.0\.1:(\d+)", vessel.said)
        vessel.port = int(found[1]) if found else 0
        return vessel

    def service(self, config: Path, *options: str, environment: Mapping[str, str] | None = None) -> Running:
        """Start `autonomy run`."""
        return self.start("-m", "autonomy", "run", "--config", str(config), *options, environment=environment)

    def _next_log(self) -> Path:
        return Path(self._folder.name) / f"{len(self._all)}.log"

    def _kept(self, running: Running) -> "Running":
        self._all.append(running)
        return running


def _sessions() -> Iterator[tuple[int, int]]:
    """Process id and session id of everything that runs and isn't a zombie; see proc_pid_stat(5)."""
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            # The name, in parentheses, may hold spaces and parentheses itself.
            state, _, _, session = stat.read_text().rpartition(")")[2].split()[:4]
            if state not in "ZX":
                yield int(stat.parent.name), int(session)
