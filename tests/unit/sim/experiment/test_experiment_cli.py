"""`sim experiment`: its verbs, what they import, and how failures end."""

import argparse
import subprocess
import sys

import pytest

from sim.experiment import cli
from sim.experiment.cells import SweepError
from sim.experiment.sweep_options import add_sweep_arguments

HEAVY = ("scipy", "matplotlib", "netCDF4", "xarray", "distributed", "shapely", "pymavlink")


def test_help_imports_nothing_heavy():
    script = (
        "import sys\n"
        "from sim.cli import main\n"
        "try:\n    main(['experiment', '--help'])\n"
        "except SystemExit:\n    pass\n"
        f"print('imported', *[name for name in {HEAVY} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert "paper" in done.stdout
    assert "compare" in done.stdout
    assert done.stdout.splitlines()[-1].split() == ["imported"]


@pytest.mark.parametrize(
    ("raised", "code", "said"),
    [
        (None, 0, ""),
        (SweepError("1 of 2 cells failed"), 1, "sim experiment paper: 1 of 2 cells failed"),
        (KeyboardInterrupt(), 130, "sim experiment paper: stopped; finished cells are kept"),
    ],
)
def test_how_a_verb_ends(capsys, raised, code, said):
    def run(arguments):
        if raised is not None:
            raise raised
        return 0

    assert cli.run(argparse.Namespace(run_experiment=run, experiment_verb="paper")) == code
    assert capsys.readouterr().err.strip() == said


def parsed(*words):
    parser = argparse.ArgumentParser()
    add_sweep_arguments(parser)
    return parser.parse_args(words)


def test_where_a_sweep_is_computed_can_be_said():
    assert (parsed().jobs, parsed().cluster) == (1, None)
    assert parsed("--jobs", "3").jobs == 3
    assert parsed("--cluster", "tcp://10.0.0.5:8786").cluster == "tcp://10.0.0.5:8786"


@pytest.mark.parametrize(
    "words", [["--jobs", "0"], ["--jobs", "many"], ["--jobs", "2", "--cluster", "tcp://a:1"]]
)
def test_where_it_can_not_be_computed_is_told(capsys, words):
    with pytest.raises(SystemExit):
        parsed(*words)
    assert "whole number" in capsys.readouterr().err or "--cluster" in words
