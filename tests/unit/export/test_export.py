"""What is exported is opened by libraries that nobody here wrote, and holds what the vehicle told."""

import io
import json
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
import xarray as xr
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from told import FRAME, ISLAND_M, UTC_S, Told, record

from autonomy import cli
from autonomy.effects import Topic
from autonomy.quality import Check
from autonomy.wire import ModelSnapshot, decode, encode

NAME = "sea_water_practical_salinity"
EXPORTED_MODELS = [0, 3, 6, 9, 11]
"""Of the models, one a minute: every third, and the newest."""


def seconds(times: xr.DataArray) -> np.ndarray:
    return times.values.astype("datetime64[ns]").astype(np.int64) / 1e9


def test_maps_are_what_the_models_predict(exported: Path, told: Told) -> None:
    with xr.open_dataset(exported / "map.nc") as maps:
        wanted = [told.models[i] for i in EXPORTED_MODELS]
        assert seconds(maps.time) == pytest.approx([one.utc_s for one in wanted], abs=1e-6)
        lon, lat = np.meshgrid(maps.lon, maps.lat)
        points = FRAME.to_local(lat, lon)
        shape = shapely.Polygon(ISLAND_M)
        land = shapely.contains_xy(shape, points[..., 0], points[..., 1])
        near = shapely.contains_xy(shape.boundary.buffer(20.0), points[..., 0], points[..., 1])
        assert land.sum() > 100
        for row, one in enumerate(wanted):
            mean, error = maps[NAME][row].values, maps[f"{NAME}_standard_error"][row].values
            assert np.isnan(mean[land & ~near]).all()
            assert (np.isnan(mean) == np.isnan(error)).all()
            inside = np.isfinite(mean)
            assert inside.mean() > 0.9
            predicted = one.model.predict(points[inside])
            # Half a unit in the last place of float32 at 33, and of what the wire took off the model.
            assert np.abs(mean[inside] - predicted.mean).max() < 5e-6
            assert np.abs(error[inside] - np.sqrt(predicted.variance)).max() < 5e-6
        assert maps[NAME].attrs["units"] == "1"
        assert maps[f"{NAME}_standard_error"].attrs["standard_name"] == f"{NAME} standard_error"


def test_the_grid_covers_the_survey_evenly(exported: Path) -> None:
    with xr.open_dataset(exported / "map.nc") as maps:
        for axis in (maps.lat.values, maps.lon.values):
            assert np.diff(axis) == pytest.approx(np.full(len(axis) - 1, axis[1] - axis[0]), rel=1e-9)
        corners = FRAME.to_local([maps.lat[0], maps.lat[-1]], [maps.lon[0], maps.lon[-1]])
        assert np.abs(corners - [[0.0, 0.0], [12_000.0, 9_000.0]]).max() < 150.0
        assert float(maps.attrs["geospatial_lat_min"]) == pytest.approx(34.4, abs=1e-3)


def test_hyperparameters_are_told_over_time(exported: Path, told: Told) -> None:
    with xr.open_datatree(exported / "map.nc") as tree:
        model = tree["model"].to_dataset()
        assert model["samples"].values.tolist() == [told.models[i].samples for i in EXPORTED_MODELS]
        assert model["noise_standard_deviation"].values == pytest.approx(1e-3**0.5)
        assert model["component_lengthscale_east"].values == pytest.approx(1500.0)
        assert model["component_lengthscale_north"].values == pytest.approx(1200.0)
        assert np.isnan(model["component_timescale"].values).all()
        assert b"1." in bytes(model["kernel"].values[0])
        assert (model["time"] == tree["time"]).all()


def test_the_trajectory_is_what_was_read(exported: Path, told: Told) -> None:
    with xr.open_dataset(exported / "track.nc") as track:
        assert track.attrs["featureType"] == "trajectory"
        assert seconds(track.time) == pytest.approx(
            [UTC_S + one.model_time_s for one in told.readings], abs=1e-5
        )
        assert track.lat.values.tolist() == [one.lat_deg for one in told.readings]
        assert track.lon.values.tolist() == [one.lon_deg for one in told.readings]
        np.testing.assert_array_equal(track[NAME].values, [one.value for one in told.readings])
        flags = track[f"{NAME}_qartod_aggregate"]
        assert flags.values.tolist() == [one.flag for one in told.readings]
        assert flags.attrs["flag_values"].tolist() == [1, 2, 3, 4, 9]
        assert len(flags.attrs["flag_meanings"].split()) == 5
        for check in Check:
            values = track[f"{NAME}_qartod_{check.name.lower()}"].values
            assert values.tolist() == [one.checks[check] for one in told.readings]
        assert set(track[NAME].attrs["ancillary_variables"].split()) <= set(track.variables)
        assert track["trajectory"].values.item() == b"boat1"
        assert float(track["depth"]) == 0.5


def test_the_table_is_what_was_read(exported: Path, told: Told) -> None:
    table = pd.read_csv(exported / "observations.csv", parse_dates=["time_utc"])
    assert len(table) == len(told.readings)
    moment = datetime.fromtimestamp(UTC_S + told.readings[5].model_time_s, UTC)
    assert table["time_utc"][5].to_pydatetime() == moment
    np.testing.assert_array_equal(table[f"{NAME} [1]"], [one.value for one in told.readings])
    assert table["latitude_deg"].tolist() == [one.lat_deg for one in told.readings]
    assert table["qartod_flag"].tolist() == [one.flag for one in told.readings]
    assert table["qartod_spike"].tolist() == [one.checks[Check.SPIKE] for one in told.readings]


def test_the_chart_has_track_plans_and_spots(exported: Path, told: Told) -> None:
    features = json.loads((exported / "out.geojson").read_text())["features"]
    shapes = {
        kind: [
            (shapely.from_geojson(json.dumps(each["geometry"])), each["properties"])
            for each in features
            if each["properties"]["kind"] == kind
        ]
        for kind in ("track", "plan", "spot")
    }
    ((line, _),) = shapes["track"]
    heard = [each for _, each in told.messages if type(each).__name__ == "HealthNotice" and each.model_time_s]
    assert shapely.get_coordinates(line) == pytest.approx(
        np.array([(h.lon_deg, h.lat_deg) for h in heard]), abs=1e-7
    )
    assert [what["newest"] for _, what in shapes["plan"]] == [False, True]
    for (route, what), plan in zip(shapes["plan"], told.plans, strict=True):
        corners = [(lon, lat) for lat, lon in (plan.start_deg, *plan.route_deg)]
        assert shapely.get_coordinates(route) == pytest.approx(np.array(corners), abs=1e-7)
        assert what["planner"] == "paper"
    assert len(shapes["spot"]) == 4


def test_the_log_holds_maps_positions_lines_and_plans(exported: Path, told: Told) -> None:
    with (exported / "run.mcap").open("rb") as file:
        decoded = list(
            make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(
                topics=[
                    f"/boat1/{name}"
                    for name in ("mean", "standard_deviation", "fix", "log", "plan", "plan_scene")
                ]
            )
        )
    by_topic: dict[str, list[tuple[str, float, object]]] = {}
    for schema, channel, message, content in decoded:
        by_topic.setdefault(channel.topic, []).append((schema.name, message.log_time / 1e9, content))
    wanted = [told.models[i] for i in EXPORTED_MODELS]
    for topic, kind in (("mean", "mean"), ("standard_deviation", "variance")):
        grids = by_topic[f"/boat1/{topic}"]
        assert {name for name, _, _ in grids} == {"foxglove.Grid"}
        assert [at for _, at, _ in grids] == pytest.approx([one.utc_s for one in wanted], abs=1e-6)
        for (_, _, grid), one in zip(grids, wanted, strict=True):
            cells = np.frombuffer(grid.data, [("value", "<f4"), ("colour", "u1", 4)])
            values = cells["value"].reshape(-1, grid.column_count)
            assert (np.isnan(values).ravel() == (cells["colour"][:, 3] == 0)).all()
            assert [each.name for each in grid.fields] == [topic, "red", "green", "blue", "alpha"]
            x = grid.pose.position.x + (np.arange(values.shape[1]) + 0.5) * grid.cell_size.x
            y = grid.pose.position.y + (np.arange(values.shape[0]) + 0.5) * grid.cell_size.y
            predicted = getattr(one.model.predict_grid(x, y), kind)
            predicted = np.sqrt(predicted) if kind == "variance" else predicted
            inside = np.isfinite(values)
            assert 0.9 < inside.mean() < 1.0
            assert np.abs(values[inside] - predicted[inside]).max() < 5e-6
    (name, _, fix), *_ = by_topic["/boat1/fix"]
    assert name == "foxglove.LocationFix"
    assert len(by_topic["/boat1/fix"]) == 12
    assert (fix.latitude, fix.longitude) == pytest.approx((34.4 + 4500 / 111e3, -120.37), abs=0.1)
    assert [content.message for _, _, content in by_topic["/boat1/log"]] == [f"minute {i}" for i in range(12)]
    assert {schema for schema, _, _ in by_topic["/boat1/log"]} == {"foxglove.Log"}
    assert {schema for schema, _, _ in by_topic["/boat1/plan"]} == {"foxglove.GeoJSON"}
    assert json.loads(by_topic["/boat1/plan"][0][2].geojson)["type"] == "FeatureCollection"
    assert len(by_topic["/boat1/plan_scene"][0][2].entities[0].lines[0].points) == 4


def test_every_message_of_the_log_is_decodable_and_in_order(exported: Path, told: Told) -> None:
    data = (exported / "run.mcap").read_bytes()
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    times = [message.log_time for _, _, message in reader.iter_messages(log_time_order=False)]
    assert times == sorted(times)
    summary = make_reader(io.BytesIO(data)).get_summary()
    assert summary is not None
    counts = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
    assert counts["/boat1/observation"] == len(told.readings)


def test_the_compliance_checker_finds_nothing(exported: Path) -> None:
    """IOOS's own program, in a process of its own; what it calls suggestions does not count."""
    program = Path(sys.executable).with_name("compliance-checker")
    files = [str(exported / name) for name in ("map.nc", "track.nc")]
    words = ["--test=cf:1.8", "--test=acdd:1.3", *files]
    done = subprocess.run([program, *words], capture_output=True, text=True, timeout=100, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("All tests passed!") == 4


def test_what_came_over_a_thin_link_is_exported_as_it_came(told: Told, tmp_path: Path) -> None:
    """Packed, in few bits: the maps are those of what arrived, and say how far they may be off."""
    few = [
        (at, replace(one, precision="8 bit") if isinstance(one, ModelSnapshot) else one)
        for at, one in told.messages
    ]
    source = record(tmp_path / "recording", few, packed=True)
    words = ["--netcdf", str(tmp_path / "a.nc"), "--csv", str(tmp_path / "a.csv"), "--every", "3min"]
    assert cli.main(["export", str(source), *words]) == 0
    assert len(pd.read_csv(tmp_path / "a.csv")) == len(told.readings)
    arrived = decode(Topic.MODEL, encode(replace(told.models[-1], precision="8 bit"), packed=True))
    assert isinstance(arrived, ModelSnapshot)
    with xr.open_datatree(tmp_path / "a.nc") as tree:
        maps, model = tree.to_dataset(), tree["model"].to_dataset()
        assert maps.attrs["precision"] == "8 bit"
        assert model["stated_error_of_mean"].values[-1] == pytest.approx(arrived.stated_error[0])
        lon, lat = np.meshgrid(maps.lon, maps.lat)
        mean = maps[NAME][-1].values
        inside = np.isfinite(mean)
        predicted = arrived.model.predict(FRAME.to_local(lat, lon)[inside])
        assert np.abs(mean[inside] - predicted.mean).max() < 5e-6
        sigma = arrived.model.kernel.signal_variance**0.5
        truth = told.models[-1].model.predict(FRAME.to_local(lat, lon)[inside])
        assert np.abs(predicted.mean - truth.mean).max() < 0.01 * sigma
