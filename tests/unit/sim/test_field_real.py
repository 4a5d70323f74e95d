"""Real files, compared with what netCDF4 itself reads at their grid points."""

from datetime import UTC, datetime
from pathlib import Path

import netCDF4
import numpy as np
import pytest

from sim.field import FieldError, open_field, shrunk


def test_txla_keeps_the_salinity_of_zero_beside_the_river(real_data_dir: Path) -> None:
    path = real_data_dir / "txla_roms_native_top10levels.nc"
    field = open_field(path)
    with netCDF4.Dataset(path) as dataset:
        lat, lon = dataset["lat_rho"][:].filled(), dataset["lon_rho"][:].filled()
        salt = dataset["salt"][:, -1]
        land = dataset["mask_rho"][:].filled() == 0.0
    assert (field.info.variable, field.info.units) == ("salt", "")
    assert field.info.start_utc == datetime(2009, 11, 19, 12, tzinfo=UTC)
    assert field.times_s == (0.0, 14400.0)
    for k, time_s in enumerate((0.0, 14400.0)):
        seen = field.value(lat, lon, time_s)
        assert np.array_equal(np.isnan(seen), land)
        np.testing.assert_allclose(seen[~land], salt[k][~land], atol=1e-5)
    fresh = (salt[0].filled(99.0) == 0.0) & ~land
    assert fresh.sum() >= 28
    np.testing.assert_allclose(field.value(lat[fresh], lon[fresh], 0.0), 0.0, atol=1e-5)
    middle = field.value(lat, lon, 7200.0)[~land]
    np.testing.assert_allclose(middle, 0.5 * (salt[0] + salt[1])[~land], atol=1e-5)


def test_nordic_land_comes_from_the_mask(real_data_dir: Path) -> None:
    path = real_data_dir / "Nordic_subset.nc"
    field = open_field(path, "salt")
    with netCDF4.Dataset(path) as dataset:
        dataset.set_auto_mask(False)  # its fill value does not fit its own type
        lat, lon = dataset["lat_rho"][:], dataset["lon_rho"][:]
        salt = dataset["salt"][:, -1]
        land = dataset["mask_rho"][:] < 0.5
    assert 0.2 < land.mean() < 0.4
    assert np.isfinite(salt[:, land]).all()  # the trap: land looks like water of 24.33
    assert np.array_equal(field.is_land(lat, lon), land)
    seen = field.value(lat, lon, 86400.0)
    assert np.isnan(seen[land]).all()
    np.testing.assert_allclose(seen[~land], salt[1][~land], atol=1e-4)
    assert field.times_s == (0.0, 172800.0)


def test_nordic_coordinates_never_written_are_refused(real_data_dir: Path) -> None:
    with pytest.raises(FieldError, match="'lat_u' is 0 everywhere"):
        open_field(real_data_dir / "Nordic_subset.nc", "u")


def test_ucla_has_a_time_without_an_epoch(real_data_dir: Path) -> None:
    path = real_data_dir / "ucla_roms_point_conception_joined_101x201.nc"
    field = open_field(path)
    with netCDF4.Dataset(path) as dataset:
        lat, lon = dataset["lat_rho"][:].filled(), dataset["lon_rho"][:].filled()
        salt, land = dataset["salt"][-1], dataset["mask_rho"][:].filled() == 0.0
    assert field.info.start_utc is None
    assert field.times_s == (0.0, 0.0)
    seen = field.value(lat, lon, 1e6)
    assert np.array_equal(np.isnan(seen), land)
    np.testing.assert_allclose(seen[~land], salt[~land], atol=1e-5)
    assert 32.0 < np.nanmin(seen) < np.nanmax(seen) < 33.5


def test_satellite_islands_are_land_and_kelvin_stays_kelvin(real_data_dir: Path) -> None:
    path = real_data_dir / "scb_mur_sst_7dates_240x435.nc"
    field = open_field(path)
    with netCDF4.Dataset(path) as dataset:
        lat, lon = dataset["lat"][:].filled(), dataset["lon"][:].filled()
        times = dataset["time"][:].filled()
        sst, land = dataset["analysed_sst"][:], dataset["land"][:].filled() == 1
    assert field.info.units == "kelvin"
    assert field.times_s == (0.0, times[-1] - times[0])
    missing = np.ma.getmaskarray(sst).all(axis=0)
    assert (land & ~missing).any()  # the trap: islands have values
    assert np.array_equal(field.mask.land, land | missing)
    for k in (0, 3, 6):
        seen = field.grid(lat, lon, times[k] - times[0])
        water = ~(land | missing)
        np.testing.assert_allclose(seen[water], sst[k][water], atol=1e-9)
        assert np.isnan(seen[~water]).all()


@pytest.mark.parametrize(
    "name", ["txla_roms_native_top10levels.nc", "Nordic_subset.nc", "scb_mur_sst_7dates_240x435.nc"]
)
def test_shrunk_real_fields_keep_values_and_land(real_data_dir: Path, name: str) -> None:
    field = open_field(real_data_dir / name)
    small = shrunk(field)
    assert max(small.bounds.size_m) == pytest.approx(15_000.0, rel=1e-3)
    rows, columns = field.mask.land.shape
    row, column = np.meshgrid(np.arange(0, rows, 3), np.arange(0, columns, 3), indexing="ij")
    np.testing.assert_allclose(
        small.value(*small.mask.grid.positions(row, column), 0.0),
        field.value(*field.mask.grid.positions(row, column), 0.0),
        atol=1e-6,
    )


@pytest.mark.parametrize("name", ["txla_roms_native_top10levels.nc", "Nordic_subset.nc"])
def test_every_index_of_a_real_curvilinear_grid_is_found_again(real_data_dir: Path, name: str) -> None:
    grid = open_field(real_data_dir / name).mask.grid
    rng = np.random.default_rng(0)
    row = rng.uniform(-0.5, grid.shape[0] - 0.5, 20_000)
    column = rng.uniform(-0.5, grid.shape[1] - 0.5, 20_000)
    found = grid.locate(*grid.positions(row, column))
    np.testing.assert_allclose(found[0], row, atol=1e-8)
    np.testing.assert_allclose(found[1], column, atol=1e-8)
