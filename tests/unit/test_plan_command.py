"""`autonomy plan`: the planner at the desk."""

import json
import math
import re
import sys

import numpy as np
import pytest
import shapely

from autonomy.cli import main
from autonomy.config import load
from autonomy.core import Core
from autonomy.learning import snapshot
from autonomy.planning.survey import read_survey
from autonomy.shell.checkpoint import Checkpoint, encode, fits

CONFIGURATION = """
survey:
  area: [[33.50, -118.60], [33.50, -118.57], [33.52, -118.57], [33.52, -118.60]]
  land: coast.geojson
  standoff_m: 50
  passage_cells: 40
model: {centring_samples: 5, capacity: 40}
exploration: {minimum_basis: 20}
sampling: {spacing_m: 50}
planning: {lattice: [7, 6], spots: 6}
budget: {speed_mps: 2.0}
"""
ISLAND = [[-118.590, 33.505], [-118.580, 33.505], [-118.580, 33.515], [-118.590, 33.515], [-118.590, 33.505]]


@pytest.fixture
def desk(tmp_path):
    (tmp_path / "coast.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ISLAND]}))
    (tmp_path / "boat.yaml").write_text(CONFIGURATION)
    return tmp_path


def plan(desk, *words):
    return main(
        ["plan", "--config", str(desk / "boat.yaml"), "--out", str(desk / "plan.geojson"), *map(str, words)]
    )


def route(desk):
    return json.loads((desk / "plan.geojson").read_text())["features"][0]


def core_of(desk, readings=60):
    """A core that has learnt some."""
    configuration = load(desk / "boat.yaml", {})
    survey = read_survey(configuration.survey)
    core = Core(configuration, survey)
    x_min, y_min, x_max, _ = survey.bounds
    for k in range(readings):
        at = (x_min + (x_max - x_min) * k / readings, y_min + 100.0)
        core.learner.add(at, 33.0 + math.sin(k / 6.0), 10.0 * k)
    return core, configuration, survey


def checkpoint_bytes(desk, number=1, readings=60):
    core, configuration, survey = core_of(desk, readings)
    return encode(Checkpoint(number, fits(configuration, survey), core.checkpoint(), 0.0, 0.0, "boot", None))


def model_bytes(desk, **metadata):
    core, _, survey = core_of(desk)
    here = {"origin_lat_deg": survey.frame.origin_lat_deg, "origin_lon_deg": survey.frame.origin_lon_deg}
    return snapshot.encode(core.learner.model(), {**here, "samples": 60, "vehicle": "tern", **metadata})


def figure(text, word):
    return float(re.search(rf"^{word} +(\S+)", text, re.MULTILINE)[1])


def test_without_a_model_there_is_a_plan_from_the_prior(desk, capsys):
    assert plan(desk) == 0
    said = capsys.readouterr().out
    line = shapely.geometry.shape(route(desk)["geometry"])
    assert not line.intersects(shapely.Polygon(ISLAND))
    told = route(desk)["properties"]
    assert "nothing learnt: the prior" in said
    assert "of the field's standard deviation expected, 1 without the plan" in said
    assert 0.0 < figure(said, "rmse") < 1.0
    assert figure(said, "route") == pytest.approx(told["length_km"], abs=0.01)
    assert told["duration_s"] == pytest.approx(told["length_km"] * 500.0, abs=1.0)
    assert told["mutual_information"] > 0.0
    assert told["energy_wh"] is None
    assert "energy       not known" in said


def test_the_same_question_has_the_same_answer(desk):
    plan(desk)
    first = (desk / "plan.geojson").read_bytes()
    plan(desk)
    assert (desk / "plan.geojson").read_bytes() == first


def test_energy_is_told_by_the_configured_consumption(desk, capsys):
    assert plan(desk, "--set", "budget.consumption_j_per_m=36") == 0
    told = route(desk)["properties"]
    assert told["energy_wh"] == pytest.approx(10.0 * told["length_km"], abs=0.1)
    assert figure(capsys.readouterr().out, "energy") == told["energy_wh"]


def test_the_start_is_heeded(desk):
    assert plan(desk, "--start", "33.518,-118.572") == 0
    assert route(desk)["geometry"]["coordinates"][0] == pytest.approx([-118.572, 33.518], abs=1e-6)


def test_the_budget_brings_the_boat_home(desk):
    assert plan(desk, "--start", "33.503,-118.595", "--budget-km", "4") == 0
    coordinates, told = route(desk)["geometry"]["coordinates"], route(desk)["properties"]
    assert told["length_km"] <= 4.0
    assert told["length_km"] > 2.0
    assert told["home_corners"] >= 1
    assert coordinates[-1] == pytest.approx(coordinates[0], abs=1e-6)
    assert told["mutual_information"] is None


@pytest.mark.parametrize("form", ["a model file", "a checkpoint", "a folder"])
def test_what_was_learnt_is_planned_with(desk, form, capsys):
    known = desk / "known"
    if form == "a folder":
        known.mkdir()
        (known / "even.checkpoint").write_bytes(checkpoint_bytes(desk, 2, readings=60))
        (known / "odd.checkpoint").write_bytes(checkpoint_bytes(desk, 1, readings=30))
        (known / "even.checkpoint.unfit-1.aside").write_bytes(b"nothing")
    else:
        known.write_bytes(model_bytes(desk) if form == "a model file" else checkpoint_bytes(desk))
    assert plan(desk, "--model", known) == 0
    assert "a model of 60 readings" in capsys.readouterr().out
    told = route(desk)["properties"]
    assert told["model_version"] == 60
    assert 0.0 < told["expected_rmse"] < told["rmse_before"]


def test_a_picture_is_drawn(desk):
    assert plan(desk, "--picture", desk / "plan.png") == 0
    assert (desk / "plan.png").read_bytes().startswith(b"\x89PNG")


def test_without_matplotlib_a_picture_is_refused_before_anything_is_done(desk, monkeypatch, capsys):
    for name in ("autonomy.shore.plan_picture", "autonomy.shore.picture"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    for name in ("matplotlib", "matplotlib.figure", "matplotlib.backends.backend_agg"):
        monkeypatch.setitem(sys.modules, name, None)
    assert plan(desk, "--picture", desk / "plan.png") == 2
    assert "--picture needs matplotlib: pip install 'halocline[shore]'" in capsys.readouterr().err
    assert not (desk / "plan.geojson").exists()


def elsewhere(desk):
    return model_bytes(desk, origin_lat_deg=12.0)


def nowhere(desk):
    core, _, _ = core_of(desk)
    return snapshot.encode(core.learner.model())


def of_another_sensor(desk):
    good = (desk / "boat.yaml").read_text()
    (desk / "boat.yaml").write_text(good + "sensor: {message_name: TEMP}\n")
    data = checkpoint_bytes(desk)
    (desk / "boat.yaml").write_text(good)
    return data


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (elsewhere, "it is of another survey: its origin is 12.00000"),
        (nowhere, "it does not say where on Earth"),
        (of_another_sensor, "it was made with another configuration: sensor differ"),
        (lambda desk: checkpoint_bytes(desk)[:-20], "it is a damaged checkpoint"),
        (lambda desk: b"nothing of the kind", "it is neither a model file nor a checkpoint"),
    ],
)
def test_a_model_that_cannot_be_used_is_told(desk, make, words, capsys):
    (desk / "known").write_bytes(make(desk))
    assert plan(desk, "--model", desk / "known") == 65
    assert f"autonomy plan: {desk / 'known'}: {words}" in capsys.readouterr().err
    assert not (desk / "plan.geojson").exists()


def test_a_folder_without_checkpoints_is_told(desk, capsys):
    assert plan(desk, "--model", desk) == 65
    assert "holds no sound checkpoint" in capsys.readouterr().err


def test_files_that_are_not_there_are_told(desk, capsys):
    assert plan(desk, "--model", desk / "missing") == 66
    assert plan(desk, "--picture", desk / "missing" / "plan.png") == 73
    assert (
        main(["plan", "--config", str(desk / "boat.yaml"), "--out", str(desk / "missing" / "plan.geojson")])
        == 73
    )
    assert main(["plan", "--config", str(desk / "missing.yaml"), "--out", str(desk / "plan.geojson")]) == 78
    errors = capsys.readouterr().err
    assert f"{desk / 'missing'}: No such file or directory" in errors


def test_where_no_plan_can_begin_it_is_told(desk, capsys):
    assert plan(desk, "--start", "33.51,-118.585") == 1
    assert "autonomy plan: no plan: none of the" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words", [("--start", "33.5"), ("--start", "95,10"), ("--budget-km", "0"), ("--budget-km", "x")]
)
def test_mistakes_of_usage(desk, words):
    with pytest.raises(SystemExit) as caught:
        plan(desk, *words)
    assert caught.value.code == 2


def test_the_plan_of_a_checkpoint_begins_where_the_boat_was(desk, monkeypatch):
    there = np.array([400.0, -700.0])
    monkeypatch.setattr(Core, "position_m", property(lambda self: there))
    (desk / "known").write_bytes(checkpoint_bytes(desk))
    survey = read_survey(load(desk / "boat.yaml", {}).survey)
    assert plan(desk, "--model", desk / "known") == 0
    lat_deg, lon_deg = survey.frame.to_geodetic(there)
    assert route(desk)["geometry"]["coordinates"][0] == pytest.approx([lon_deg, lat_deg], abs=1e-6)
