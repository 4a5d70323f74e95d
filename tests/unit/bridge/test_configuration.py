"""Mistakes in the configuration of a bridge: where, what, and what would be right."""

from pathlib import Path

import pytest

from autonomy.bridge.configuration import BridgeConfiguration, load_bridge
from autonomy.config import ConfigurationError
from autonomy.config.reference import keys

REPOSITORY = Path(__file__).parents[3]
GOOD = """\
instrument: {name: probe, endpoint: "serial:/dev/ttyUSB0:9600"}
line: {columns: 4}
values:
  SALT: {field: 4, delay_s: 8}
mavlink: {endpoint: "udpout:127.0.0.1:14560"}
"""


def problems(tmp_path: Path, text: str) -> list[str]:
    file = tmp_path / "bridge.yaml"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load_bridge(file)
    return [str(each).removeprefix(f"{tmp_path}/") for each in caught.value.problems]


@pytest.mark.parametrize(
    ("right", "wrong", "told"),
    [
        ("field: 4", "field: 5", "4:10: values.SALT.field: is no column of a line that has 4 (got 5)"),
        ("field: 4", "field: salt", "4:10: values.SALT.field: is no column of a line that has 4 (got salt)"),
        ("field: 4", "field: 0", "4:10: values.SALT.field: names no field (got 0)"),
        ("field: 4, ", "", "4:3: values.SALT.field: is missing"),
        ("delay_s: 8", "delay_s: -8", "4:20: values.SALT.delay_s: must be at least 0 (got -8)"),
        ("delay_s: 8", "delay_s: 61", "4:20: values.SALT.delay_s: the water is more than 60 s old"),
        ("delay_s: 8", "delays: 8", "4:20: values.SALT.delays: unknown key; did you mean delay_s?"),
        ("delay_s: 8", "response: sharpen", "4:20: values.SALT.response: sharpen needs response_s"),
        (
            "SALT:",
            "SALINITY_PSU:",
            "4:3: values.SALINITY_PSU: is no name for a NAMED_VALUE_FLOAT (12 characters)",
        ),
        (
            "columns: 4",
            "columns: 4, sentence: MTW",
            "2:8: line.columns: columns and sentence are given together",
        ),
        ("columns: 4", "separator: ';'", "2:1: line.columns: says nothing of a line's shape"),
        ("columns: 4", "pattern: '(?P<s>x'", "2:8: line.pattern: not a regular expression"),
        ("columns: 4", "pattern: '(?P<s>x)'", "4:10: values.SALT.field: is no group of the pattern (got 4)"),
        ("columns: 4", "sentence: mtw", "2:8: line.sentence: not allowed here (got 'mtw')"),
        ("columns: 4", "columns: 4, example: '1,2,3'", "2:20: line.example: can't be read: not 4 columns"),
        (
            "columns: 4",
            "columns: 4, example: '1,2,3,x'",
            "2:20: line.example: field 4, which SALT is made of",
        ),
        ("columns: 4", "columns: 4, decimal: ','", "2:20: line.decimal: can't be the separator too"),
        ("mavlink:", "pump: {field: 2}\nmavlink:", "5:1: pump.minimum: exactly one must be given"),
        ("mavlink:", "pump: {field: 9, minimum: 1}\nmavlink:", "5:8: pump.field: is no column"),
        (
            "mavlink:",
            "pump: {message_name: SALT, minimum: 1}\nmavlink:",
            "5:8: pump.message_name: is one of the",
        ),
        (
            "mavlink:",
            "raw: {file_mb: 3, total_mb: 4}\nmavlink:",
            "5:19: raw.total_mb: must be at least twice",
        ),
        ("serial:/dev/ttyUSB0:9600", "/dev/ttyUSB0", "1:27: instrument.endpoint: not an endpoint"),
    ],
)
def test_a_mistake_is_named_with_its_place(tmp_path: Path, right: str, wrong: str, told: str) -> None:
    assert GOOD.count(right) == 1
    (problem,) = problems(tmp_path, GOOD.replace(right, wrong))
    assert problem.startswith(f"bridge.yaml:{told}")
    assert "; allowed: " in problem


def test_all_mistakes_are_told_at_once(tmp_path: Path) -> None:
    text = (
        GOOD.replace("columns: 4", "columns: x")
        .replace("field: 4", "fild: 4")
        .replace("name: probe", "name: a b")
    )
    assert len(problems(tmp_path, text)) == 4


@pytest.mark.parametrize("name", ["ctd", "thermosalinograph"])
def test_the_worked_examples_are_good(name: str) -> None:
    configuration = load_bridge(REPOSITORY / "config" / "bridge" / f"{name}.yaml")
    assert configuration.line.example is not None
    assert "SALT" in configuration.values


def test_files_are_named_relative_to_the_configuration(tmp_path: Path) -> None:
    file = tmp_path / "bridge.yaml"
    file.write_text(GOOD + "raw: {directory: lines}\n")
    assert load_bridge(file).raw.directory == tmp_path / "lines"


@pytest.mark.parametrize("key", list(keys(BridgeConfiguration)), ids=lambda key: ".".join(key.path))
def test_every_key_has_a_meaning(key: object) -> None:
    assert getattr(key, "meaning", "")
