"""Sweeps: the same values wherever they are computed, and nothing computed twice."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import sweep_cells
from distributed import LocalCluster

from sim.experiment import sweep, sweep_places
from sim.experiment.cells import Cell, SweepError
from sim.experiment.sweep import run
from sim.experiment.sweep_places import Place
from sim.experiment.sweep_provenance import Version
from sim.experiment.sweep_worker import Failure, Task, compute


@pytest.fixture
def here(monkeypatch):
    """Cells are computed in this very process: for what does not depend on where they are."""
    monkeypatch.setattr(sweep, "this_machine", lambda jobs: Place(lambda _: ThreadPoolExecutor(jobs), jobs))


def cells_of(function, seeds, calls, **arguments):
    return [
        Cell(f"seed {seed}", f"sweep_cells:{function}", {"seed": seed, "calls": calls.path, **arguments})
        for seed in seeds
    ]


def bits(results):
    return [{name: np.asarray(value).tobytes() for name, value in one.values.items()} for one in results]


def test_values_are_the_same_on_one_worker_on_two_and_on_a_cluster(tmp_path, calls, monkeypatch):
    """And the same as those of plain calls, here and now, though the workers were told to use two threads."""
    cells = cells_of("linear_algebra", range(6), calls)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    one = run(cells, tmp_path / "one", 1, progress=False)
    two = run(cells[::-1], tmp_path / "two", 2, progress=False)[::-1]
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1") as cluster:
        dask = run(cells, tmp_path / "dask", cluster=cluster.scheduler_address, progress=False)
    assert calls() == dict.fromkeys(range(6), 3)
    assert len(calls.processes()) >= 3
    assert [result.cell for result in two] == cells
    assert bits(one) == bits(two) == bits(dask)
    plainly = [sweep_cells.linear_algebra(cell.arguments) for cell in cells]
    assert [result.values["root"].tolist() for result in one] == [
        values["root"].tolist() for values in plainly
    ]
    assert {result.values["blas_threads"] for result in (*one, *two, *dask)} == {1}


def test_a_cell_that_fails_is_named_and_the_others_are_kept(tmp_path, calls, capsys):
    """One raises, one takes its process down, one returns what can't be kept."""
    does = ["nothing", "raise", "die", "return a dictionary", "nothing", "nothing"]
    cells = [
        Cell(f"cell {i}", "sweep_cells:misbehaving", {"seed": i, "calls": calls.path, "does": what})
        for i, what in enumerate(does)
    ]
    with pytest.raises(SweepError) as told:
        run(cells, tmp_path / "kept", 2, progress=False)
    summary, *lines = str(told.value).splitlines()
    assert summary.startswith("3 of 6 cells failed")
    for line, i, why in zip(
        lines,
        (1, 2, 3),
        ("ValueError: the sea is too calm", "its process died", "TypeError: 'value'"),
        strict=True,
    ):
        assert f"'cell {i}'" in line
        assert f'"does": "{does[i]}"' in line
        assert why in line
    assert 'raise ValueError("the sea is too calm")' in capsys.readouterr().err
    before = calls()
    good = [cells[i] for i in (0, 4, 5)]
    assert [result.values["value"] for result in run(good, tmp_path / "kept", progress=False)] == [0, 4, 5]
    assert calls() == before


def test_what_is_kept_is_computed_again_only_if_it_must_be(tmp_path, calls, here):
    """A name does not matter; arguments, the content of input files, and a whole file do."""
    (tmp_path / "sea.txt").write_text("calm")
    arguments = {"seed": 0, "calls": calls.path, "file": str(tmp_path / "sea.txt")}
    cell = Cell("a", "sweep_cells:reading", arguments, (tmp_path / "sea.txt",))

    def text_and_calls(cell):
        (result,) = run([cell], tmp_path / "kept", progress=False)
        return result.values["text"], sum(calls().values())

    assert text_and_calls(cell) == ("calm", 1)
    assert text_and_calls(replace(cell, name="b")) == ("calm", 1)
    assert text_and_calls(replace(cell, arguments={**arguments, "seed": 1})) == ("calm", 2)
    (tmp_path / "sea.txt").write_text("rough")
    assert text_and_calls(cell) == ("rough", 3)
    (tmp_path / "sea.txt").write_text("calm")
    assert text_and_calls(cell) == ("calm", 3)


def test_a_damaged_file_is_told_and_computed_again(tmp_path, calls, here, capsys):
    cells = cells_of("misbehaving", range(3), calls, does="nothing")
    run(cells, tmp_path / "kept", progress=False)
    damaged = min((tmp_path / "kept").glob("*.nc"))
    damaged.write_bytes(damaged.read_bytes()[:-1000])
    results = run(cells, tmp_path / "kept", progress=False)
    assert [result.values["value"] for result in results] == [0, 1, 2]
    assert sorted(calls().values()) == [1, 1, 2]
    assert f"{damaged}: damaged" in capsys.readouterr().err
    assert not damaged.exists()


def test_cells_that_ask_the_same_are_computed_once(tmp_path, calls, here):
    cells = [
        replace(cell, name=name) for name in "ab" for cell in cells_of("misbehaving", [7], calls, does="")
    ]
    results = run(cells, tmp_path / "kept", 2, progress=False)
    assert [result.cell.name for result in results] == ["a", "b"]
    assert calls() == {7: 1}


def test_a_result_says_where_it_comes_from(tmp_path, calls, here):
    (cell,) = cells_of("misbehaving", [3], calls, does="nothing")
    (result,) = run([cell], tmp_path / "kept", progress=False)
    told = result.provenance
    assert (told["cell"], told["function"], told["seed"]) == ("seed 3", "sweep_cells:misbehaving", 3)
    assert told["arguments"] == cell.arguments
    assert f"numpy {np.__version__}" in told["packages"]
    assert {"halocline", "sources", "python", "cpu", "system", "finished", "wall_s", "cpu_s"} <= set(told)


def test_a_worker_with_other_software_is_told():
    other = Version("0.0.9", "other sources", "1.0", "1.0")
    outcome = compute(Task("f", "sim.experiment.cells:Cell", "{}", other, {}))
    assert isinstance(outcome, Failure)
    assert "the worker's software is not the one that asks" in outcome.reason


@pytest.mark.parametrize(
    ("cell", "why"),
    [
        (Cell("a", "no function", {}), "must be module:function"),
        (Cell("a", "no_such_module:f", {}), "no_such_module"),
        (Cell("a", "sim.discrete:f", {"x": object()}), "what JSON knows"),
        (Cell("a", "sim.discrete:f", {"x": float("nan")}), "what JSON knows"),
    ],
)
def test_a_cell_that_can_not_be_called_ends_a_sweep_before_it_begins(tmp_path, cell, why):
    with pytest.raises(SweepError, match=why):
        run([cell], tmp_path / "kept")


def test_an_input_that_is_missing_ends_a_sweep_before_it_begins(tmp_path):
    cell = Cell("a", "sim.discrete:f", {}, (tmp_path / "sea.nc",))
    with pytest.raises(SweepError, match=r"sea\.nc"):
        run([cell], tmp_path / "kept")


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense://x"])
def test_a_cluster_that_does_not_answer_is_told(tmp_path, calls, monkeypatch, address):
    monkeypatch.setattr(sweep_places, "_CONNECTING_S", 0.2)
    with pytest.raises(SweepError, match=f"no Dask scheduler answers at {address}"):
        run(cells_of("misbehaving", [1], calls, does=""), tmp_path / "kept", cluster=address, progress=False)


def test_arguments_reach_a_function_as_json_has_them(tmp_path, calls, here):
    (cell,) = cells_of("misbehaving", [1], calls, does="nothing", pair=(1, 2.5))
    (result,) = run([cell], tmp_path / "kept", progress=False)
    assert result.provenance["arguments"] == json.loads(json.dumps(cell.arguments))
