from pathlib import Path

import numpy as np
import pytest

from sim.field import lattice, open_field


@pytest.mark.parametrize(("spec", "spacing_m"), [("synthetic", 4000.0), ("synthetic-patch", 300.0)])
def test_the_same_seed_gives_the_same_sea_and_another_another(spec: str, spacing_m: float) -> None:
    one, same, other = open_field(f"{spec}:3"), open_field(f"{spec}:3"), open_field(f"{spec}:4")
    axes = lattice(one, spacing_m)
    first = one.grid(*axes, 5000.0)
    assert np.array_equal(first, same.grid(*axes, 5000.0), equal_nan=True)
    assert np.nanstd(first - other.grid(*axes, 5000.0)) > 0.03
    assert np.array_equal(open_field(spec).grid(*axes, 0.0), open_field(f"{spec}:0").grid(*axes, 0.0), True)


@pytest.mark.parametrize("spec", ["synthetic", "synthetic-patch"])
@pytest.mark.parametrize("seed", range(4))
def test_salinity_is_that_of_the_bight_and_nan_only_on_land(spec: str, seed: int) -> None:
    field = open_field(f"{spec}:{seed}")
    axes = lattice(field, 3000.0 if spec == "synthetic" else 200.0)
    values = field.grid(*axes, 40_000.0)
    lat, lon = np.meshgrid(*axes, indexing="ij")
    assert np.array_equal(np.isnan(values), field.is_land(lat, lon))
    assert 32.7 < np.nanmin(values) < np.nanmax(values) < 34.3
    assert 0.05 < np.nanstd(values) < 0.3
    assert field.info.units == "PSU"


@pytest.mark.parametrize(("spec", "spacing_m"), [("synthetic", 4000.0), ("synthetic-patch", 200.0)])
def test_the_sea_drifts_slowly(spec: str, spacing_m: float) -> None:
    field = open_field(f"{spec}:1")
    axes = lattice(field, spacing_m)
    start, later = field.grid(*axes, 0.0), field.grid(*axes, 50_000.0)
    changed = np.sqrt(np.nanmean((later - start) ** 2)) / np.nanstd(start)
    assert 0.01 < changed < 0.15
    much_later = field.grid(*axes, 1e9)
    assert np.nanmax(np.abs(much_later - start)) < 1.0


def test_the_field_is_smooth_between_its_cells() -> None:
    field = open_field("synthetic-patch:0")
    lat0, lon0 = 33.95, -118.80
    line = field.value(lat0, lon0 + np.linspace(0.0, 0.02, 2001), 0.0)
    assert np.abs(np.diff(line, 2)).max() < 1e-5


def test_the_patch_is_fifteen_kilometres_of_real_coast() -> None:
    field = open_field("synthetic-patch")
    assert field.bounds.size_m == pytest.approx((15_000.0, 15_000.0), rel=1e-6)
    assert 0.10 < field.mask.land.mean() < 0.35
    assert bool(field.is_land(34.03, -118.80))
    assert not bool(field.is_land(33.95, -118.80))


def test_the_bights_land_is_that_of_global_land_mask(real_data_dir: Path) -> None:
    field = open_field("synthetic")
    with np.load(real_data_dir / "scb_mask.npz") as known:
        assert np.array_equal(field.mask.land, known["land"])
