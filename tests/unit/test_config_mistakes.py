"""Every kind of mistake in a configuration file is named with its place, key, fault and remedy."""

import argparse
from pathlib import Path
from typing import NamedTuple

import pytest

from autonomy.commands import check_config
from autonomy.config import Configuration, ConfigurationError, ModelSection, SurveySection, load
from autonomy.config.file import MAXIMUM_BYTES

AREA = "survey:\n  area: [[33.0, -118.0], [33.2, -118.0], [33.2, -117.8]]\n"


class Broken(NamedTuple):
    """A broken file and what must be said about it; `place` is LINE:COLUMN, or empty for the whole file."""

    text: str | bytes
    place: str
    key: str
    what: str
    allowed: str = ""


BROKEN = {
    "too large": Broken(
        AREA + "model:\n  # vectors\n\n  capacity: 100000\n",
        "6:3",
        "model.capacity",
        "must be at most 300 (got 100000)",
        "a whole number from 2 to 300",
    ),
    "too small": Broken(
        AREA + "mavlink: {position_rate_hz: 0}\n",
        "3:11",
        "mavlink.position_rate_hz",
        "must be above 0 (got 0)",
        "a number above 0",
    ),
    "text for a number": Broken(
        AREA + "model:\n  novelty: small\n",
        "4:3",
        "model.novelty",
        "must be a number (got 'small')",
        "a number of at least 0 and below 1",
    ),
    "quoted number": Broken(
        AREA + 'model:\n  novelty: "0,5"\n',
        "4:3",
        "model.novelty",
        "must be a number (got '0,5'); without quotes and with a decimal point",
    ),
    "octal-looking": Broken(AREA + "seed: 010\n", "3:1", "seed", "must be a whole number (got '010')"),
    "fraction": Broken(
        AREA + "planning:\n  spots: 2.5\n", "4:3", "planning.spots", "must be a whole number (got 2.5)"
    ),
    "boolean for a number": Broken(
        AREA + "planning:\n  spots: yes\n", "4:3", "planning.spots", "must be a whole number (got true)"
    ),
    "number for a boolean": Broken(
        AREA + "mavlink:\n  adopt: 1\n", "4:3", "mavlink.adopt", "must be true or false (got 1)"
    ),
    "number for text": Broken(
        AREA + "sensor:\n  units: 1\n", "4:3", "sensor.units", "must be text (got 1); put it into quotes"
    ),
    "not a number": Broken(
        AREA + "survey2:\nsampling: {spacing_m: .nan}\n",
        "4:12",
        "sampling.spacing_m",
        "must be a finite number (got nan)",
    ),
    "nan where infinity is fine": Broken(
        AREA + "sensor: {minimum: .nan}\n", "3:10", "sensor.minimum", "must be a number, not .nan"
    ),
    "infinite": Broken(
        AREA + "mavlink: {position_rate_hz: .inf}\n",
        "3:11",
        "mavlink.position_rate_hz",
        "must be a finite number (got inf)",
    ),
    "overflowing": Broken(
        AREA + "mavlink: {position_rate_hz: 1e999}\n",
        "3:11",
        "mavlink.position_rate_hz",
        "must be a finite number (got inf)",
    ),
    "bad choice": Broken(
        AREA + "estimation:\n  objective: lou\n",
        "4:3",
        "estimation.objective",
        "must be one of 'loo' or 'marginal' (got 'lou')",
        "one of loo, marginal",
    ),
    "bad name": Broken(
        AREA + "vehicle:\n  name: my boat\n",
        "4:3",
        "vehicle.name",
        "not allowed here (got 'my boat')",
        "1 to 32 letters, digits, - and _",
    ),
    "sensor name too long": Broken(
        AREA + "sensor:\n  message_name: SALINITY_PSU\n",
        "4:3",
        "sensor.message_name",
        "not allowed here (got 'SALINITY_PSU')",
        "1 to 10 printable ASCII characters",
    ),
    "bad endpoint": Broken(
        AREA + "mavlink:\n  endpoint: udp:14550\n",
        "4:3",
        "mavlink.endpoint",
        "not an endpoint (got 'udp:14550')",
        "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD",
    ),
    "bad port": Broken(
        AREA + "mavlink:\n  endpoint: tcp:localhost:99999\n",
        "4:3",
        "mavlink.endpoint",
        "the port must be from 1 to 65535 (got 'tcp:localhost:99999')",
    ),
    "bad router": Broken(
        AREA + "shore:\n  connect:\n    - tcp/ok:7447\n    - http://shore\n",
        "6:7",
        "shore.connect[1]",
        "not a zenoh endpoint (got 'http://shore')",
        "PROTOCOL/HOST:PORT",
    ),
    "unknown key": Broken(
        AREA + "model:\n  capasity: 100\n",
        "4:3",
        "model.capasity",
        "unknown key; did you mean capacity?",
        "capacity, memory_mb, update_us, novelty",
    ),
    "key of another section": Broken(
        AREA + "model:\n  rho0: 0.5\n", "4:3", "model.rho0", "unknown key; did you mean exploration.rho0?"
    ),
    "unknown section": Broken(
        AREA + "modle:\n  capacity: 100\n", "3:1", "modle", "unknown key; did you mean model?", "vehicle, "
    ),
    "key given twice": Broken(
        AREA + "model:\n  capacity: 50\n  novelty: 0\n  capacity: 60\n",
        "6:3",
        "model.capacity",
        "given twice (first in line 4)",
        "each key once",
    ),
    "section given twice": Broken(AREA + "survey: {}\n", "3:1", "survey", "given twice (first in line 1)"),
    "missing section": Broken(
        "seed: 1\n", "1:1", "survey", "is missing", "a mapping with the keys name, area"
    ),
    "missing key": Broken("seed: 1\nsurvey:\n", "2:1", "survey.area", "is missing", "at least 3"),
    "half of the hyperparameters": Broken(
        AREA + "model:\n  hyperparameters:\n    signal_variance: 1\n    noise_variance: 1\n",
        "4:3",
        "model.hyperparameters.lengthscales_m",
        "is missing",
        "a list of 2, each a number above 0",
    ),
    "value for a section": Broken(
        AREA + "model: 100\n",
        "3:1",
        "model",
        "must be a mapping of keys (got 100)",
        "a mapping with the keys",
    ),
    "a list at the top": Broken("- survey\n- model\n", "1:1", "", "must be a mapping of sections", "SECTION"),
    "a word at the top": Broken("survey\n", "1:1", "", "must be a mapping of sections (got 'survey')"),
    "empty": Broken("", "1:1", "", "the file is empty", "survey.area"),
    "only comments": Broken("# nothing\n", "1:1", "", "the file is empty"),
    "tab": Broken("survey:\n\tarea: x\n", "2:1", "", "a tab here", "YAML indents with spaces"),
    "syntax": Broken(AREA + "model: {capacity: 100\nseed: 3\n", "4:5", "", "not YAML: expected ',' or '}'"),
    "bad indentation": Broken("survey:\n  area: x\n land: y\n", "3:2", "", "not YAML: expected <block end>"),
    "two documents": Broken(AREA + "---\nseed: 1\n", "3:1", "", "a second document", "one document"),
    "an alias": Broken(
        "survey: &s\n  area: x\nmodel: *s\n",
        "3:8",
        "",
        "aliases (*) are not supported: write the value again",
    ),
    "a thousand million laughs": Broken(
        "a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "2:8", "", "aliases (*) are not supported"
    ),
    "nested too deep": Broken("a: " + "[" * 5000, "1:19", "", "nested more than 16 levels deep"),
    "a tag": Broken(
        AREA + "model: !!python/object:os.system {}\n", "3:8", "model", "the tag", "plain values"
    ),
    "a list for a key": Broken(AREA + "[1, 2]: 3\n", "3:1", "", "a key must be a word"),
    "a character of no use": Broken(AREA + "# \x07\n", "3:3", "", "the character '\\x07' is not allowed"),
    "not UTF-8": Broken(
        AREA.encode() + b"vehicle: {name: \xe9}\n", "3:17", "", "byte 0xe9 is not UTF-8", "text in UTF-8"
    ),
    "a huge file": Broken(
        b"#" * (MAXIMUM_BYTES + 1), "", "", "the file is too large", "at most 500000 bytes"
    ),
    "a file of values": Broken("a: [" + "1," * 30_000 + "]", "1:39999", "", "more than 20000 values"),
    "too few corners": Broken(
        "survey:\n  area: [[33, -118], [34, -118]]\n",
        "2:3",
        "survey.area",
        "needs at least 3 different corners (got 2)",
        "at least 3 [latitude, longitude] pairs",
    ),
    "the same corner again": Broken(
        "survey:\n  area: [[33, -118], [34, -118], [33, -118]]\n",
        "2:3",
        "survey.area",
        "needs at least 3 different corners (got 2)",
    ),
    "crossing outline": Broken(
        "survey:\n  area: [[33, -118], [34, -117], [33, -117], [34, -118]]\n",
        "2:3",
        "survey.area",
        "its outline crosses itself at [33.5, -117.5]; give the corners in order",
    ),
    "no area": Broken(
        "survey:\n  area: [[33, -118], [34, -118], [35, -118]]\n", "2:3", "survey.area", "it encloses no area"
    ),
    "wrong sign": Broken(
        "survey:\n  area: [[33, -118], [34, -118], [34, 117]]\n", "2:3", "survey.area", "spans 235 degrees"
    ),
    "swapped": Broken(
        "survey:\n  area:\n    - [33, -118]\n    - [-118, 34]\n    - [34, -117]\n",
        "4:8",
        "survey.area[1][0]",
        "must be at least -90 (got -118); each pair is [latitude, longitude], are they swapped?",
    ),
    "half a corner": Broken(
        "survey:\n  area:\n    - [33, -118]\n    - [34]\n    - [34, -117]\n",
        "4:7",
        "survey.area[1]",
        "needs 2 entries or more (got 1)",
    ),
    "altitudes": Broken(
        "survey:\n  area:\n    - [33, -118, 0]\n    - [34, -118]\n    - [34, -117]\n",
        "3:7",
        "survey.area[0]",
        "takes at most 2 entries (got 3)",
    ),
    "no such area file": Broken(
        "survey:\n  area: bay.geojson\n",
        "2:3",
        "survey.area",
        "no readable file '",
        "the name of a file that is there and may be read",
    ),
    "no such land file": Broken(AREA + "  land: coast.geojson\n", "3:3", "survey.land", "no readable file '"),
    "a number for a file": Broken(
        AREA + "  land: 3\n", "3:3", "survey.land", "must be the name of a file (got 3)", "or null"
    ),
    "range upside down": Broken(
        AREA + "sensor:\n  minimum: 40\n  maximum: 30\n",
        "4:3",
        "sensor.minimum",
        "must be below sensor.maximum (30) (got 40)",
        "sensor.minimum < sensor.maximum",
    ),
    "nothing to start from": Broken(
        AREA + "model:\n  centring_samples: 0\n",
        "4:3",
        "model.centring_samples",
        "0 needs model.hyperparameters",
        "at least 1, or model.hyperparameters given",
    ),
    "offset without log": Broken(
        AREA + "sensor:\n  transform_offset: 0.1\n",
        "4:3",
        "sensor.transform_offset",
        "is for sensor.transform log, not none",
        "0, or sensor.transform: log",
    ),
    "logit without ends": Broken(
        AREA + "sensor:\n  transform: logit\n",
        "4:3",
        "sensor.transform_bounds",
        "is for sensor.transform logit, which needs it",
        "two numbers with logit, null with the others",
    ),
    "ends without logit": Broken(
        AREA + "sensor:\n  transform: log\n  transform_bounds: [0, 40]\n",
        "5:3",
        "sensor.transform_bounds",
        "is for sensor.transform logit, which needs it",
        "two numbers with logit, null with the others",
    ),
    "ends the wrong way round": Broken(
        AREA + "sensor:\n  transform: logit\n  transform_bounds: [40, 0]\n",
        "5:3",
        "sensor.transform_bounds",
        "must be a lower and an upper end (got 40 and 0)",
        "[lower, upper], e.g. [0, 40]",
    ),
    "capacity below the minimum": Broken(
        AREA + "model:\n  capacity: 15\n",
        "4:3",
        "exploration.minimum_basis",
        "must be at most model.capacity (15) (got 20)",
        "exploration.minimum_basis <= model.capacity",
    ),
    "a minimum that a chosen capacity may miss": Broken(
        AREA + "exploration:\n  minimum_basis: 80\n",
        "4:3",
        "exploration.minimum_basis",
        "must be at most 50 while model.capacity is null (got 80)",
        "at most 50, or a model.capacity of at least as much",
    ),
    "motion from readings without times": Broken(
        AREA + "estimation:\n  data: basis\n  candidates: [matern32, static_moving]\n",
        "4:3",
        "estimation.data",
        "basis tells no times, which static_moving in estimation.candidates needs",
        "history, or candidates that do not move",
    ),
    "a kernel that does not exist": Broken(
        AREA + "estimation:\n  candidates: [matern32, matern52]\n",
        "4:26",
        "estimation.candidates[1]",
        "must be one of",
        "squared_exponential",
    ),
    "no kernel at all": Broken(
        AREA + "estimation:\n  candidates: []\n", "4:3", "estimation.candidates", "needs", "a list of some of"
    ),
    "a kernel twice": Broken(
        AREA + "estimation:\n  candidates: [ou, matern32, ou]\n",
        "4:3",
        "estimation.candidates",
        "names ou more than once",
        "each kernel once",
    ),
    "a null among the ends of a range": Broken(
        AREA + "sensor:\n  transform: logit\n  transform_bounds: [null, 1]\n",
        "5:22",
        "sensor.transform_bounds[0]",
        "must be a number (got null)",
        "a list of 2, each a number; or null",
    ),
    "a stay that looks like a stall": Broken(
        AREA + "planning:\n  hold_s: 60\n",
        "4:3",
        "planning.hold_s",
        "must be below exploration.stall_s (60) (got 60)",
        "planning.hold_s < exploration.stall_s",
    ),
    "a stay that nobody has counted": Broken(
        AREA + "planning:\n  hold_s: 20\nbudget:\n  duration_s: 3600\n",
        "4:3",
        "planning.hold_s",
        "must be 0 with budget.duration_s: what holding costs is not counted (got 20)",
        "planning.hold_s: 0, or no such limit",
    ),
    "more spots than sites": Broken(
        AREA + "planning:\n  lattice: [4, 5]\n",
        "4:3",
        "planning.spots",
        "must be below the 20 sites of planning.lattice (got 20)",
        "planning.spots < product of planning.lattice",
    ),
    "history smaller than the basis": Broken(
        AREA + "model: {capacity: 300, history_cells: 200}\n",
        "3:24",
        "model.history_cells",
        "must be at least model.capacity (300) (got 200)",
    ),
}


def write(folder: Path, text: str | bytes) -> Path:
    file = folder / "boat.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


def check(*files: Path, overrides: tuple[str, ...] = ()) -> int:
    parser = argparse.ArgumentParser()
    check_config.add_arguments(parser)
    words = [word for override in overrides for word in ("--set", override)]
    return check_config.run(parser.parse_args([*map(str, files), *words]))


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN.keys())
def test_check_config_names_place_key_fault_and_remedy(
    broken: Broken, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path, broken.text)
    assert check(file) == 78
    output = capsys.readouterr()
    place = f"{file}:{broken.place}: " if broken.place else f"{file}: "
    start = place + (f"{broken.key}: " if broken.key else "") + broken.what
    line = next((line for line in output.err.splitlines() if line.startswith(start)), None)
    assert line is not None, f"expected: {start}\n{output.err}"
    assert broken.allowed in line.partition("; allowed: ")[2]
    assert output.out == ""


def test_a_list_whose_only_entry_is_wrong_is_not_also_too_short(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert check(write(tmp_path, AREA + "estimation:\n  candidates: [static_moveing]\n")) == 78
    (line,) = capsys.readouterr().err.splitlines()
    assert "estimation.candidates[0]: must be one of" in line


def test_there_are_many_kinds_of_mistakes() -> None:
    assert len(BROKEN) >= 20


def test_every_mistake_is_told_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    file = write(
        tmp_path,
        "survey:\n  area: [[33, -118], [34, -117], [33, -117], [34, -118]]\n  standoff_m: -1\n  standof: 2\n"
        "model:\n  capacity: 100000\n  centring_samples: 0\n"
        "sensor: {minimum: 3, maximum: 2}\nexploration: {minimum_basis: 300, rho0: 0}\n"
        "planning: {spots: 30, lattice: [4, 5]}\nseed: 1\nseed: 2\n",
    )
    with pytest.raises(ConfigurationError) as caught:
        load(file, {"HALOCLINE_MODEL__NOVELTY": "2"}, ["mavlink.adopt=7"])
    assert [(problem.line, problem.column, problem.key) for problem in caught.value.problems] == [
        (2, 3, "survey.area"),
        (3, 3, "survey.standoff_m"),
        (4, 3, "survey.standof"),
        (6, 3, "model.capacity"),
        (7, 3, "model.centring_samples"),
        (8, 10, "sensor.minimum"),
        (9, 35, "exploration.rho0"),
        (10, 12, "planning.spots"),
        (12, 1, "seed"),
        (None, None, "mavlink.adopt"),
        (None, None, "model.novelty"),
    ]
    assert {problem.file for problem in caught.value.problems} == {
        str(file),
        "--set mavlink.adopt",
        "HALOCLINE_MODEL__NOVELTY",
    }


def test_a_conflict_with_a_value_that_is_itself_wrong_is_not_told(tmp_path: Path) -> None:
    file = write(tmp_path, AREA + "model:\n  capacity: 0\nexploration:\n  minimum_basis: 200\n")
    with pytest.raises(ConfigurationError) as caught:
        load(file, {})
    assert [problem.key for problem in caught.value.problems] == ["model.capacity"]


def test_a_file_of_nothing_but_mistakes_is_not_listed_to_its_end(tmp_path: Path) -> None:
    file = write(tmp_path, AREA + "".join(f"k{number}: {number}\n" for number in range(5000)))
    with pytest.raises(ConfigurationError) as caught:
        load(file, {})
    assert len(caught.value.problems) == 201
    assert str(caught.value).startswith(
        f"{file}: 4800 further mistakes are not listed\n{file}:3:1: k0: unknown"
    )


def test_good_files_are_told_and_one_bad_one_spoils_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path, AREA)
    assert check(file) == 0
    assert capsys.readouterr().out == f"{file}: ok\n"
    missing = tmp_path / "missing.yaml"
    assert check(missing, file) == 78
    output = capsys.readouterr()
    assert output.out == f"{file}: ok\n"
    warning = (
        f"{file}: warning: survey.land: no polygons of land are given: all of the survey area counts as water"
    )
    assert output.err == f"{missing}: no such file\n{warning}\n"


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=f"{tmp_path}: cannot be read: Is a directory"):
        load(tmp_path, {})


@pytest.mark.parametrize("override", ["model.capacity", "=5", ""])
def test_a_malformed_option_is_a_mistake_of_usage(override: str, tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as caught:
        check(write(tmp_path, AREA), overrides=(override,))
    assert caught.value.code == 2


def test_what_is_wrong_inside_a_geojson_file_is_told_with_the_key_that_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "coast.geojson").write_text("{}")
    file = write(tmp_path, AREA + "  land: coast.geojson\n")
    assert check(file) == 78
    error = capsys.readouterr().err
    assert error.startswith(f"{file}:3:3: survey.land: ")
    assert "GeoJSON" in error


def test_a_survey_without_water_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ring = [[-119, 32], [-119, 34], [-117, 34], [-117, 32], [-119, 32]]
    (tmp_path / "coast.geojson").write_text(f'{{"type": "Polygon", "coordinates": [{ring}]}}')
    file = write(tmp_path, AREA + "  land: coast.geojson\n")
    assert check(file) == 78
    assert capsys.readouterr().err.startswith(f"{file}:")


def test_a_tree_built_in_python_has_the_same_rules() -> None:
    corners = [(33.0, -118.0), (33.2, -118.0), (33.2, -117.8)]
    configuration = Configuration(survey=SurveySection(area=corners))
    assert configuration.survey.area == corners
    with pytest.raises(ValueError, match=r"centring_samples: 0 needs model\.hyperparameters"):
        ModelSection(centring_samples=0)
