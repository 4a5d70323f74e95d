"""docs/states.md has every state, reason and word to the operator; the parameters' page all that preflight looks at."""

import ast
import itertools
import re
from pathlib import Path
from typing import get_args

import pytest

from autonomy.exploration import Trigger
from autonomy.mavlink import authority_table, safeguards
from autonomy.mavlink.authority import OnBoard
from autonomy.situation import State, Wish

REPOSITORY = Path(__file__).parents[2]
DOCS = REPOSITORY / "docs"
STATES = re.sub(r"`", "", (DOCS / "states.md").read_text())
PARAMETERS = (DOCS / "autopilot-parameters.md").read_text()
FEWEST_WORDS = 2


def reasons() -> set[str]:
    """How the authority's tables say why, under every configuration; what is filled in is in braces."""
    settings = itertools.product(get_args(authority_table.Mode), get_args(authority_table.Resume))
    return {rule.reason for setting in settings for rule in authority_table.table_of(*setting).values()}


def fixed(text: str) -> list[str]:
    """What is never filled in, two words or more in a row."""
    pieces = [piece.strip(" ,:()") for piece in re.split(r"\{[^}]*\}", text)]
    return [piece for piece in pieces if len(piece.split()) >= FEWEST_WORDS]


def texts_of(*modules: str) -> list[str]:
    """Every piece of text in some modules, f-strings with … for what is filled in."""
    found = []
    for module in modules:
        tree = ast.parse((REPOSITORY / module).read_text())
        inside = {
            id(part) for node in ast.walk(tree) if isinstance(node, ast.JoinedStr) for part in node.values
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.JoinedStr):
                parts = [part.value if isinstance(part, ast.Constant) else "{}" for part in node.values]
                found.append("".join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside:
                found.append(node.value)
    return found


def test_every_state_is_in_its_table() -> None:
    table = STATES.partition("## States")[2].partition("\n## ")[0]
    assert re.findall(r"^\| ([a-z ]+) \|", table, re.MULTILINE) != []
    missing = [state.value for state in State if f"\n| {state.value} |" not in table]
    assert missing == []


@pytest.mark.parametrize("reason", sorted(reasons()))
def test_every_reason_of_the_authority_is_explained(reason: str) -> None:
    assert [piece for piece in fixed(reason) if piece not in STATES] == []


@pytest.mark.parametrize("kind", [OnBoard, Trigger, Wish])
def test_every_word_for_a_person_is_explained(kind: type) -> None:
    assert [each.value for each in kind if each.value not in STATES] == []  # type: ignore[attr-defined]


def test_every_hindrance_is_explained() -> None:
    told = [
        text for text in texts_of("autonomy/situation.py") if text.startswith((", but", "the ", "nothing"))
    ]
    assert len(told) > 2
    missing = [piece for text in told for piece in fixed(text.removeprefix(", but ")) if piece not in STATES]
    assert missing == []


def test_every_word_to_the_operator_is_explained() -> None:
    """What begins with our name is a STATUSTEXT; what is filled in may be a reason, which is explained elsewhere."""
    lines = [
        text
        for text in texts_of("autonomy/core.py", "autonomy/directives.py")
        if text.startswith("halocline: ")
    ]
    lines += [text for text in texts_of("autonomy/course.py") if re.match(r"(LAND|land) ahead", text)]
    lines += re.findall(
        r'self\._warn\([^"]*"[^"]*", "([^"]*)"\)', (REPOSITORY / "autonomy/wishes.py").read_text()
    )
    lines += [text for text in texts_of("autonomy/handback.py") if text.startswith("LAND")]
    assert len(lines) > 5
    starts = [text.partition("{}")[0].removeprefix("halocline: ").strip() for text in lines]
    table = STATES.partition("## At the ground station")[2].partition("\n## ")[0]
    assert [start for start in starts if start not in table] == []


def test_every_failsafe_that_preflight_reads_is_marked() -> None:
    marked = set(re.findall(r"`(\w+)` ✓", PARAMETERS))
    assert marked == set(safeguards._OFF)
    assert [name for name in safeguards.NAMES if name not in PARAMETERS and name != "FENCE_TOTAL"] == []


def test_every_page_is_in_the_contents() -> None:
    contents = (DOCS / "index.md").read_text()
    linked = {name.partition("#")[0] for name in re.findall(r"\]\(([^)\s]+)\)", contents)}
    pages = {str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md")} - {"index.md"}
    assert pages - linked == set()
