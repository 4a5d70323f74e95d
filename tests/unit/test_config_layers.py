"""Defaults < file < environment < command line; and where each value comes from."""

import argparse
import math
import os
import pickle
from pathlib import Path

import pytest

from autonomy.commands import show_config
from autonomy.config import Configuration, ConfigurationError, load, load_with_origins

AREA = "survey:\n  area: [[33.0, -118.0], [33.2, -118.0], [33.2, -117.8]]\n"


@pytest.fixture
def boat(tmp_path: Path) -> Path:
    file = tmp_path / "boat.yaml"
    file.write_text(AREA + "model:\n  capacity: 60\n  novelty: 1e-3\n")
    return file


def mistakes(file: Path, environment: dict[str, str], overrides: tuple[str, ...] = ()) -> list[str]:
    with pytest.raises(ConfigurationError) as caught:
        load(file, environment, overrides)
    return [str(problem) for problem in caught.value.problems]


def test_each_layer_overrides_the_ones_before_it(boat: Path) -> None:
    variable = {"HALOCLINE_MODEL__CAPACITY": "70"}
    assert Configuration.model_validate({"survey": load(boat, {}).survey}).model.capacity is None
    assert load(boat, {}).model.capacity == 60
    assert load(boat, variable).model.capacity == 70
    assert load(boat, variable, ["model.capacity=80"]).model.capacity == 80
    assert load(boat, variable, ["model.capacity=80", "model.capacity=90"]).model.capacity == 90


def test_every_value_tells_its_origin(boat: Path) -> None:
    origins = load_with_origins(boat, {"HALOCLINE_SEED": "4"}, ["planning.spots=10"]).origins
    assert str(origins["model", "capacity"]) == f"{boat}:4:3"
    assert str(origins["seed",]) == "environment HALOCLINE_SEED"
    assert str(origins["planning", "spots"]) == "command line --set planning.spots"
    assert ("planning", "lattice") not in origins


def test_the_environment_of_the_process_is_the_default(boat: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HALOCLINE_MODEL__CAPACITY", "77")
    assert load(boat).model.capacity == 77
    assert load(boat, {}).model.capacity == 60


def test_values_outside_the_file_are_yaml(boat: Path) -> None:
    configuration = load(
        boat,
        {
            "HALOCLINE_PLANNING__LATTICE": "[10, 11]",
            "HALOCLINE_EXPLORATION__MAXIMUM_INTERVAL_S": "null",
            "HALOCLINE_MODEL__HYPERPARAMETERS": "{signal_variance: 2, noise_variance: 1e-2}",
        },
        ["model.hyperparameters.lengthscales_m=[100, 200]", "mavlink.endpoint=udpin:0.0.0.0:14600"],
    )
    assert configuration.planning.lattice == (10, 11)
    assert configuration.exploration.maximum_interval_s is None
    assert configuration.model.hyperparameters is not None
    assert configuration.model.hyperparameters.noise_variance == 0.01
    assert configuration.model.hyperparameters.lengthscales_m == (100.0, 200.0)
    assert configuration.mavlink.endpoint == "udpin:0.0.0.0:14600"


def test_text_outside_the_file_needs_no_quotes(boat: Path) -> None:
    sensor = load(boat, {"HALOCLINE_SENSOR__MESSAGE_NAME": "NO"}, ["sensor.units=1"]).sensor
    assert (sensor.message_name, sensor.units) == ("NO", "1")


def test_mistakes_outside_the_file_name_the_variable_or_the_option(boat: Path) -> None:
    assert mistakes(boat, {"HALOCLINE_MODEL__CAPACITY": "1e6"}, ("planning.spots=many",)) == [
        "command line --set planning.spots: planning.spots: must be a whole number (got 'many'); "
        "allowed: a whole number from 1 to 200",
        "environment HALOCLINE_MODEL__CAPACITY: model.capacity: must be a whole number (got 1000000.0); "
        "allowed: a whole number from 2 to 300 or null",
    ]


@pytest.mark.parametrize(
    ("variable", "what"),
    [
        ("HALOCLINE_MODEL__CAPASITY", "model.capasity: unknown key; did you mean capacity?"),
        ("HALOCLINE_MODLE__CAPACITY", "modle: unknown key; did you mean model?"),
        ("HALOCLINE_SEED__X", "seed.x: seed is a value, not a section"),
        ("HALOCLINE_SURVEY__AREA", "survey.area: no readable file"),
    ],
)
def test_variables_that_name_no_key_are_mistakes(variable: str, what: str, boat: Path) -> None:
    (mistake,) = mistakes(boat, {variable: "1x"})
    assert mistake.startswith(f"environment {variable}: {what}")


def test_a_variable_that_is_no_yaml_is_a_mistake(boat: Path) -> None:
    (mistake,) = mistakes(boat, {"HALOCLINE_PLANNING__LATTICE": "[12, 12"})
    assert mistake.startswith("environment HALOCLINE_PLANNING__LATTICE: planning.lattice: not YAML: ")


def test_other_peoples_variables_are_left_alone(boat: Path) -> None:
    assert load(boat, {"HALOCLINE_DATA": "/data", "HOME": "/home/me"}) == load(boat, {})


def test_an_override_lies_over_a_section_that_the_file_leaves_empty(tmp_path: Path) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(AREA + "model:\n  # capacity: 50\n")
    assert load(file, {}).model.capacity is None
    assert load(file, {"HALOCLINE_MODEL__CAPACITY": "70"}).model.capacity == 70


def test_an_override_can_replace_what_is_wrong_in_the_file(boat: Path) -> None:
    boat.write_text("survey: {area: [[1, 1]]}\nmodel: {capacity: 1}\n")
    area = "[[33, -118], [33.2, -118], [33.2, -117.8]]"
    assert load(boat, {}, [f"survey.area={area}", "model.capacity=50"]).model.capacity == 50


def test_numbers_are_read_as_people_mean_them(tmp_path: Path) -> None:
    file = tmp_path / "boat.yaml"
    file.write_text(
        AREA + "model: {novelty: 1e-3, jitter: 1.E-6, capacity: 200, history_cells: 3_000}\n"
        "sensor: {minimum: -.inf, maximum: +.5}\nmavlink: {adopt: on, position_rate_hz: 2}\n"
    )
    configuration = load(file, {})
    assert configuration.model.novelty == 1e-3
    assert configuration.model.jitter == 1e-6
    assert configuration.model.history_cells == 3000
    assert configuration.sensor.minimum == -math.inf
    assert configuration.sensor.maximum == 0.5
    assert configuration.mavlink.position_rate_hz == 2.0
    assert configuration.mavlink.adopt is True


def test_a_byte_order_mark_and_foreign_line_ends_do_no_harm(tmp_path: Path) -> None:
    file = tmp_path / "boat.yaml"
    file.write_bytes(b"\xef\xbb\xbf" + AREA.replace("\n", "\r\n").encode())
    assert load(file, {}).survey.standoff_m == 100.0


def test_files_are_sought_beside_the_configuration_or_in_the_present_directory(
    boat: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    (tmp_path / "land.geojson").write_text("{}")
    (elsewhere / "other.geojson").write_text("{}")
    boat.write_text(AREA + "  land: land.geojson\n")
    assert load(Path(os.path.relpath(boat)), {}).survey.land == tmp_path / "elsewhere" / ".." / "land.geojson"
    survey = load(boat, {"HALOCLINE_SURVEY__LAND": "other.geojson"}, ["survey.area=other.geojson"]).survey
    assert survey.land == survey.area == elsewhere / "other.geojson"


def test_a_configuration_travels_to_the_worker(boat: Path) -> None:
    configuration = load(boat, {})
    assert pickle.loads(pickle.dumps(configuration)) == configuration


def test_show_config_prints_what_is_in_force_and_loads_back(
    boat: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in [name for name in os.environ if name.startswith("HALOCLINE_")]:
        monkeypatch.delenv(name)
    monkeypatch.setenv("HALOCLINE_SEED", "4")
    (tmp_path / "kü ste: #1.geojson").write_text("{}")
    boat.write_text(boat.read_text().replace("model:", '  land: "kü ste: #1.geojson"\nmodel:'))
    parser = argparse.ArgumentParser()
    show_config.add_arguments(parser)
    override = "model.hyperparameters={signal_variance: 1, noise_variance: 1, lengthscales_m: [1, 2]}"
    assert show_config.run(parser.parse_args([str(boat), "--set", override])) == 0
    shown = capsys.readouterr().out
    assert f"  capacity: 60  # {boat}:5:3\n" in shown
    assert "  spots: 20  # default\n" in shown
    assert '  units: "1"  # default\n' in shown
    assert "seed: 4  # environment HALOCLINE_SEED\n" in shown
    assert "    noise_variance: 1.0  # command line --set model.hyperparameters\n" in shown
    again = tmp_path / "again.yaml"
    again.write_text(shown)
    assert load(again, {}) == load(boat, {"HALOCLINE_SEED": "4"}, [override])


def test_show_config_tells_mistakes_as_check_config_does(
    boat: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boat.write_text("seed: x\n")
    parser = argparse.ArgumentParser()
    show_config.add_arguments(parser)
    assert show_config.run(parser.parse_args([str(boat)])) == 78
    output = capsys.readouterr()
    assert output.out == ""
    assert f"{boat}:1:1: seed: must be a whole number (got 'x')" in output.err
