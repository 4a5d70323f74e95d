"""The paper's experiment: its setting is the paper's, its statistics say what they claim, its command writes it all."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
from experiment_seas import small_sea

from autonomy.config import load
from sim.cli import main
from sim.experiment import paper, paper_setting, sweep
from sim.experiment.cells import Cell, Result
from sim.experiment.paper_numbers import (
    ABLATIONS,
    LAUNCHES,
    LEARNED,
    MAP_COLUMNS,
    MAP_ROWS,
    NOISE_SHARE,
    THRESHOLDS,
)
from sim.experiment.paper_report import falling, verdict
from sim.experiment.paper_statistics import Course, claim_of, course_of, fluctuation, thirds
from sim.experiment.sweep_places import Place
from sim.experiment.waters import waters_of
from sim.synthetic import BIGHT

CONFIGURATION = Path(__file__).resolve().parents[4] / "config" / "paper.yaml"


@pytest.fixture(scope="module")
def bight():
    """The paper's map, with another sea on it."""
    field = small_sea(BIGHT.south, BIGHT.north, BIGHT.west, BIGHT.east)
    return waters_of(field, MAP_ROWS, MAP_COLUMNS, passage_cells=40)


def test_the_profile_on_the_papers_map_is_the_papers_configuration(bight):
    """All that differs is the area's spelling, the stand-off and how finely ways round land are sought."""
    ours, shipped = paper_setting.profile(bight), load(CONFIGURATION, {})
    assert ours.sampling.spacing_m == pytest.approx(shipped.sampling.spacing_m, rel=1e-4)
    by_hand, theirs = ours.model.hyperparameters, shipped.model.hyperparameters
    assert by_hand.lengthscales_m == pytest.approx(theirs.lengthscales_m, rel=1e-4)
    same = {"survey": shipped.survey, "sampling": shipped.sampling, "model": shipped.model}
    assert ours.model_copy(update=same) == shipped
    assert (ours.model.capacity, ours.exploration.rho0, ours.planning.lattice) == (100, 0.6, (12, 12))
    assert THRESHOLDS == (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


def test_launches_are_rows_and_columns_from_the_south_west(bight):
    for (row, column), (lat_deg, lon_deg) in zip(
        LAUNCHES, [(32.5997, -118.5795), (33.7334, -120.3026)], strict=True
    ):
        place, shift_m = paper_setting.launch_m(bight, row, column)
        assert shift_m == 0.0
        assert bight.survey.frame.to_geodetic(place).tolist() == pytest.approx([lat_deg, lon_deg], abs=1e-4)


def test_a_launch_on_land_is_moved_to_the_nearest_water(bight):
    # The middle of the island, whose radius is 0.08 of the map.
    place, shift_m = paper_setting.launch_m(
        bight, round(0.6 * (MAP_ROWS - 1)), round(0.35 * (MAP_COLUMNS - 1))
    )
    assert bight.survey.is_navigable(place)[0]
    assert 0.07 * 0.9 * 345e3 < shift_m < 0.1 * 371e3


def test_learned_hyperparameters_are_in_map_cells(bight):
    found = paper_setting.hyperparameters(bight, LEARNED)
    assert found.signal_variance == pytest.approx(math.exp(6.8))
    assert found.noise_variance == pytest.approx(math.exp(-4.6))
    # A cell is 953.6 m by 982.4 m in the middle of the map.
    assert found.lengthscales_m == pytest.approx((29.96 * 953.6, 24.53 * 982.4), rel=1e-3)


def test_ablations_change_what_they_say(bight):
    plain = paper_setting.profile(bight)
    changed = {name: paper_setting.profile(bight, ablations=(name,)) for name in ABLATIONS}
    assert changed["replaced"].exploration.rho_rule == "replaced"
    assert changed["uncentred"].model.centring_samples == 0
    spots_alone = paper_setting.profile(bight, ablations=("spots-only", "no-pilot"))
    assert spots_alone.model.centring_samples == plain.planning.spots


def test_the_random_readings_are_the_fields_at_fifty_places_on_the_water(bight):
    places_m, values = paper_setting.random_readings(bight, seed=3)
    truth = bight.truth(0.0)
    columns = np.searchsorted(bight.x_axis_m, places_m[:, 0] - 1e-6)
    rows = np.searchsorted(bight.y_axis_m, places_m[:, 1] - 1e-6)
    assert len({*zip(rows, columns, strict=True)}) == 50
    noise = values - truth[rows, columns]
    assert 0.7 < noise.std() / (NOISE_SHARE * np.nanstd(truth)) < 1.3


def test_fluctuation_is_what_is_left_about_a_falling_curve():
    falls = np.exp(-(np.linspace(0.0, 3.0, 50) ** 2))
    assert fluctuation(falls) == pytest.approx(0.0, abs=1e-12)
    # A tooth of ±0.1 on a level line: the best falling curve is the line.
    tooth = np.exp(0.1 * (-1.0) ** np.arange(1, 51))
    assert fluctuation(tooth) == pytest.approx(0.1, rel=0.02)
    assert fluctuation(7.0 * tooth) == pytest.approx(fluctuation(tooth))


def test_thirds_are_of_the_run_since_the_first_model():
    samples = np.array([50.0, 100.0, 101.0, 150.0, 151.0, 200.0])
    assert thirds(samples, np.array([9.0, 7.0, 1.0, 1.0, 4.0, 2.0])) == (8.0, 3.0)


def test_a_course_adds_up_what_the_error_climbs():
    """By hand: up by ln 2 under way, by ln 3 at the re-estimate, down by ln 6 at the next."""
    values = {
        "samples": np.array([100, 200, 300, 400]),
        "mse": np.array([1.0, 2.0, 6.0, 1.0]),
        "fit_samples": np.array([200, 300]),
        "fit_before": np.array([2.0, 6.0]),
        "fit_after": np.array([6.0, 1.0]),
        "fit_kept": np.array([False, True]),
        "plan_samples": np.array([0, 200, 300]),
    }
    result = Result(Cell("", "", {"launch": 0, "rho0": 0.6, "seed": 0}), values, {})
    course = course_of(result)
    assert course.rise == pytest.approx(math.log(2.0) + math.log(3.0))
    assert course.rise_at_fits == pytest.approx(math.log(3.0))
    assert (course.early_jump, course.late_jump) == pytest.approx((math.log(3.0), math.log(6.0)))
    assert (course.first, course.last, course.final) == (1.5, 1.0, 1.0)
    assert (course.reestimates, course.new_fits, course.longest_fit) == (2, 1, 200)


COURSE = Course(0, 0.6, 0, 3, 5, 2.0, 1.0, 0.9, 0.2, 1.0, 0.5, 0.3, 0.1, 2, 700)


@pytest.mark.parametrize(("sign", "holds"), [(-1.0, True), (1.0, False), (0.0, None)])
def test_the_claim_follows_the_figures(sign, holds):
    rng = np.random.default_rng(1)
    courses = [
        replace(
            COURSE,
            launch=launch,
            rho0=rho0,
            fluctuation=math.exp(sign * rho0) * rng.uniform(0.9, 1.1),
            rise=rng.uniform(),
        )
        for launch in (0, 1)
        for rho0 in THRESHOLDS
    ]
    assert claim_of(courses, lambda course: course.fluctuation).holds is holds
    said = " ".join(verdict(courses))
    assert {True: "trend: **more", False: "trend: **less", None: "trend: **no telling"}[holds] in said


def test_a_setting_that_does_not_fall_is_named():
    rising = replace(COURSE, launch=1, rho0=0.3, first=1.0, last=2.0)
    assert "1 of 2 voyages" in falling([COURSE, rising])
    assert "launch (207, 68), ρ₀ 0.3, seed 0: 1 to 2" in falling([COURSE, rising])


@pytest.fixture
def file(tmp_path):
    """A small sea over a fortnight, as CF NetCDF."""
    week_s = 7 * 86_400.0
    sea = small_sea(instants_s=(0.0, week_s, 2.0 * week_s))
    lat, lon = np.linspace(33.0, 33.1, 41), np.linspace(-118.1, -118.0, 41)
    frames = [np.where(sea.mask.land, np.nan, sea.grid(lat, lon, k * week_s)) for k in range(3)]
    days = xarray.date_range("2016-08-15", periods=3, freq="7D")
    dataset = xarray.Dataset(
        {"salt": (("time", "lat", "lon"), np.array(frames), {"units": "1", "long_name": "salinity"})},
        {
            "time": days,
            "lat": ("lat", lat, {"units": "degrees_north"}),
            "lon": ("lon", lon, {"units": "degrees_east"}),
        },
    )
    dataset.to_netcdf(tmp_path / "sea.nc")
    return tmp_path / "sea.nc"


def test_the_experiment_writes_all_figures_and_says_what_they_show(file, tmp_path, monkeypatch):
    """On a small map, with short voyages; the numbers beside the report are those of the voyages it keeps."""
    monkeypatch.setattr(sweep, "this_machine", lambda jobs: Place(lambda _: ThreadPoolExecutor(jobs), jobs))
    options = paper.Options(tmp_path / "out", str(file), samples=80, thresholds=(0.6,), rows=22, columns=23)
    outcome = paper.run_paper(options)
    pictures = sorted(path.name for path in options.out.glob("*.png"))
    assert [name[:8] for name in pictures] == [f"figure-{number}" for number in range(1, 9)]
    told = outcome.report.read_text(encoding="utf-8")
    assert all(f"({name})" in told for name in pictures)
    numbers = json.loads((options.out / "results.json").read_text(encoding="utf-8"))
    assert [(each["launch"], each["rho0"]) for each in numbers["courses"]] == [(0, 0.6), (1, 0.6)]
    assert [each["final"] for each in numbers["courses"]] == [each.final for each in outcome.courses]
    assert all(each.reestimates > 0 for each in outcome.courses)
    assert len(list((options.out / "cells").glob("*.nc"))) == 2


def test_a_week_apart_is_read_off_the_file(file):
    waters = paper_setting.paper_waters(str(file), None, 24, 25)
    shown = paper.frames(paper.open_field(str(file)), waters)
    assert [name for name, _ in shown] == ["(a) 15 August 2016", "(b) 22 August 2016", "(c) 29 August 2016"]
    assert np.nanmax(np.abs(shown[0][1] - waters.truth(0.0))) == 0.0
    assert np.nanmax(np.abs(shown[2][1] - shown[0][1])) > 0.05


def test_what_cannot_be_done_is_said_on_the_command_line(tmp_path, capsys):
    words = ["experiment", "paper", "--out", str(tmp_path / "out")]
    assert main([*words, "--field", "nowhere.nc"]) == 2
    assert "nowhere.nc" in capsys.readouterr().err
    for wrong in (["--rho0", "0.2,1.5"], ["--samples", "60"], ["--ablation", "centred"]):
        with pytest.raises(SystemExit, match="2"):
            main([*words, *wrong])
        assert wrong[0] in capsys.readouterr().err
