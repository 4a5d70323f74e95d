"""What can't be exported is refused with a reason and an exit code, and leaves no file behind."""

import importlib.util
import json
import random
import resource
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cbor2
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from mcap.reader import make_reader
from told import LATE_S, RUN, UTC_S, Told, health, plan, record

from autonomy import cli
from autonomy.shore.recording import Recorder
from autonomy.wire import (
    HealthNotice,
    LogBatch,
    LogNotice,
    ModelSnapshot,
    ObservationBatch,
    PlanNotice,
    SurveyNotice,
    encode,
)

Export = Callable[..., tuple[int, str]]


@pytest.fixture
def export(capsys: pytest.CaptureFixture[str]) -> Export:
    """Exit code and standard error of `autonomy export`."""

    def run(*words: str | Path) -> tuple[int, str]:
        code = cli.main(["export", *map(str, words)])
        return code, capsys.readouterr().err

    return run


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_nothing_asked_for_is_a_mistake(recording: Path, export: Export) -> None:
    code, said = export(recording)
    assert code == 2
    assert "give some of --netcdf, --trajectory" in said


def test_a_source_that_is_none_is_told(tmp_path: Path, export: Export) -> None:
    for source, why in (
        (tmp_path / "nowhere", "No such file"),
        (tmp_path, "neither a shore recording nor a journal"),
    ):
        code, said = export(source, "--csv", tmp_path / "a.csv")
        assert code == 66
        assert why in said
    assert left(tmp_path) == []


def test_files_are_only_overwritten_when_told_to(recording: Path, tmp_path: Path, export: Export) -> None:
    path = tmp_path / "a.csv"
    path.write_text("precious")
    code, said = export(recording, "--csv", path)
    assert code == 73
    assert "--force" in said
    assert path.read_text() == "precious"
    assert export(recording, "--csv", path, "--force")[0] == 0
    assert path.read_text().startswith("time_utc")
    assert left(tmp_path) == ["a.csv"]


def test_a_folder_that_is_not_there_is_told_before_anything_is_read(
    recording: Path, tmp_path: Path, export: Export
) -> None:
    code, said = export(recording, "--csv", tmp_path / "no" / "a.csv")
    assert code == 73
    assert "there is no folder" in said


def test_one_file_for_two_formats_is_a_mistake(recording: Path, tmp_path: Path, export: Export) -> None:
    code, said = export(recording, "--csv", tmp_path / "a", "--geojson", tmp_path / "a")
    assert (code, "name the same file" in said) == (2, True)


def test_an_export_that_fails_leaves_no_file_of_any_format(
    recording: Path, tmp_path: Path, export: Export
) -> None:
    old = tmp_path / "a.csv"
    old.write_text("old")
    words = ("--csv", old, "--netcdf", tmp_path / "a.nc", "--force", "--resolution", "0.5")
    code, said = export(recording, *words)
    assert code == 65
    assert "--resolution wants more metres" in said
    assert left(tmp_path) == ["a.csv"]
    assert old.read_text() == "old"


@pytest.mark.parametrize(
    ("option", "library", "package"),
    [("--netcdf", "netCDF4", "netCDF4"), ("--mcap", "foxglove", "foxglove-sdk")],
)
def test_a_missing_library_is_named(
    option: str,
    library: str,
    package: str,
    recording: Path,
    tmp_path: Path,
    export: Export,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    missing = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == library else missing(name))
    code, said = export(recording, option, tmp_path / "a")
    assert code == 2
    assert f"{option} needs {package}: pip install 'halocline[shore]'" in said


def test_of_several_vehicles_one_is_chosen(told: Told, tmp_path: Path, export: Export) -> None:
    source = record(tmp_path / "recording", told.messages)
    few = Told(3)
    record(source, few.messages, "boat2")
    code, said = export(source, "--csv", tmp_path / "a.csv")
    assert code == 65
    assert "holds 2 vehicles, boat1, boat2: --vehicle says which" in said
    code, said = export(source, "--csv", tmp_path / "a.csv", "--vehicle", "boat3")
    assert code == 65
    assert "holds nothing of boat3" in said
    assert export(source, "--csv", tmp_path / "a.csv", "--vehicle", "boat2")[0] == 0
    assert len(pd.read_csv(tmp_path / "a.csv")) == len(few.readings)


def test_an_empty_recording_is_told(tmp_path: Path, export: Export) -> None:
    record(tmp_path / "empty", [])
    code, said = export(tmp_path / "empty", "--csv", tmp_path / "a.csv")
    assert code in (65, 66)
    assert "empty" in said or "neither" in said


def test_doubles_and_disorder_leave_no_trace(told: Told, tmp_path: Path, export: Export) -> None:
    """Gaps are filled late, and a recorder that starts again hears all once more."""
    draw = random.Random(3)
    batches = [one for one in told.messages if isinstance(one[1], ObservationBatch | LogBatch)]
    late = draw.sample(batches, len(batches))
    source = record(tmp_path / "recording", [*told.messages[::2], *late, *told.messages[1::2], *late])
    code, said = export(source, "--csv", tmp_path / "a.csv", "--mcap", tmp_path / "a.mcap")
    assert (code, said) == (0, "")
    table = pd.read_csv(tmp_path / "a.csv")
    np.testing.assert_array_equal(table.iloc[:, 3], [one.value for one in told.readings])
    assert table["time_utc"].is_monotonic_increasing


def test_what_is_missing_is_told(told: Told, tmp_path: Path, export: Export) -> None:
    kept = [one for one in told.messages if not (isinstance(one[1], ObservationBatch) and one[1].first == 80)]
    code, said = export(record(tmp_path / "recording", kept), "--csv", tmp_path / "a.csv")
    assert code == 0
    assert "40 of 480 observations of a run of boat1 are missing" in said
    assert len(pd.read_csv(tmp_path / "a.csv")) == 440


def test_a_damaged_recording_gives_what_it_has(told: Told, tmp_path: Path, export: Export) -> None:
    source = record(tmp_path / "recording", told.messages)
    (path,) = source.glob("*.recording")
    data = bytearray(path.read_bytes())
    draw = random.Random(4)
    for _ in range(10):
        data[draw.randrange(len(data) // 2, len(data))] ^= 0xFF
    path.write_bytes(data)
    code, said = export(source, "--csv", tmp_path / "a.csv", "--netcdf", tmp_path / "a.nc")
    assert code == 0
    assert "damaged, left out" in said
    assert 100 < len(pd.read_csv(tmp_path / "a.csv")) <= 480


def test_rubbish_under_every_key_is_left_out(told: Told, tmp_path: Path, export: Export) -> None:
    source, draw = tmp_path / "recording", random.Random(5)
    record(source, told.messages)
    with Recorder(source) as recorder:
        for topic in ("model", "plan", "observations", "health", "log", "survey", "status", "other"):
            for payload in (b"", b"\xff", draw.randbytes(300), cbor2.dumps({"v": 3}), cbor2.dumps([1] * 50)):
                recorder.write(UTC_S, f"usv/boat1/{topic}", "", payload)
        recorder.write(UTC_S, "usv/a/b/c", "", b"")
        recorder.write(UTC_S, "", "", b"")
    code, said = export(
        source, "--csv", tmp_path / "a.csv", "--netcdf", tmp_path / "a.nc", "--mcap", tmp_path / "a.mcap"
    )
    assert code == 0
    assert "left out" in said
    assert len(said.splitlines()) <= 12
    assert len(pd.read_csv(tmp_path / "a.csv")) == 480


def test_what_another_version_told_is_refused_with_advice(told: Told, tmp_path: Path, export: Export) -> None:
    source = tmp_path / "recording"
    with Recorder(source) as recorder:
        for topic in ("model", "health", "observations"):
            recorder.write(UTC_S, f"usv/boat1/{topic}", "", cbor2.dumps({"v": 1}))
    code, said = export(source, "--csv", tmp_path / "a.csv")
    assert code == 65
    assert "3 records of boat1 are of another version" in said
    assert "update the older" in said
    # Beside what can be read, they are told and left out.
    record(source, told.messages)
    code, said = export(source, "--csv", tmp_path / "a.csv")
    assert code == 0
    assert "left out: 3 records of boat1 are of another version" in said


def test_nothing_is_dated_that_the_vehicle_did_not_date(tmp_path: Path, export: Export) -> None:
    undated = Told(3, knows_utc=False)
    source = record(tmp_path / "recording", undated.messages)
    code, said = export(source, "--csv", tmp_path / "a.csv")
    assert code == 65
    assert "boat1 did not tell UTC in 1 of its runs" in said
    words = ("--csv", tmp_path / "a.csv", "--netcdf", tmp_path / "a.nc", "--date-by-arrival")
    assert export(source, *words)[0] == 0
    first = pd.read_csv(tmp_path / "a.csv", parse_dates=["time_utc"])["time_utc"][0].timestamp()
    assert first == pytest.approx(UTC_S + LATE_S + undated.readings[0].model_time_s, abs=0.01)
    with xr.open_dataset(tmp_path / "a.nc") as maps:
        assert "times are those of the arrival" in maps.attrs["comment"]


def test_a_start_at_the_quay_does_not_keep_the_survey_back(tmp_path: Path, export: Export) -> None:
    """A run that ends before there is a model, with which UTC comes, or anything else of worth."""
    told = Told(3)
    quay = [
        (UTC_S - 100.0, health(5.0, (0.0, 0.0), run=RUN + 1)),
        (UTC_S - 99.0, plan(7, run=RUN + 1)),
        (
            UTC_S - 98.0,
            LogBatch(RUN + 1, 0, 0, 2, (LogNotice("info", "dated", UTC_S), LogNotice("info", "not"))),
        ),
    ]
    source = record(tmp_path / "recording", [*quay, *told.messages])
    words = ("--csv", tmp_path / "a.csv", "--geojson", tmp_path / "a.geojson", "--mcap", tmp_path / "a.mcap")
    code, said = export(source, *words)
    assert (code, said) == (0, "left out: 1 runs of boat1 without a reading, a model or UTC\n")
    assert len(pd.read_csv(tmp_path / "a.csv")) == len(told.readings)
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert 7 not in {each["properties"].get("plan") for each in features}
    # With a reading it is worth asking when that was.
    lost = ObservationBatch(RUN + 1, 0, 0, 1, tuple(told.readings[:1]))
    source = record(tmp_path / "other", [*quay, (UTC_S - 97.0, lost), *told.messages])
    code, said = export(source, *words, "--force")
    assert code == 65
    assert "--date-by-arrival" in said
    assert export(source, *words, "--force", "--date-by-arrival") == (0, "")


def test_readings_are_exported_without_a_model(tmp_path: Path, export: Export) -> None:
    """The boat was called back before it had learnt anything, or the models did not get through."""
    told = Told(3)
    readings = [
        (
            at,
            replace(value, utc_s=UTC_S + value.model_time_s)
            if getattr(value, "model_time_s", None)
            else value,
        )
        for at, value in told.messages
        if not isinstance(value, ModelSnapshot)
    ]
    source = record(tmp_path / "recording", readings)
    assert export(source, "--csv", tmp_path / "a.csv", "--trajectory", tmp_path / "a.nc") == (0, "")
    table = pd.read_csv(tmp_path / "a.csv", parse_dates=["time_utc"])
    assert len(table) == len(told.readings)
    assert "sea_water_practical_salinity [1]" in table.columns
    assert table["time_utc"][0].timestamp() == pytest.approx(UTC_S + told.readings[0].model_time_s, abs=0.01)
    with xr.open_dataset(tmp_path / "a.nc") as track:
        assert track.sea_water_practical_salinity.attrs["standard_name"] == "sea_water_practical_salinity"
        assert "off Point Conception" in track.attrs["title"]
        assert track.sizes["obs"] == len(told.readings)
    for kind in ("netcdf", "mcap"):
        code, said = export(source, f"--{kind}", tmp_path / "b")
        assert code == 65
        assert "there is no model of boat1" in said
    # A run without a model does not keep another back that has some.
    before = [(at - 9000.0, _of_run(value, RUN + 1, -9000.0)) for at, value in readings]
    source = record(tmp_path / "both", [*before, *told.messages])
    assert export(source, "--csv", tmp_path / "c.csv", "--netcdf", tmp_path / "c.nc") == (0, "")
    assert len(pd.read_csv(tmp_path / "c.csv")) == 2 * len(told.readings)


def _of_run(value: Any, run: int, later_s: float) -> Any:
    """The same, told in another run."""
    if isinstance(value, SurveyNotice):
        return value
    dated = {"utc_s": value.utc_s + later_s} if getattr(value, "utc_s", None) else {}
    return replace(value, run=run, **dated)


def test_readings_from_before_utc_was_known_are_dated_by_what_came_later(
    tmp_path: Path, export: Export
) -> None:
    told = Told(4)
    first = told.models[0]
    messages = [(at, replace(value, utc_s=None) if value is first else value) for at, value in told.messages]
    assert export(record(tmp_path / "recording", messages), "--csv", tmp_path / "a.csv")[0] == 0
    times = pd.read_csv(tmp_path / "a.csv", parse_dates=["time_utc"])["time_utc"]
    assert times[0].timestamp() == pytest.approx(UTC_S + told.readings[0].model_time_s, abs=0.01)


def test_a_vehicle_that_starts_again_is_one_track(tmp_path: Path, export: Export) -> None:
    """Its clock begins at 0 again, an hour later, and numbers begin at 0 in a new run."""
    told = Told(3)
    later: list[tuple[float, object]] = []
    for at, value in told.messages:
        match value:
            case HealthNotice() | ObservationBatch() | LogBatch() | PlanNotice():
                value = replace(value, run=RUN + 1)
            case ModelSnapshot():
                value = replace(value, utc_s=value.utc_s + 3600.0, run=RUN + 1)
        later.append((at + 3600.0, value))
    source = record(tmp_path / "recording", [*told.messages, *later])  # type: ignore[list-item]
    assert export(source, "--csv", tmp_path / "a.csv", "--netcdf", tmp_path / "a.nc")[0] == 0
    times = pd.read_csv(tmp_path / "a.csv", parse_dates=["time_utc"])["time_utc"]
    assert len(times) == 2 * len(told.readings)
    assert times.is_monotonic_increasing
    assert (times[120] - times[0]).total_seconds() == pytest.approx(3600.0, abs=0.01)
    with xr.open_dataset(tmp_path / "a.nc") as maps:
        assert (np.diff(maps.time.values) > np.timedelta64(0)).all()


def test_what_a_run_tells_dates_only_that_run(tmp_path: Path, export: Export) -> None:
    """A recorder that was away hears the last model of one run after health of the next, whose clock is another."""
    told = Told(3)
    last = told.models[-1]
    began_s = UTC_S + 7200.0
    nearby = told.readings[0]
    later = ObservationBatch(RUN + 1, 0, 0, 1, (nearby,))
    messages = [
        *told.messages,
        (began_s + 11.0, replace(health(11.0, (0.0, 0.0), run=RUN + 1), utc_s=began_s + 11.0)),
        (began_s + 12.0, later),
        (began_s + 13.0, replace(last, sequence=99)),
        (began_s + 14.0, replace(plan(7), utc_s=UTC_S + 30.0)),
    ]
    source = record(tmp_path / "recording", messages)
    code, said = export(source, "--csv", tmp_path / "a.csv", "--mcap", tmp_path / "a.mcap")
    assert (code, said) == (0, "")
    times = pd.read_csv(tmp_path / "a.csv", parse_dates=["time_utc"])["time_utc"]
    assert times.iloc[-1].timestamp() == pytest.approx(began_s + nearby.model_time_s, abs=0.01)
    with (tmp_path / "a.mcap").open("rb") as file:
        at_ns = [one.log_time for _, _, one in make_reader(file).iter_messages(topics=["/boat1/plan"])]
    assert any(abs(each / 1e9 - UTC_S - 30.0) < 0.01 for each in at_ns)


def test_two_surveys_are_exported_one_at_a_time(told: Told, tmp_path: Path, export: Export) -> None:
    shift_s = 86_400.0
    messages = list(told.messages)
    for at, value in told.messages:
        if isinstance(value, ModelSnapshot):
            moved = replace(
                value,
                model_time_s=value.model_time_s + shift_s,
                utc_s=value.utc_s + shift_s,
                origin_lat_deg=35.0,
            )
            messages.append((at + shift_s, moved))
    source = record(tmp_path / "recording", messages)
    code, said = export(source, "--netcdf", tmp_path / "a.nc")
    assert code == 65
    assert "surveyed another area or variable from 2025-06-16T15:07:48.500Z on" in said
    assert export(source, "--netcdf", tmp_path / "a.nc", "--until", "2025-06-16T00:00:00")[0] == 0
    code, said = export(source, "--netcdf", tmp_path / "b.nc", "--from", "2025-06-16T00:00:00Z")
    assert (code, said) == (0, "")
    with xr.open_dataset(tmp_path / "a.nc") as first, xr.open_dataset(tmp_path / "b.nc") as second:
        assert float(first.lat[0]) == pytest.approx(34.4, abs=0.001)
        assert float(second.lat[0]) == pytest.approx(35.0, abs=0.001)
        # Nobody told of the second survey's land.
        assert "was not recorded" in second.attrs["land"]


def test_a_window_without_anything_is_told(recording: Path, tmp_path: Path, export: Export) -> None:
    code, said = export(recording, "--csv", tmp_path / "a.csv", "--from", "2030-01-01")
    assert code == 65
    assert "there is no model of boat1" in said


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("[1, 2]", "must be a map"),
        ("a b: 1", "'a b' is no name"),
        ("license: [x]", "license: must be a text or a number"),
        ("x: {", "is no YAML"),
        ("license: true", "license: must be a text or a number"),
    ],
)
def test_attributes_that_are_none_are_told(
    content: str, why: str, recording: Path, tmp_path: Path, export: Export
) -> None:
    path = tmp_path / "attributes.yaml"
    path.write_text(content)
    code, said = export(recording, "--netcdf", tmp_path / "a.nc", "--attributes", path)
    assert code == 65
    assert why in said


def test_health_without_a_clock_dates_nothing(tmp_path: Path, export: Export) -> None:
    with Recorder(tmp_path / "recording") as recorder:
        recorder.write(UTC_S, "usv/boat1/health", "", encode(health(None, (0.0, 0.0))))
    code, said = export(tmp_path / "recording", "--csv", tmp_path / "a.csv")
    assert code == 65
    assert "there is no model" in said


def test_a_survey_across_the_antimeridian_is_in_one_piece(told: Told, tmp_path: Path, export: Export) -> None:
    def moved(lon_deg: float) -> float:
        return (lon_deg + 120.5 + 179.93 + 180.0) % 360.0 - 180.0

    def ring(corners: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
        return tuple((lat, moved(lon)) for lat, lon in corners)

    messages: list[tuple[float, object]] = []
    for at, value in told.messages:
        match value:
            case ModelSnapshot():
                value = replace(value, origin_lon_deg=179.93)
            case HealthNotice():
                value = replace(value, lon_deg=moved(value.lon_deg))
            case ObservationBatch():
                value = replace(value, items=tuple(replace(i, lon_deg=moved(i.lon_deg)) for i in value.items))
            case SurveyNotice():
                rings = {name: tuple(map(ring, getattr(value, name))) for name in ("area", "land")}
                value = replace(value, **rings)
        messages.append((at, value))
    source = record(tmp_path / "recording", messages)  # type: ignore[arg-type]
    files = [tmp_path / name for name in ("a.nc", "t.nc", "a.json")]
    words = [
        word for pair in zip(("--netcdf", "--trajectory", "--geojson"), files, strict=True) for word in pair
    ]
    assert export(source, *words) == (0, "")
    with xr.open_dataset(files[0]) as maps, xr.open_dataset(files[1]) as track:
        for lon in (maps.lon.values, track.lon.values):
            assert 179.9 < lon.min() < 180.0 < lon.max() < 180.1
        assert (np.diff(maps.lon) > 0).all()
        assert np.abs(np.diff(track.lon)).max() < 0.01
        # The island is where it was.
        assert "missing" in maps.attrs["land"]
        assert np.isnan(
            maps.sea_water_practical_salinity[-1].sel(lat=34.436, lon=179.93 + 0.0653, method="nearest")
        )
    lines = [each["geometry"] for each in json.loads(files[2].read_text())["features"]]
    (first, *_) = lines
    assert first["type"] == "MultiLineString"
    assert all(abs(lon) <= 180.0 for part in first["coordinates"] for lon, _ in part)


@pytest.fixture
def file_limit() -> Iterator[Callable[[int], None]]:
    """Files grow to so many bytes and no further, as if the disk were full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("option", ["--netcdf", "--trajectory", "--csv", "--mcap"])
def test_a_full_disk_is_told_and_nothing_is_left(
    option: str, recording: Path, tmp_path: Path, export: Export, file_limit: Callable[[int], None]
) -> None:
    # More than the archive needs, less than the file.
    sizes = {"--netcdf": 300_000, "--trajectory": 70_000, "--csv": 40_000, "--mcap": 300_000}
    words = (recording, option, tmp_path / "a", "--every", "1h", "--resolution", "25")
    file_limit(sizes[option])
    code, said = export(*words)
    assert code == 73
    assert "full" in said or "too large" in said
    assert "TMPDIR" not in said
    assert left(tmp_path) == []


def test_a_full_temporary_folder_is_told(
    recording: Path, tmp_path: Path, export: Export, file_limit: Callable[[int], None]
) -> None:
    file_limit(10_000)
    code, said = export(recording, "--csv", tmp_path / "a")
    assert code == 73
    assert "TMPDIR names another" in said
    assert left(tmp_path) == []
