"""A comparison as a whole: its cells, what one of them sails, its tables and its report."""

import itertools
import os
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.cli import main
from sim.experiment import compare_report
from sim.experiment.cells import Result
from sim.experiment.compare import Plan
from sim.experiment.compare_cells import sail
from sim.experiment.compare_pictures import pictures
from sim.experiment.compare_seas import SYNTHETIC, SeaChoice, open_sea, real_seas
from sim.experiment.compare_table import comparisons, cost_table, table, table_by_sea
from sim.experiment.compare_ways import LANES, SAILED
from sim.field import FieldError

PLAN = Plan(
    (SeaChoice("a", "synthetic-patch:0"), SeaChoice("b", "synthetic:1"), SeaChoice("c", "x", None, True)),
    launches=2,
    seeds=(7,),
    sides=10.0,
    moving_sides=16.0,
)
CLOCK = itertools.count(1.0)
ERRORS = dict(zip(SAILED, (0.4, 0.9, 0.6, 0.3, 0.7, 0.5, 0.5), strict=True))


def made_up(plan: Plan) -> list[Result]:
    """Results as `sail` gives them; the errors are those of `ERRORS`, twice as large from the second launch."""
    return [Result(cell, _values(cell.arguments), {"git_commit": "abc"}) for cell in plan.cells()]


def _values(told: Any) -> dict[str, Any]:
    error = ERRORS[told["strategy"]] * (1.0 + told["launch"])
    course = np.linspace(1.0, error, 5)
    summary = {"final_rmse": error, "final_nlpd": 0.5, "final_coverage": 0.9, "batch_final_rmse": 1.1 * error}
    grid = np.array([[0.0, 1.0], [2.0, np.nan]])
    sea = {"side_m": 1e3, "budget_m": 1e4, "unit": 0.2, "hastened": 1.0, "shrunk": 2.0, "cpu_s": next(CLOCK)}
    maps = {"truth": grid, "mean": grid, "x_axis_m": np.arange(2.0), "y_axis_m": np.arange(2.0)}
    track = {"track_m": np.array([[0.0, 0.0], [1.0, 1.0]]), "launch_m": np.zeros(2)}
    return {
        "distance_m": np.linspace(0.0, 1e4, 5), "rmse": course, "nlpd": course, "coverage": course,
        **summary, **sea, **maps, **track,
    }  # fmt: skip


def rows_of(markdown: str) -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in markdown.splitlines()[2:]]


def test_every_strategy_sails_every_sea_launch_and_seed_once() -> None:
    cells = PLAN.cells()
    names = {(c.arguments["sea"]["name"], c.arguments["launch"], c.arguments["strategy"]) for c in cells}
    assert len(cells) == len(names) == 3 * 2 * len(SAILED)
    assert {c.arguments["sides"] for c in cells if c.arguments["sea"]["moves"]} == {16.0}


def test_ours_is_paired_with_each_other() -> None:
    still, moving = comparisons(made_up(PLAN))
    assert (still.moves, still.seas, moving.seas) == (False, ("a", "b"), ("c",))
    against = still.against("random", lambda f: f.rmse)
    assert against.mean == pytest.approx(0.4 / 0.7)
    assert (against.better, against.voyages, against.fields) == (4, 4, 2)
    # Who sails a lawnmower has to choose a direction beforehand; in hindsight it is the better one.
    assert still.against("lawnmower", lambda f: f.rmse).mean == pytest.approx(0.4 / 0.45)
    assert still.against("lawnmower-better", lambda f: f.rmse).mean == pytest.approx(0.4 / 0.3)
    with pytest.raises(KeyError):
        still.against(LANES[0], lambda f: f.rmse)


def test_the_tables_are_complete_and_know_no_clock() -> None:
    first, again = comparisons(made_up(PLAN)), comparisons(made_up(PLAN))
    for make in (table, table_by_sea):
        told = make(first)
        assert told == make(again)
        for row in rows_of(told):
            assert all(row) or not any(row[1:]), row
            assert "nan" not in " ".join(row)
    assert cost_table(first) != cost_table(again)
    assert [row[0] for row in rows_of(table_by_sea(first))] == ["a", "b", "c"]


def test_the_report_is_one_file_that_asks_for_nothing(tmp_path: Path) -> None:
    results = made_up(PLAN)
    found = comparisons(results)
    drawn = pictures(results, found)
    compare_report.write(tmp_path / "report.html", results, found, drawn, ("A <note>.",))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'(?:src|href)="(?!data:)', page) == []
    assert not re.findall(r"https?://|@import|url\(", page)
    assert page.count("<img ") == len(drawn) == 2 + 3
    assert page.count("alt=") == page.count("<img ")
    assert "A &lt;note&gt;." in page
    assert page.count("<table>") == 3


def test_a_voyage_is_the_same_again_to_the_last_digit() -> None:
    # Waypoints and a batch process, 1 x the square root of the area; only CPU seconds differ.
    told = {
        "sea": asdict(SYNTHETIC[0]), "strategy": "random", "launch": 1, "seed": 2, "sides": 1.0, "budget_m": None
    }  # fmt: skip
    first, again = sail(told), sail(told)
    assert first.keys() == again.keys()
    for name in first.keys() - {"cpu_s"}:
        np.testing.assert_array_equal(first[name], again[name], err_msg=name)
    distance_m, side_m = np.asarray(first["distance_m"]), float(np.asarray(first["side_m"]))
    assert 0.85 * side_m <= distance_m[-1] <= 1.01 * side_m
    # A sample every fiftieth; one may be late after a turn.
    assert 0.9 * 50 * distance_m[-1] / side_m <= first["samples"] <= 51


def test_seas_are_what_they_are_called() -> None:
    still, moving = (open_sea(SYNTHETIC[k], 2.0, None) for k in (0, 2))
    assert np.array_equal(still.truth(0.0), still.truth(1e6))
    assert not np.array_equal(moving.truth(0.0), moving.truth(1e5))
    assert still.budget_m == pytest.approx(2.0 * still.side_m)
    assert still.waters.survey.is_navigable(still.launch(5))[0]
    np.testing.assert_array_equal(still.launch(5), still.launch(5))
    assert np.hypot(*(still.launch(5) - still.launch(6))) > 10.0


def test_a_folder_without_the_fields_is_told(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match=r"lacks Nordic_subset\.nc"):
        real_seas(tmp_path)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--variable", "salt"], "belong to --field"),
        (["-L", "3", "--budget-km", "5"], "give one or the other"),
        (["--field", "nothing.nc"], "no such file"),
    ],
)
def test_usage_mistakes_are_told(words: list[str], told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["experiment", "compare", *words]) in (1, 2)
    assert told in capsys.readouterr().err


@pytest.mark.skipif(
    "HALOCLINE_COMPARE" not in os.environ, reason="all strategies, twice: HALOCLINE_COMPARE=1"
)
@pytest.mark.timeout(3600)
def test_the_table_is_the_same_for_any_number_of_workers(tmp_path: Path) -> None:
    for jobs in (1, 2):
        words = [
            "--quick",
            "-L",
            "2",
            "--moving-sides",
            "3",
            "--jobs",
            str(jobs),
            "--out",
            str(tmp_path / str(jobs)),
        ]
        assert main(["experiment", "compare", *words]) == 0
    for name in ("table.md", "seas.md", "ratios.png", "courses.png"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()
