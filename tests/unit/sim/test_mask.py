import json
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import shapely
from shapely.geometry import shape

from sim.cli import main
from sim.field import Field, open_field, shrunk
from sim.land import feature_collection, land_polygons, water_outline


def cell_centres(field: Field) -> tuple[Any, Any, Any]:
    row, column = np.indices(field.mask.land.shape)
    lat, lon = field.mask.grid.positions(row, column)
    return lat.ravel(), lon.ravel(), field.mask.land.ravel()


def assert_land_exactly(field: Field, land: Any) -> None:
    """No water centre inside; every land cell inside, up to points just within its corners and edges."""
    lat, lon, is_land = cell_centres(field)
    inside = shapely.contains_xy(land, lon, lat)
    assert np.array_equal(inside, is_land)
    row, column = np.nonzero(field.mask.land)
    for dv, du in ((-1, -1), (-1, 1), (1, -1), (1, 1), (0, 1), (1, 0), (-1, 0), (0, -1)):
        edge_lat, edge_lon = field.mask.grid.positions(row + 0.4999 * dv, column + 0.4999 * du)
        assert shapely.contains_xy(land, edge_lon, edge_lat).all()


def assert_wound_as_rfc_7946(land: Any) -> None:
    for part in land.geoms:
        assert part.exterior.is_ccw
        assert not any(hole.is_ccw for hole in part.interiors)


@pytest.mark.parametrize("spec", ["synthetic", "synthetic-patch"])
def test_land_of_the_synthetic_seas(spec: str) -> None:
    field = open_field(spec)
    land = land_polygons(field)
    assert land.is_valid
    assert_land_exactly(field, land)
    assert_wound_as_rfc_7946(land)


@pytest.mark.parametrize(
    "name",
    [
        "txla_roms_native_top10levels.nc",
        "Nordic_subset.nc",
        "ucla_roms_point_conception_joined_101x201.nc",
        "scb_mur_sst_7dates_240x435.nc",
    ],
)
@pytest.mark.parametrize("small", [False, True])
def test_land_of_real_files(real_data_dir: Path, name: str, small: bool) -> None:
    field = open_field(real_data_dir / name)
    field = shrunk(field) if small else field
    land = land_polygons(field)
    assert land.is_valid
    assert_land_exactly(field, land)
    assert_wound_as_rfc_7946(land)


@pytest.mark.parametrize("tolerance_m", [70.0, 300.0])
def test_simplified_land_still_holds_all_land_and_little_more(tolerance_m: float) -> None:
    field = open_field("synthetic-patch")
    exact, simple = land_polygons(field), land_polygons(field, tolerance_m)
    assert simple.covers(exact)
    assert shapely.get_num_coordinates(simple) < shapely.get_num_coordinates(exact)
    degrees = 2.1 * tolerance_m / 111_000.0 / np.cos(np.radians(34.0))
    assert exact.buffer(degrees).covers(simple)


def test_the_outline_holds_the_sea_inside_its_domain() -> None:
    for spec in ("synthetic", "synthetic-patch"):
        field = open_field(spec)
        outline, b = water_outline(field), field.bounds
        assert outline.bounds == pytest.approx((b.west, b.south, b.east, b.north))
        assert outline.exterior.is_ccw


def test_the_outline_of_a_real_curvilinear_grid_goes_through_its_rim(real_data_dir: Path) -> None:
    path = real_data_dir / "txla_roms_native_top10levels.nc"
    outline = water_outline(open_field(path))
    with netCDF4.Dataset(path) as dataset:
        lat, lon = dataset["lat_rho"][:].filled(), dataset["lon_rho"][:].filled()
    rim = np.concatenate([np.stack([lon[k], lat[k]], -1) for k in (0, -1)])
    assert shapely.distance(outline.exterior, shapely.points(rim)).max() < 1e-9
    assert shapely.contains_xy(outline, lon[1:-1, 1:-1], lat[1:-1, 1:-1]).all()


def test_the_command_writes_geojson_that_reads_back(tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "land.geojson"
    assert main(["mask", "synthetic-patch", "--out", str(out)]) == 0
    assert "polygons of land" in capsys.readouterr().out
    content = json.loads(out.read_text())
    assert content["type"] == "FeatureCollection"
    land = shapely.union_all([shape(feature["geometry"]) for feature in content["features"]])
    lat, lon, is_land = cell_centres(open_field("synthetic-patch"))
    assert np.array_equal(shapely.contains_xy(land, lon, lat), is_land)


def test_the_command_says_what_is_wrong(tmp_path: Path, capsys: Any) -> None:
    assert main(["mask", str(tmp_path / "none.nc"), "--out", str(tmp_path / "a.geojson")]) == 2
    assert "no such file" in capsys.readouterr().err
    assert main(["mask", "synthetic-patch", "--out", str(tmp_path / "no" / "a.geojson")]) == 1
    assert "cannot be written" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        main(["mask", "synthetic-patch", "--out", "a.geojson", "--simplify", "-3"])


def test_a_sea_without_land_is_an_empty_collection(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    with netCDF4.Dataset(path, "w") as dataset:
        for name, values in (("lat", [1.0, 2.0, 3.0]), ("lon", [5.0, 6.0, 7.0])):
            dataset.createDimension(name, 3)
            dataset.createVariable(name, "f8", (name,))[:] = values
        dataset.createVariable("salt", "f8", ("lat", "lon"))[:] = 33.0
    land = land_polygons(open_field(path), simplify_m=100.0)
    assert land.is_empty
    assert feature_collection(land, "land") == {"type": "FeatureCollection", "features": []}
