"""`sim dry-run`: a whole mission with the boat's own configuration, and what is said of it."""

import json
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.cli import main
from sim.currents import TidalCurrent

CONFIGURATION = """
mavlink: {endpoint: "serial:/dev/no-such-port:57600"}
survey:
  area: [[36.600, -122.000], [36.600, -121.985], [36.612, -121.985], [36.612, -122.000]]
  land: coast.geojson
  standoff_m: 30
  passage_cells: 40
sampling: {spacing_m: 60}
model: {capacity: 40, history_cells: 300, centring_samples: 8}
estimation: {maximum_points: 60, iterations: 20, candidates: [squared_exponential]}
planning: {planner: spots, lattice: [6, 6], spots: 6}
budget: {distance_m: 6000, energy_wh: 200, consumption_j_per_m: 80, speed_mps: 2.0, home: [36.601, -121.999]}
shore: {connect: [tcp/192.0.2.1:7447]}
"""
ISLAND = [[-121.995, 36.604], [-121.991, 36.604], [-121.991, 36.608], [-121.995, 36.608], [-121.995, 36.604]]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a boat's configuration, and a computer without any network."""
    (tmp_path / "coast.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ISLAND]}))
    (tmp_path / "boat.yaml").write_text(CONFIGURATION)

    def no_network(*_: Any, **__: Any) -> None:
        raise AssertionError("a dry run opens no socket")

    for method in ("connect", "connect_ex", "bind", "sendto"):
        monkeypatch.setattr(socket.socket, method, no_network)
    return tmp_path


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the picture, which takes as long as sailing does."""
    monkeypatch.setattr("sim.rehearsal.report.draw", lambda outcome, path: None)


def dry_run(desk: Path, *words: str) -> int:
    return main(["dry-run", str(desk / "boat.yaml"), "--out", str(desk / "out"), *words])


def told(desk: Path) -> Any:
    return json.loads((desk / "out" / "dry-run.json").read_text())


def kinds(desk: Path) -> set[str]:
    return {warning["kind"] for warning in told(desk)["warnings"]}


def test_a_mission_that_succeeds(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert dry_run(desk, "--battery-noise", "0", "--patch-km", "1.5") == 0
    found, said = told(desk), capsys.readouterr().out
    assert found["home"]
    assert found["legs_over_land"] == 0
    assert found["reestimates"] >= 1
    distance, energy = found["limits"]
    assert distance["usable"] == pytest.approx(5.4)
    assert distance["spent"] == pytest.approx(found["km"], abs=1e-3)
    assert distance["spent"] <= distance["usable"]
    assert distance["share"] > 0.85  # as docs/budget.md promises of the scarcest limit
    # 80 J/m are 160 W at 2 m/s; corners are sailed slowly, and cost the hotel load for longer.
    assert energy["spent"] == pytest.approx(80.0 * found["km"] / 3.6, rel=0.1)
    assert sum(found["phases_s"].values()) == pytest.approx(3600.0 * found["hours"], abs=90.0)
    assert found["hours"] * 7200.0 == pytest.approx(1e3 * found["km"], rel=0.15)
    assert list(found["phases_s"])[-1] in ("returning", "finished")
    course = found["course"]
    assert [moment["samples"] for moment in course] == sorted(moment["samples"] for moment in course)
    assert course[-1]["rmse"] == found["rmse"] < course[0]["rmse"]
    assert 0.1 < found["rmse"] / found["rmse_expected"] < 2.0  # cautious, and not too sure
    assert f"wrong by {found['rmse']:.3g}" in said
    assert "of 5.4 km" in said
    assert (desk / "out" / "dry-run.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("undrawn")
def test_the_same_question_has_the_same_answer(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--set", "budget.distance_m=1000", "--tide", "0.2,90", "--seed", "5")
    dry_run(desk, *words, "--json")
    first = capsys.readouterr().out
    dry_run(desk, *words, "--json")
    assert capsys.readouterr().out == first
    assert json.loads(first) == told(desk)


@pytest.mark.usefixtures("undrawn")
def test_what_is_seldom_meant_is_said(desk: Path) -> None:
    """A kilometre and a half for patches of 300 m, every 150 m, in a current of half the boat's speed."""
    words = ["--set", "budget.distance_m=1500", "--set", "sampling.spacing_m=150", "--patch-km", "0.3"]
    assert dry_run(desk, *words, "--current=1.0,0.2") == 0
    assert {"budget", "readings", "current", "map"} <= kinds(desk)
    assert any("are too few for" in warning["text"] for warning in told(desk)["warnings"])


@pytest.mark.usefixtures("undrawn")
def test_a_way_home_that_can_not_be_paid(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Home lies 1.7 km over water from where the boat is launched, and 1 km is all that may be sailed."""
    assert dry_run(desk, "--set", "budget.distance_m=1000", "--start=36.611,-121.986") == 1
    said = capsys.readouterr().err
    assert "no mission comes on board: no plan: the way home is 1707 m long" in said
    assert said.count("the way home") == 1


@pytest.mark.usefixtures("undrawn")
def test_a_boat_that_needs_more_than_was_guessed(desk: Path) -> None:
    """It notices under way, and is home with its reserve all the same."""
    words = ["--set", "budget.energy_wh=100", "--set", "budget.distance_m=null"]
    assert dry_run(desk, "--consumption", "160", "--battery-noise", "0", *words) == 0
    (energy,) = told(desk)["limits"]
    assert 0.8 < energy["share"] <= 1.0
    assert told(desk)["km"] < 0.6 * 90.0 * 3.6 / 80.0  # of what was guessed
    assert told(desk)["energy_wh"] == pytest.approx(160.0 * told(desk)["km"] / 3.6, rel=0.1)


def test_a_tide_turns() -> None:
    """After half its period of 12.42 h it runs the other way, as fast."""
    tide, half_s = TidalCurrent(0.4, 90.0), 0.5 * 12.4206 * 3600.0
    assert tide.current(36.6, -122.0, 0.0) == pytest.approx((0.4, 0.0), abs=1e-12)
    assert tide.current(36.6, -122.0, half_s) == pytest.approx((-0.4, 0.0), abs=1e-12)
    assert tide.current(36.6, -122.0, 0.5 * half_s) == pytest.approx((0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--start=36.606,-121.993"], "is on land"),
        (["--field", "synthetic-patch"], "nothing of it lies in the survey's water"),
        (["--field", "nowhere.nc"], "no such file"),
        (["--set", "survey.area=nowhere.kml"], "nowhere.kml"),
    ],
)
def test_mistakes_are_told(
    desk: Path, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert dry_run(desk, *words) in (1, 2, 78)
    assert said in capsys.readouterr().err
    assert not (desk / "out" / "dry-run.json").exists()


def test_usage(desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in (
        (["--tide", "1"], "MPS,DEG"),
        (["--seed", "-1"], "whole number"),
        (["--hours", "0"], "above 0"),
    ):
        with pytest.raises(SystemExit):
            dry_run(desk, *words)
        assert said in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
def test_the_field_of_a_file_is_sailed(desk: Path) -> None:
    """Linear to the north: its spread is that of a ramp over the survey, and the readings are the file's."""
    netCDF4 = pytest.importorskip("netCDF4")
    lat, lon = np.linspace(36.59, 36.62, 31), np.linspace(-122.01, -121.97, 41)
    with netCDF4.Dataset(desk / "sea.nc", "w") as file:
        for name, axis, units in (("lat", lat, "degrees_north"), ("lon", lon, "degrees_east")):
            file.createDimension(name, len(axis))
            file.createVariable(name, "f8", (name,))[:] = axis
            file[name].units = units
        salt = file.createVariable("salt", "f8", ("lat", "lon"))
        salt[:] = 30.0 + 100.0 * (lat - 36.6)[:, None] + 0.0 * lon
    assert dry_run(desk, "--field", str(desk / "sea.nc"), "--set", "budget.distance_m=1000") == 0
    found = told(desk)
    assert "sea.nc: salt" in found["field"]
    assert found["field_std"] == pytest.approx(100.0 * 0.012 / 12**0.5, rel=0.1)
    assert found["noise_std"] == pytest.approx(found["field_std"] / 20.0)
    assert found["samples"] > 10
