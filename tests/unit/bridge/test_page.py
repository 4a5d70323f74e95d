"""docs/bridge.md: its examples are accepted, its keys are those there are."""

import re
from pathlib import Path

import pytest

from autonomy.bridge import gate
from autonomy.bridge.condition import Condition
from autonomy.bridge.configuration import BridgeConfiguration, load_bridge
from autonomy.commands.show_config import yaml_value
from autonomy.config import load
from autonomy.config.reference import KeyReference, keys

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "bridge.md").read_text()
EXAMPLES = re.findall(r"^```yml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


def row(key: KeyReference) -> str:
    path = ".".join(key.path).replace("values.", "values.NAME.", 1)
    default = "required" if key.required else f"`{yaml_value(key.default)}`"
    return f"| `{path}` | {key.meaning} | {key.unit} | {key.allowed} | {default} |"


def test_every_key_is_in_the_table_and_no_other() -> None:
    table = PAGE.partition("## All keys")[2].splitlines()
    assert [line for line in table if line.startswith("| `")] == [
        row(key) for key in keys(BridgeConfiguration)
    ]


@pytest.mark.parametrize("example", EXAMPLES, ids=["columns", "pattern", "sentence"])
def test_examples_are_accepted(example: str, tmp_path: Path) -> None:
    file = tmp_path / "bridge.yaml"
    file.write_text(example)
    assert load_bridge(file).values


def test_the_files_of_the_desk_are_good_and_belong_together() -> None:
    bridge, service = load_bridge(DOCS / "bridge" / "desk.yaml"), load(DOCS / "bridge" / "survey.yaml", {})
    assert service.sensor.message_name in bridge.values
    assert service.sensor.clock == "vehicle"


def test_whatever_it_says_of_itself_is_explained() -> None:
    told = [each.value for each in Condition if each not in (Condition.WITHHOLDING, Condition.STARTING)]
    told += [gate.WARMING_UP, gate.FLUSHING, gate.PUMP_OFF, gate.PUMP_UNKNOWN]
    assert [each for each in told if f"`{each}`" not in PAGE] == []
