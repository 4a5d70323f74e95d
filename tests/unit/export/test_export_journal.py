"""A boat's journal is exported by replaying it: what comes out is what the core believed and told at sea."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import shapely
import xarray as xr

sys.path.insert(0, str(Path(__file__).parents[2] / "replays"))
import golden

from autonomy import cli
from autonomy.effects import Topic
from autonomy.events import StopRequested
from autonomy.geometry import LocalFrame
from autonomy.shell.journal_files import journal_files
from autonomy.wire import ModelSnapshot

NAME = "sea_water_practical_salinity"


@pytest.fixture(scope="module")
def sailed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """A short survey: its journal, and the run, which remembers what it published."""
    folder = tmp_path_factory.mktemp("journal")

    def course(run: Any) -> None:
        run.advance(240.0)
        run.happened(StopRequested())

    return folder, golden.sail(folder, course)


def test_maps_and_readings_are_what_was_told_at_sea(sailed: tuple[Path, Any], tmp_path: Path) -> None:
    folder, run = sailed
    (file,) = journal_files(folder)
    words = ("--netcdf", tmp_path / "a.nc", "--csv", tmp_path / "a.csv", "--every", "1s")
    assert cli.main(["export", str(file.path), *map(str, words)]) == 0
    told: list[ModelSnapshot] = run.published[Topic.MODEL]
    assert len(told) >= 3
    with xr.open_dataset(tmp_path / "a.nc") as maps:
        # The last words may be of the same moment as the model before them.
        by_time = {one.utc_s: one for one in told}
        assert len(maps.time) == len(by_time)
        lon, lat = np.meshgrid(maps.lon, maps.lat)
        points = LocalFrame(told[0].origin_lat_deg, told[0].origin_lon_deg).to_local(lat, lon)
        for row, (utc_s, one) in enumerate(sorted(by_time.items())):
            assert maps.time.values[row] == np.datetime64(round(utc_s * 1e3), "ms")
            mean = maps[NAME][row].values
            inside = np.isfinite(mean)
            predicted = one.model.predict(points[inside])
            assert np.abs(mean[inside] - predicted.mean).max() < 5e-6
            error = maps[f"{NAME}_standard_error"][row].values[inside]
            assert np.abs(error - np.sqrt(predicted.variance)).max() < 5e-6
        water = shapely.intersects_xy(golden.survey().water, points[..., 0], points[..., 1])
        assert (inside == water).all()
        assert maps.attrs["configuration_hash"] == told[0].configuration_hash
    readings = [one for batch in run.published[Topic.OBSERVATIONS] for one in batch]
    table = pd.read_csv(tmp_path / "a.csv")
    assert table[f"{NAME} [1]"].tolist() == [one.value for one in readings]
    assert table["latitude_deg"].tolist() == [one.lat_deg for one in readings]


def test_the_journal_of_another_vehicle_is_told(
    sailed: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["export", str(sailed[0]), "--vehicle", "x", "--csv", str(tmp_path / "a")]) == 65
    assert "is the journal of boat1, not of x" in capsys.readouterr().err


def damaged(journal: Path, tmp_path: Path, place: Callable[[bytes], int], size: int) -> Path:
    """A copy of a journal of one file, with zeros at a place."""
    folder = tmp_path / "copy"
    shutil.copytree(journal, folder)
    (file,) = journal_files(folder)
    data = bytearray(file.path.read_bytes())
    at = place(data)
    data[at : at + size] = bytes(size)
    file.path.write_bytes(data)
    return folder


def test_damage_in_the_middle_is_told(
    sailed: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = damaged(sailed[0], tmp_path, lambda data: len(data) * 3 // 4, 50)
    code = cli.main(["export", str(folder), "--csv", str(tmp_path / "a")])
    assert "damaged, left out" in capsys.readouterr().err
    assert code in (0, 70)


def test_a_journal_whose_beginning_is_gone_is_refused(
    sailed: tuple[Path, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = damaged(sailed[0], tmp_path, lambda data: data.index(b"\xf5HJ\x1e", 4), 20)
    assert cli.main(["export", str(folder), "--csv", str(tmp_path / "a")]) == 65
    assert "its beginning is gone" in capsys.readouterr().err
    assert not (tmp_path / "a").exists()
