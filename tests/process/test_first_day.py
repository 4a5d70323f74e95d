"""docs/bench.md, typed as it stands there: from a drawn polygon and an instrument's lines to a survey under way.

Ports are free ones instead of those on the page, preflight listens for a shorter while; nothing else is changed.
With HALOCLINE_FIRST_DAY set all of it is typed; without, neither the dry run nor what comes after preflight.
"""

import os
import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from autonomy.cli import main as autonomy
from sim.cli import main as sim

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes, Running, free_port

pytestmark = pytest.mark.process
DOCS = Path(__file__).parents[2] / "docs"
BENCH = (DOCS / "bench.md").read_text()
ALL = "HALOCLINE_FIRST_DAY" in os.environ
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PORTS = ("14550", "14551", "14560", "5600", "7447")
AT_ONCE = {"autonomy": autonomy, "sim": sim}


def typed() -> list[str]:
    """The commands of the page, in order, that call one of our programs."""
    lines = [line for kind, body in FENCE.findall(BENCH) if not kind for line in body.splitlines()]
    return [line for line in lines if line.split(" ")[0] in AT_ONCE]


def quoted(begins: str) -> list[str]:
    """The lines of the quoted output that begins so."""
    return next(body.splitlines() for kind, body in FENCE.findall(BENCH) if kind and body.startswith(begins))


class Bench:
    """Somebody who types."""

    def __init__(self, processes: Processes) -> None:
        self._processes = processes
        self._ports = {port: str(free_port()) for port in PORTS}
        self._left = typed()

    def words(self, begins: str) -> list[str]:
        """The page's next command, which begins so."""
        line = self._left.pop(0)
        assert line.startswith(begins), line
        return shlex.split(self.with_free_ports(line))

    def with_free_ports(self, text: str) -> str:
        """The same, with this test's ports."""
        return re.sub(rf"\b({'|'.join(PORTS)})\b", lambda found: self._ports[found[0]], text)

    def type(self, begins: str, *more: str) -> int:
        """Type it, and wait for its end."""
        program, *words = self.words(begins)
        return AT_ONCE[program]([*words, *more])

    def leave_running(self, begins: str) -> Running:
        """Type it in another terminal."""
        return self._processes.start("-m", *self.words(begins))

    @property
    def is_done(self) -> bool:
        return not self._left


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    with Processes() as processes:
        made = Bench(processes)
        for file in (DOCS / "first-day").iterdir():
            copy = tmp_path / "docs" / "first-day" / file.name
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(made.with_free_ports(file.read_text()))
        yield made


@pytest.mark.timeout(1500 if ALL else 400)
def test_the_bench(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    assert bench.type("sim mask") == 0
    capsys.readouterr()
    assert bench.type("autonomy survey import") == 0
    assert capsys.readouterr().out.splitlines()[:6] == quoted("area")
    assert bench.type("autonomy init") == 0
    assert bench.type("autonomy check-config") == 0
    capsys.readouterr()
    assert bench.type("autonomy plan") == 0
    told = f"\n{capsys.readouterr().out}"
    assert [line for line in quoted("planner") if f"\n{line.split()[0]} " not in told] == []
    dry_run = bench.words("sim dry-run")
    if ALL:
        assert sim(dry_run[1:]) == 0
        assert Path("dry-run/dry-run.png").exists()

    vessel = bench.leave_running("sim vessel")
    vessel.wait_for("ready on")
    assert bench.type("autonomy bridge", "--lines", "2") == 0
    told = capsys.readouterr().out
    assert "\n  SALT = 33." in told
    assert "2 of 2 lines can be read" in told
    bridge = bench.leave_running("autonomy bridge")
    bridge.wait_for("sending")
    assert bench.type("autonomy preflight", "--seconds", "4") == 0
    told = capsys.readouterr().out
    steady = [line for line in quoted("pass autopilot") if not re.search(r"\d+ (readings|pass)", line)]
    assert [line for line in steady if line not in told.splitlines()] == []
    assert re.search(r"^pass sensor.name +SALT is heard", told, re.MULTILINE)
    vessel.stop()
    if not ALL:
        return

    bench.leave_running("sim vessel").wait_for("ready on")
    shore = bench.leave_running("autonomy shore watch")
    service = bench.leave_running("autonomy run")
    for line in quoted("plan 1"):
        service.wait_for(re.split(r"[(:]", line)[0] if line.startswith("plan") else line.split(" of ")[0])
    shore.wait_for("boat1: connected")
    service.wait_for("re-estimated", within_s=300.0)
    assert bench.is_done
    assert service.stop() == 0
