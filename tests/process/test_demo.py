"""The demo as people run it: what it achieves, on which fields, and how it ends."""

import argparse
import re
import signal
import sys
import time
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from sim import demo_cli

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes, Running

pytestmark = pytest.mark.process

SUMMARY = re.compile(
    r"(?P<km>[\d.]+) km, (?P<samples>\d+) samples, (?P<basis>\d+) basis vectors, (?P<plans>\d+) plans: "
    r"RMSE [\d.e-]+ = (?P<rmse>\d+)% of the field's standard deviation; "
    r"(?P<over_land>\d+) of (?P<legs>\d+) legs over land"
)


def demo(processes: Processes, folder: Path, *options: str) -> Running:
    return processes.start("-m", "sim", "demo", "--ground-station", "none", "--out", str(folder), *options)


def summary(running: Running) -> dict[str, float]:
    found = SUMMARY.search(running.said)
    assert found is not None, running.said
    print(found[0])
    return {name: float(value) for name, value in found.groupdict().items()}


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


def sailed(
    folder: Path, seconds: tuple[int, int], plans: int, rmse: float, *options: str
) -> tuple[Running, dict[str, float]]:
    """A demo that reaches so many plans and that error, in per cent.

    Re-estimates take a second or two of CPU, and the vessel sails on meanwhile, 500 times as fast as life: the voyage
    has room for several, on a busy machine a longer one.
    """
    for length in seconds:
        with Processes() as processes:
            running = demo(processes, folder, "--seconds", str(length), *options)
            status = running.wait(110.0 + 2.0 * length)
            assert status == 0 or "nothing was learned" in running.said, running.said
            assert running.family() == []
        if status == 0:
            outcome = summary(running)
            if outcome["plans"] >= plans and outcome["rmse"] < rmse:
                return running, outcome
    raise AssertionError(f"not {plans} plans and {rmse} %: {running.said}")


def test_a_short_one_teaches_the_field(tmp_path: Path) -> None:
    _, outcome = sailed(tmp_path, (24, 96), 4, 35)
    assert outcome["over_land"] == 0
    assert outcome["legs"] > 100
    assert is_picture(tmp_path / "demo.png")
    assert is_picture(tmp_path / "live.png")


def write_roms(path: Path) -> Path:
    """A file as ROMS writes it: 240 km of turned, curvilinear grid, two depths, two dates, an island, 1e37 on land."""
    eta, xi = np.meshgrid(np.linspace(-1.0, 1.0, 49), np.linspace(-1.0, 1.0, 61), indexing="ij")
    lat = 28.0 + 1.08 * eta + 0.15 * xi
    lon = -94.0 + 1.22 * xi - 0.17 * eta
    water = (eta < 0.75 + 0.1 * np.sin(4.0 * xi)) & (np.hypot(eta - 0.1, xi - 0.2) > 0.15)
    salt = 33.0 - 2.0 / (1.0 + np.exp(-6.0 * (eta - 0.2 * xi))) + 0.5 * np.sin(3.0 * xi) * np.cos(2.0 * eta)
    with netCDF4.Dataset(path, "w") as dataset:
        for name, size in (("ocean_time", 2), ("s_rho", 2), ("eta_rho", 49), ("xi_rho", 61)):
            dataset.createDimension(name, size)
        for name, values in (("lat_rho", lat), ("lon_rho", lon), ("mask_rho", water.astype(float))):
            dataset.createVariable(name, "f8", ("eta_rho", "xi_rho"))[:] = values
        dataset.createVariable("s_rho", "f8", ("s_rho",))[:] = [-0.75, -0.25]
        time = dataset.createVariable("ocean_time", "f8", ("ocean_time",))
        time.units = "seconds since 2020-01-01 00:00:00"
        time[:] = [0.0, 86400.0]
        variable = dataset.createVariable("salt", "f4", ("ocean_time", "s_rho", "eta_rho", "xi_rho"))
        variable.long_name = "salinity"
        variable.coordinates = "lon_rho lat_rho s_rho ocean_time"
        variable[:] = np.where(water, np.stack([[salt + 1.0, salt], [salt + 1.1, salt + 0.1]]), 1e37)
    return path


def test_a_large_roms_file_is_shrunk_and_learnt(tmp_path: Path) -> None:
    field = write_roms(tmp_path / "ocean_his.nc")
    running, outcome = sailed(tmp_path, (10, 40), 1, 60, "--field", str(field), "--variable", "salt")
    assert "shrunk" in running.said
    assert "to 15 km" in running.said
    assert outcome["over_land"] == 0
    assert is_picture(tmp_path / "demo.png")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--seconds", "0"], "--seconds: must be seconds above 0 (got '0')"),
        (["--seconds", "long"], "--seconds: must be seconds above 0 (got 'long')"),
        (["--speedup", "501"], "--speedup: at most 500"),
        (["--seed", "-1"], "--seed: must be a whole number from 0 (got '-1')"),
        (["--ground-station", "here"], "--ground-station: must be HOST:PORT or none, got here"),
        (["--field", "NOWHERE"], "salt.nc"),
        (["--field", "TEXT"], "notes.nc"),
        (["--field", "ROMS", "--variable", "oxygen"], "oxygen"),
        (["--out", "TEXT"], "--out"),
    ],
)
def test_what_cannot_be_used_is_told_and_exits_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], words: str
) -> None:
    text = tmp_path / "notes.nc"
    text.write_text("not a field\n")
    places = {"TEXT": str(text), "NOWHERE": str(tmp_path / "salt.nc")}
    if "ROMS" in options:
        places["ROMS"] = str(write_roms(tmp_path / "roms.nc"))
    parser = argparse.ArgumentParser(prog="sim demo")
    demo_cli.add_arguments(parser)
    try:
        out = ["--out", str(tmp_path / "out")]
        code = demo_cli.run(parser.parse_args(out + [places.get(word, word) for word in options]))
    except SystemExit as stop:
        code = stop.code
    assert code == 2
    assert words in capsys.readouterr().err


def test_a_signal_leaves_nothing_behind(tmp_path: Path) -> None:
    with Processes() as processes:
        running = demo(processes, tmp_path, "--seconds", "60")
        # The demo, shore, vessel, service and its worker.
        running.wait_until(lambda: len(running.family()) == 5, what="the start of five processes")
        running.wait_until(lambda: "plan 1" in (tmp_path / "service.log").read_text(), what="a plan")
        assert running.stop(signal.SIGTERM) == 143
        assert running.family() == []
    assert "sim demo: stopped by SIGTERM" in running.said
    assert "Traceback" not in running.said
    assert "stopped" in (tmp_path / "service.log").read_text().splitlines()[-1]


def test_two_signals_in_the_middle_of_the_start_leave_nothing_behind(tmp_path: Path) -> None:
    with Processes() as processes:
        running = demo(processes, tmp_path, "--seconds", "60")
        running.wait_for("files in")
        running.send(signal.SIGINT)
        time.sleep(0.1)
        running.send(signal.SIGTERM)
        assert running.wait() == 130
        assert running.family() == []
    assert "Traceback" not in running.said
