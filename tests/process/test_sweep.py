"""A sweep that is killed, or stopped by hand, half-way: what it finished is kept, and nobody works on."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes, Running, wait_until

CELLS = Path(__file__).parents[1] / "unit" / "sim" / "experiment"
SCRIPT = """
import argparse, sys
from pathlib import Path
from sim.experiment import cli
from sim.experiment.cells import Cell
from sim.experiment.sweep import run

def sweep(arguments):
    folder = Path(sys.argv[1])
    given = {"calls": str(folder / "calls"), "waits_from": 3, "until": str(folder / "go on with ")}
    cells = [Cell(f"cell {seed}", "sweep_cells:waiting", {"seed": seed, **given}) for seed in range(6)]
    print(*[repr(result.values["value"]) for result in run(cells, folder / "kept")])
    return 0

if __name__ == "__main__":
    sys.exit(cli.run(argparse.Namespace(run_experiment=sweep, experiment_verb="compare")))
"""


@pytest.mark.process
def test_only_what_was_missing_is_computed_after_an_end_half_way(tmp_path: Path) -> None:
    """Killed in the fourth of six cells, ended by Ctrl-C in the fifth: both times no process is left that works on."""
    (tmp_path / "sweep.py").write_text(SCRIPT)
    with Processes() as processes:

        def started() -> Running:
            words = (str(tmp_path / "sweep.py"), str(tmp_path))
            return processes.start(*words, environment={"PYTHONPATH": str(CELLS)})

        def is_under_way(seed: int) -> bool:
            """Whether that cell has been called, and those before it are kept."""
            is_called = (tmp_path / "calls" / str(seed)).is_dir()
            return is_called and len(list((tmp_path / "kept").glob("*.nc"))) == seed

        killed = started()
        killed.wait_until(lambda: is_under_way(3), what="the fourth cell")
        assert len(killed.family()) >= 2
        assert killed.stop(signal.SIGKILL) == -signal.SIGKILL
        wait_until(lambda: not killed.family(), what="the end of its workers")

        (tmp_path / "go on with 3").touch()
        stopped = started()
        stopped.wait_until(lambda: is_under_way(4), what="the fifth cell")
        os.killpg(stopped.pid, signal.SIGINT)
        assert stopped.wait() == 130
        wait_until(lambda: not stopped.family(), what="the end of its workers")
        assert "finished cells are kept" in stopped.said
        assert "Traceback" not in stopped.said

        (tmp_path / "go on with 4").touch()
        (tmp_path / "go on with 5").touch()
        last = started()
        assert last.wait() == 0, last.said
        assert "damaged" not in last.said
        *_, values = last.said.splitlines()
    assert values.split() == [repr(float(np.random.default_rng(seed).normal())) for seed in range(6)]
    calls = {int(seed.name): len(list(seed.iterdir())) for seed in (tmp_path / "calls").iterdir()}
    assert calls == {0: 1, 1: 1, 2: 1, 3: 2, 4: 2, 5: 1}
