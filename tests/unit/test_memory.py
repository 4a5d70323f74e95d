"""What the core remembers, and what it does not: nothing that the configuration says."""

import math
from typing import Any

import pytest
import shapely

from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.geometry import LocalFrame
from autonomy.memory import UnfitMemoryError, capture, restore
from autonomy.planning.survey import SurveyArea

AREA = {"survey": {"area": [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]}}
SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0, 0, 3000, 2000), passage_cells=20)
FOR_A_NEW_BEGINNING = {"vehicle", "survey", "sensor", "model"}
"""Sections that a checkpoint has to fit."""


def remembered(sections: dict[str, Any]) -> dict[str, str]:
    memory = capture(Core(Configuration.model_validate({**AREA, **sections}), SURVEY))
    found: dict[str, str] = {}

    def look(node: Any, path: str) -> None:
        if isinstance(node, list) and node[:1] == ["object"]:
            for name, part in zip(memory["classes"][node[1]][1], node[2:], strict=True):
                look(part, f"{path}.{name}")
        else:
            found[path] = repr(node)

    look(memory["root"], "core")
    return found


def other(value: Any) -> list[Any]:
    """Values unlike this one, one of which the key may take."""
    if isinstance(value, bool):
        return [not value]
    return [*(n for n in (7, 0.5, 3.5, 40.0, 70.0) if n != value), None, "observe", "never", "hold", "basis"]


def changed() -> list[Any]:
    """Sections with one key changed."""
    found = []
    for section, values in Configuration.model_validate(AREA).model_dump().items():
        if section in FOR_A_NEW_BEGINNING or not isinstance(values, dict):
            continue
        for key, value in values.items():
            for candidate in other(value):
                try:
                    Configuration.model_validate({**AREA, section: {key: candidate}})
                except ValueError:
                    continue
                found.append(pytest.param({section: {key: candidate}}, id=f"{section}.{key}"))
                break
    return found


@pytest.mark.parametrize("sections", changed())
def test_no_setting_is_remembered(sections: dict[str, Any]) -> None:
    """Or a changed configuration would not be heeded after a restart: name the attribute in `memory.SETTINGS`."""
    before, after = remembered({}), remembered(sections)
    differ = {path for path in before.keys() | after.keys() if before.get(path) != after.get(path)}
    # See Core.restore; and what was collected at one lag goes on at it.
    lag = {f"core._course._reporter._learner.roughness.{name}" for name in ("_steps", "_track", "_reach_m")}
    assert differ <= {"core._course._headway._authority.command", *lag}


def test_what_can_not_be_remembered_is_told() -> None:
    with pytest.raises(TypeError, match=r"builtins\.function can't be remembered"):
        capture(lambda: math.inf)
    core = Core(Configuration.model_validate(AREA), SURVEY)
    with pytest.raises(UnfitMemoryError, match="not about a Core"):
        restore({"classes": [], "root": ["list"]}, core)
