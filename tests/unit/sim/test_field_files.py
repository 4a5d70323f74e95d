"""NetCDF files as they come, written here in small: every trap that a real file has set."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest

from sim.field import FieldError, open_field, shrunk

LAT = np.array([33.0, 33.1, 33.25, 33.4])
LON = np.array([-119.0, -118.9, -118.8, -118.7, -118.6])


def plane(lat: Any, lon: Any) -> Any:
    return 30.0 + 2.0 * (np.asarray(lat) - 33.0) + 3.0 * (np.asarray(lon) + 119.0)


def write(path: Path, build: Any) -> Path:
    with netCDF4.Dataset(path, "w") as dataset:
        build(dataset)
    return path


def axes(dataset: Any, lat: Any = LAT, lon: Any = LON) -> None:
    for name, values, units in (("lat", lat, "degrees_north"), ("lon", lon, "degrees_east")):
        dataset.createDimension(name, len(values))
        variable = dataset.createVariable(name, "f8", (name,))
        variable.units = units
        variable[:] = values


def regular(
    path: Path, lat: Any = LAT, lon: Any = LON, values: Any = None, attributes: dict[str, Any] | None = None
) -> Path:
    def build(dataset: Any) -> None:
        axes(dataset, lat, lon)
        variable = dataset.createVariable("salinity", "f8", ("lat", "lon"), fill_value=-999.0)
        variable.setncatts(attributes or {})
        wrapped = (np.asarray(lon) + 180.0) % 360.0 - 180.0
        variable[:] = plane(np.asarray(lat)[:, None], wrapped) if values is None else values

    return write(path, build)


def assert_is_the_plane(field: Any) -> None:
    lat, lon = np.meshgrid(np.linspace(33.0, 33.4, 9), np.linspace(-119.0, -118.6, 11), indexing="ij")
    np.testing.assert_allclose(field.value(lat, lon, 0.0), plane(lat, lon), atol=1e-9)


@pytest.mark.parametrize(
    ("lat", "lon"),
    [
        pytest.param(LAT, LON, id="ascending"),
        pytest.param(LAT[::-1], LON, id="descending latitudes"),
        pytest.param(LAT, LON + 360.0, id="longitudes 0..360"),
        pytest.param(LAT[::-1], LON[::-1] + 360.0, id="everything turned round"),
    ],
)
def test_a_plane_is_interpolated_exactly_whatever_the_order_of_the_axes(
    tmp_path: Path, lat: Any, lon: Any
) -> None:
    field = open_field(regular(tmp_path / "a.nc", lat, lon))
    assert_is_the_plane(field)
    assert field.bounds.west == pytest.approx(-119.0)
    assert field.value(33.2, -118.75 + 360.0, 0.0) == pytest.approx(plane(33.2, -118.75))


def test_a_grid_across_the_date_line(tmp_path: Path) -> None:
    lon = np.array([179.8, 179.9, -180.0, -179.9])
    values = np.tile([1.0, 2.0, 3.0, 4.0], (4, 1))
    field = open_field(regular(tmp_path / "a.nc", LAT, lon, values))
    np.testing.assert_allclose(
        field.value(33.2, [179.85, 179.95, -179.95, -179.9], 0.0), [1.5, 2.5, 3.5, 4.0]
    )


def test_a_file_without_time_or_units(tmp_path: Path) -> None:
    field = open_field(regular(tmp_path / "a.nc"))
    assert field.times_s == (0.0, 0.0)
    assert field.info.start_utc is None
    assert field.info.units == ""
    assert field.info.label == "salinity"
    assert field.value(33.1, -118.9, 1e9) == field.value(33.1, -118.9, -1e9)


def test_outside_is_nan_and_no_land(tmp_path: Path) -> None:
    field = open_field(regular(tmp_path / "a.nc"))
    outside = np.array([32.5, 33.2, 33.2, 34.0, np.nan])
    assert np.isnan(field.value(outside, [-118.8, -119.5, -118.0, -118.8, -118.8], 0.0)).all()
    assert not field.is_land(outside, [-118.8, -119.5, -118.0, -118.8, -118.8]).any()


def test_cells_reach_half_a_spacing_beyond_the_outermost_points(tmp_path: Path) -> None:
    field = open_field(regular(tmp_path / "a.nc"))
    assert field.value(32.96, -118.8, 0.0) == pytest.approx(plane(33.0, -118.8))
    assert np.isnan(field.value(32.94, -118.8, 0.0))


def test_near_the_coast_only_water_counts(tmp_path: Path) -> None:
    values = plane(LAT[:, None], LON)
    values[1, 2] = -999.0
    field = open_field(regular(tmp_path / "a.nc", values=values))
    assert bool(field.is_land(33.1, -118.8))
    assert np.isnan(field.value(33.1, -118.8, 0.0))
    # Between a land point and a water point, on the water's side: the water's value alone.
    assert field.value(33.1, -118.86, 0.0) == pytest.approx(values[1, 1])
    lat, lon = np.meshgrid(np.linspace(33.0, 33.4, 41), np.linspace(-119.0, -118.6, 41), indexing="ij")
    seen = field.value(lat, lon, 0.0)
    assert np.array_equal(np.isnan(seen), field.is_land(lat, lon))
    assert np.nanmin(seen) >= values[values > 0].min() - 1e-9


def test_times_are_interpolated_and_held(tmp_path: Path) -> None:
    def build(dataset: Any) -> None:
        axes(dataset)
        dataset.createDimension("time", 3)
        time = dataset.createVariable("time", "f8", ("time",))
        time.units = "hours since 2020-05-01 06:00:00"
        time[:] = [12.0, 13.0, 15.0]
        variable = dataset.createVariable("chl", "f4", ("time", "lat", "lon"))
        variable.units = "mg m-3"
        for k, value in enumerate((1.0, 3.0, 7.0)):
            variable[k] = value

    field = open_field(write(tmp_path / "a.nc", build))
    assert field.info.start_utc == datetime(2020, 5, 1, 18, tzinfo=UTC)
    assert field.times_s == (0.0, 10800.0)
    expected = {-5.0: 1.0, 0.0: 1.0, 1800.0: 2.0, 3600.0: 3.0, 7200.0: 5.0, 10800.0: 7.0, 1e6: 7.0}
    for time_s, value in expected.items():
        assert field.value(33.2, -118.75, time_s) == pytest.approx(value)


def test_clouds_are_bridged_in_time_and_are_no_land(tmp_path: Path) -> None:
    def build(dataset: Any) -> None:
        axes(dataset)
        dataset.createDimension("time", 3)
        time = dataset.createVariable("time", "f8", ("time",))
        time.units = "days"
        time[:] = [10.0, 11.0, 12.0]
        variable = dataset.createVariable("sst", "f4", ("time", "lat", "lon"), fill_value=np.nan)
        values = np.full((3, 4, 5), 15.0)
        values[:, 1, 1] = [14.0, np.nan, 16.0]
        values[:, 2, 2] = [np.nan, np.nan, 17.0]
        values[:, 3, 3] = np.nan
        variable[:] = values

    field = open_field(write(tmp_path / "a.nc", build))
    assert field.mask.land.sum() == 1
    assert bool(field.is_land(33.4, -118.7))
    assert field.value(33.1, -118.9, 86400.0) == pytest.approx(15.0)
    assert field.value(33.25, -118.8, 0.0) == pytest.approx(17.0)


def curvilinear(dataset: Any, lat: Any, lon: Any, names: tuple[str, str] = ("lat_rho", "lon_rho")) -> None:
    dataset.createDimension("eta_rho", lat.shape[0])
    dataset.createDimension("xi_rho", lat.shape[1])
    for name, values in zip(names, (lat, lon), strict=True):
        dataset.createVariable(name, "f8", ("eta_rho", "xi_rho"))[:] = values


def rotated(rows: int = 30, columns: int = 40) -> tuple[Any, Any]:
    """A bent, rotated grid about 33 N, 119 W."""
    v, u = np.meshgrid(np.linspace(-1.0, 1.0, rows), np.linspace(-1.0, 1.0, columns), indexing="ij")
    return 33.0 + 0.3 * v + 0.2 * u + 0.03 * u * u, -119.0 + 0.4 * u - 0.2 * v + 0.04 * u * v


def test_roms_on_a_bent_grid(tmp_path: Path) -> None:
    lat, lon = rotated()
    mask = np.ones(lat.shape)
    mask[:8, :8] = 0.0

    def build(dataset: Any) -> None:
        curvilinear(dataset, lat, lon)
        dataset.createDimension("s_rho", 3)
        dataset.createDimension("ocean_time", 2)
        dataset.createVariable("ocean_time", "f8", ("ocean_time",))[:] = [100.0, 200.0]  # no units, no epoch
        dataset.createVariable("mask_rho", "f8", ("eta_rho", "xi_rho"))[:] = mask
        salt = dataset.createVariable(
            "salt", "f4", ("ocean_time", "s_rho", "eta_rho", "xi_rho"), fill_value=1e37
        )
        salt.time = "ocean_time"
        salt[:, :2] = 99.0
        salt[:, 2] = plane(lat, lon)  # land is not filled

    field = open_field(write(tmp_path / "a.nc", build))
    assert field.times_s == (0.0, 100.0)
    assert field.info.start_utc is None
    assert np.array_equal(field.is_land(lat, lon), mask == 0.0)
    seen = field.value(lat, lon, 50.0)
    assert np.array_equal(np.isnan(seen), mask == 0.0)
    np.testing.assert_allclose(seen[mask == 1.0], plane(lat, lon)[mask == 1.0], atol=1e-5)
    # A plane is linear, the grid is gently bent: between the points bilinear is nearly exact.
    rng = np.random.default_rng(1)
    row, column = rng.uniform(9, 28, 500), rng.uniform(9, 38, 500)
    between = field.mask.grid.positions(row, column)
    np.testing.assert_allclose(field.value(*between, 0.0), plane(*between), atol=1e-3)


def test_one_place_at_a_time_equals_all_at_once(tmp_path: Path) -> None:
    lat, lon = rotated()

    def build(dataset: Any) -> None:
        curvilinear(dataset, lat, lon)
        dataset.createVariable("temp", "f8", ("eta_rho", "xi_rho"))[:] = np.sin(9 * lat) + np.cos(8 * lon)

    field = open_field(write(tmp_path / "a.nc", build))
    rng = np.random.default_rng(2)
    lats, lons = rng.uniform(32.3, 33.7, 400), rng.uniform(-119.8, -118.2, 400)
    at_once = field.value(lats, lons, 0.0)
    singly = np.array([field.value(a, b, 0.0) for a, b in zip(lats, lons, strict=True)])
    np.testing.assert_allclose(singly, at_once, atol=1e-11)
    assert 0.3 < np.isnan(at_once).mean() < 0.9


def test_a_curvilinear_grid_over_the_pole(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.linspace(-3.0, 4.0, 12), np.linspace(-4.0, 3.0, 14))
    lat, lon = 90.0 - np.hypot(x, y), np.degrees(np.arctan2(x, -y))

    def build(dataset: Any) -> None:
        curvilinear(dataset, lat, lon)
        dataset.createVariable("temp", "f8", ("eta_rho", "xi_rho"))[:] = x + 10.0 * y

    field = open_field(write(tmp_path / "a.nc", build))
    np.testing.assert_allclose(field.value(lat, lon, 0.0), x + 10.0 * y, atol=1e-9)
    assert field.value(90.0, 12.0, 0.0) == pytest.approx(0.0, abs=1e-2)


def test_two_dimensional_coordinates_of_a_plain_grid_are_recognised(tmp_path: Path) -> None:
    lat, lon = np.meshgrid(LAT[::-1], LON + 360.0, indexing="ij")

    def build(dataset: Any) -> None:
        curvilinear(dataset, lat, lon, ("nav_lat", "nav_lon"))
        dataset.createVariable("so", "f8", ("eta_rho", "xi_rho"))[:] = plane(lat, lon - 360.0)

    field = open_field(write(tmp_path / "a.nc", build))
    assert type(field.mask.grid).__name__ == "RectilinearGrid"
    assert_is_the_plane(field)


def test_transposed_values_packed_integers_and_depth(tmp_path: Path) -> None:
    def build(dataset: Any) -> None:
        axes(dataset)
        dataset.createDimension("depth", 3)
        depth = dataset.createVariable("depth", "f4", ("depth",))
        depth.positive = "down"
        depth[:] = [50.0, 10.0, 0.5]
        variable = dataset.createVariable("so", "i2", ("lon", "depth", "lat"), fill_value=-32767)
        variable.setncatts({"scale_factor": 0.001, "add_offset": 30.0, "valid_min": np.int16(-30000)})
        variable.set_auto_maskandscale(False)
        packed = np.rint((plane(LAT[:, None], LON) - 30.0) * 1000.0).astype(np.int16)
        packed[0, 0] = -32767
        packed[3, 4] = -30001
        variable[:] = 0
        variable[:, 2, :] = packed.T

    field = open_field(write(tmp_path / "a.nc", build))
    assert np.argwhere(field.mask.land).tolist() == [[0, 0], [3, 4]]
    assert field.value(33.25, -118.7, 0.0) == pytest.approx(plane(33.25, -118.7), abs=1e-3)


def test_a_mask_of_bits_as_satellites_have_it(tmp_path: Path) -> None:
    def build(dataset: Any) -> None:
        axes(dataset)
        mask = dataset.createVariable("mask", "i1", ("lat", "lon"))
        mask.flag_masks = np.array([1, 2, 4, 8], dtype="i1")
        mask.flag_meanings = "water land optional_lake_surface sea_ice"
        values = np.ones((4, 5), dtype="i1")
        values[2, 3], values[0, 1] = 2, 9
        mask[:] = values
        dataset.createVariable("analysed_sst", "f4", ("lat", "lon"))[:] = 290.0

    field = open_field(write(tmp_path / "a.nc", build))
    assert np.argwhere(field.mask.land).tolist() == [[2, 3]]


def test_a_small_field_is_not_shrunk_and_a_large_one_says_so(tmp_path: Path) -> None:
    field = open_field(regular(tmp_path / "a.nc"))
    assert shrunk(field, 1e6) is field
    small = shrunk(field, 15_000.0)
    assert max(small.bounds.size_m) == pytest.approx(15_000.0)
    assert small.bounds.centre == pytest.approx(field.bounds.centre)
    assert "shrunk" in small.info.description
    assert "a.nc" in small.info.description
    factor = max(field.bounds.size_m) / 15_000.0
    lat0, lon0 = field.bounds.centre
    assert small.value(lat0 + 0.1 / factor, lon0 - 0.15 / factor, 0.0) == pytest.approx(
        float(field.value(lat0 + 0.1, lon0 - 0.15, 0.0))
    )


# --- what cannot be opened ---------------------------------------------------------------------------------


def test_no_such_file(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match="no such file"):
        open_field(tmp_path / "none.nc")
    with pytest.raises(FieldError, match=r"synthetic-patch\[:SEED\]"):
        open_field("syntetic")


def test_not_netcdf(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_text("lat,lon,salt\n")
    with pytest.raises(FieldError, match=r"a\.nc: not a NetCDF file"):
        open_field(path)


def test_a_missing_variable_lists_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match=r"no variable 'chlor'.*there are: salinity"):
        open_field(regular(tmp_path / "a.nc"), "chlor")
    with pytest.raises(FieldError, match="has only 'salinity'"):
        open_field("synthetic-patch", "temp")


def test_all_land(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match="'salinity' is land or missing everywhere"):
        open_field(regular(tmp_path / "a.nc", values=np.full((4, 5), -999.0)))


def test_no_coordinates(tmp_path: Path) -> None:
    def build(dataset: Any) -> None:
        dataset.createDimension("y", 4)
        dataset.createDimension("x", 5)
        dataset.createVariable("salt", "f4", ("y", "x"))[:] = 33.0

    path = write(tmp_path / "a.nc", build)
    with pytest.raises(FieldError, match="no latitude and longitude"):
        open_field(path, "salt")
    with pytest.raises(FieldError, match="no variable lies on a grid"):
        open_field(path)


def test_several_variables_and_none_preferred(tmp_path: Path) -> None:
    def build(dataset: Any) -> None:
        axes(dataset)
        for name in ("oxygen", "nitrate"):
            dataset.createVariable(name, "f4", ("lat", "lon"))[:] = 1.0

    with pytest.raises(FieldError, match="one of: oxygen, nitrate"):
        open_field(write(tmp_path / "a.nc", build))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param(lambda lat, lon: lat.__setitem__((3, 4), np.nan), "lacks 1 of 1200 values", id="gap"),
        pytest.param(lambda lat, lon: lat.fill(0.0), "is 0 everywhere", id="never written"),
        pytest.param(lambda lat, lon: lat.__imul__(1000.0), "no angle in degrees", id="metres"),
        pytest.param(lambda lat, lon: lat.__setitem__(5, lat[7] + 0.01), "folded", id="folded"),
    ],
)
def test_unusable_curvilinear_coordinates(tmp_path: Path, change: Any, message: str) -> None:
    lat, lon = rotated()
    change(lat, lon)

    def build(dataset: Any) -> None:
        curvilinear(dataset, lat, lon)
        dataset.createVariable("salt", "f4", ("eta_rho", "xi_rho"))[:] = 33.0

    with pytest.raises(FieldError, match=message):
        open_field(write(tmp_path / "a.nc", build))


def test_axes_that_turn_back(tmp_path: Path) -> None:
    with pytest.raises(FieldError, match="'lat' neither rises nor falls"):
        open_field(regular(tmp_path / "a.nc", lat=np.array([33.0, 33.2, 33.1, 33.3])))


def test_an_unknown_dimension_and_unordered_times(tmp_path: Path) -> None:
    def ensemble(dataset: Any) -> None:
        axes(dataset)
        dataset.createDimension("member", 4)
        dataset.createVariable("salt", "f4", ("member", "lat", "lon"))[:] = 33.0

    with pytest.raises(FieldError, match="'member' has 4 entries"):
        open_field(write(tmp_path / "a.nc", ensemble))

    def backwards(dataset: Any) -> None:
        axes(dataset)
        dataset.createDimension("time", 2)
        dataset.createVariable("time", "f8", ("time",))[:] = [2.0, 1.0]
        dataset.createVariable("salt", "f4", ("time", "lat", "lon"))[:] = 33.0

    with pytest.raises(FieldError, match="not increasing"):
        open_field(write(tmp_path / "b.nc", backwards))


def classic(path: Path, lat: Any = LAT) -> bytes:
    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as dataset:
        axes(dataset, lat)
        dataset.createVariable("salinity", "f8", ("lat", "lon"))[:] = plane(lat[:, None], LON)
    return path.read_bytes()


def test_a_file_that_was_cut_is_told_to_be(tmp_path: Path) -> None:
    """The library would fill what is missing with zeros."""
    path = tmp_path / "a.nc"
    content = classic(path, np.linspace(33.0, 33.4, 200))
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(FieldError, match=r"a\.nc: .*it is cut or damaged"):
        open_field(path)


def test_a_claim_of_more_values_than_there_is_memory_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(classic(path).replace(b"\0\0\0\x05", b"\x3f\xff\xff\xff", 1))
    with pytest.raises(FieldError, match=r"a\.nc: "):
        open_field(path)


def test_a_name_that_is_no_text_is_told_as_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_bytes(classic(path).replace(b"salinity", b"sal\xf2nity"))
    with pytest.raises(FieldError, match=r"a\.nc: not a NetCDF file, or a damaged one"):
        open_field(path)
