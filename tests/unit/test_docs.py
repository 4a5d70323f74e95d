"""README and docs: what they name exists, what they tell people to type is understood."""

import argparse
import ast
import dataclasses
import importlib
import importlib.util
import re
import shlex
import tomllib
from collections.abc import Iterator
from functools import reduce
from pathlib import Path

import pytest
import yaml

from autonomy import cli as autonomy_cli
from autonomy import wire
from autonomy.config import load
from sim import cli as sim_cli

REPOSITORY = Path(__file__).parents[2]
PAGES = sorted([REPOSITORY / "README.md", REPOSITORY / "CHANGELOG.md", *(REPOSITORY / "docs").rglob("*.md")])
PROGRAMS = {"autonomy": autonomy_cli._VERBS, "sim": sim_cli._VERBS}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
REFERENCE = re.compile(r"`((?:autonomy|sim)/[\w/]+\.py):([\w.]+)`")
PLACE = re.compile(r"`((?:autonomy|sim|config|docs|tests|systemd)/[\w./@-]*)[`:]")


def named(pairs: list[tuple[Path, str]]) -> "pytest.MarkDecorator":
    """One case for each (page, what it says)."""
    ids = [f"{page.name}: {text.strip()[:60]}" for page, text in pairs]
    return pytest.mark.parametrize(("page", "said"), pairs, ids=ids)


def fences(language: str) -> list[tuple[Path, str]]:
    return [
        (page, body) for page in PAGES for kind, body in FENCE.findall(page.read_text()) if kind == language
    ]


def found(pattern: re.Pattern[str]) -> list[tuple[Path, str]]:
    """Every different match in the text outside code fences, one case each."""
    texts = {page: FENCE.sub("", page.read_text()) for page in PAGES}
    return [
        (page, text)
        for page in PAGES
        for text in sorted({":".join(m.groups()) for m in pattern.finditer(texts[page])})
    ]


def commands() -> Iterator[tuple[Path, str]]:
    """Lines of code fences that call one of our programs."""
    for page, body in fences(""):
        for line in body.splitlines():
            program = line.split(" ")[0].rpartition("/")[2]
            if program in PROGRAMS:
                yield page, line


def anchor(heading: str) -> str:
    """The fragment that GitHub gives to a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


@named(found(LINK))
def test_links_lead_somewhere(page: Path, said: str) -> None:
    if "://" in said:
        return
    file, _, fragment = said.partition("#")
    target = page.parent / file if file else page
    assert target.exists()
    if fragment:
        assert fragment in [
            anchor(line.lstrip("# ")) for line in target.read_text().splitlines() if "#" in line
        ]


@named(found(PLACE))
def test_files_that_are_named_exist(page: Path, said: str) -> None:
    assert (REPOSITORY / said).exists()


def test_every_room_is_in_the_table_of_rooms() -> None:
    table = (REPOSITORY / "docs" / "architecture.md").read_text()
    modules = {f"autonomy/{file.name}" for file in (REPOSITORY / "autonomy").glob("[!_]*.py")}
    assert sorted(name for name in modules if f"`{name}`" not in table) == []


@named(found(REFERENCE))
def test_functions_that_are_named_exist(page: Path, said: str) -> None:
    file, _, path = said.partition(":")
    assert (REPOSITORY / file).is_file()
    module = importlib.import_module(file.removesuffix(".py").replace("/", "."))
    assert reduce(getattr, path.split("."), module) is not None


@named(list(commands()))
def test_commands_are_understood(page: Path, said: str) -> None:
    program, verb, *words = shlex.split(said, comments=True)
    module = importlib.import_module(PROGRAMS[program.rpartition("/")[2]][verb].module)
    parser = argparse.ArgumentParser(exit_on_error=False)
    module.add_arguments(parser)
    parser.parse_args(words)


def verbs_named() -> list[tuple[Path, str]]:
    return found(re.compile(r"`((?:autonomy|sim) [a-z-]+(?: [a-z-]+)?)"))


@named(verbs_named())
def test_verbs_that_are_named_have_help(page: Path, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    program, *words = said.split(" ")
    main = {"autonomy": autonomy_cli.main, "sim": sim_cli.main}[program]
    kept = words if words[0] == "shore" else words[:1]
    with pytest.raises(SystemExit) as ended:
        main([*kept, "--help"])
    assert ended.value.code == 0
    assert "usage" in capsys.readouterr().out


@named(
    found(re.compile(r"`make (\w+)`"))
    + [(p, b) for p, t in fences("") for b in re.findall(r"^make (\w+)", t, re.M)]
)
def test_make_targets_exist(page: Path, said: str) -> None:
    assert re.search(rf"^{said}:", (REPOSITORY / "Makefile").read_text(), re.MULTILINE)


@named(fences("yaml"))
def test_configurations_are_accepted(page: Path, said: str, tmp_path: Path) -> None:
    square = '{"type": "Polygon", "coordinates": [[[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1], [0, 0]]]}'
    for name in re.findall(r"\w+\.geojson", said):
        (tmp_path / name).write_text(square)
    for name in re.findall(r"\w+\.asc", said):
        (tmp_path / name).touch()
    file = tmp_path / "boat.yaml"
    file.write_text(said)
    asked = yaml.safe_load(said)["survey"]
    assert load(file, {}).survey.standoff_m == asked["standoff_m"]


def can_be_imported(module: str, name: str) -> bool:
    """Whether `from module import name` works: it may name a module that nobody has imported yet."""
    if hasattr(importlib.import_module(module), name):
        return True
    return importlib.util.find_spec(f"{module}.{name}") is not None


@named(fences("python"))
def test_imports_of_examples_exist(page: Path, said: str) -> None:
    for node in ast.walk(ast.parse(said)):
        if isinstance(node, ast.ImportFrom):
            assert all(can_be_imported(node.module or "", name.name) for name in node.names)
        elif isinstance(node, ast.Import):
            assert all(importlib.import_module(name.name) for name in node.names)


def test_the_layers_are_those_that_are_enforced() -> None:
    text = (REPOSITORY / "docs" / "architecture.md").read_text()
    body = next(body for _, body in FENCE.findall(text) if body.startswith("cli\n"))
    told = [set(re.split(r" \| ", line.split("  ")[0])) for line in body.splitlines()]
    contracts = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(one["layers"] for one in contracts if one["type"] == "layers")
    assert told == [{name.strip().removeprefix("autonomy.") for name in layer.split("|")} for layer in layers]


def test_every_option_of_the_simulated_vessel_is_explained() -> None:
    parser = argparse.ArgumentParser(add_help=False)
    importlib.import_module("sim.vessel_cli").add_arguments(parser)
    has = {option for action in parser._actions for option in action.option_strings}
    text = (REPOSITORY / "docs" / "simulator.md").read_text()
    assert set(re.findall(r"^\| `(--[a-z-]+)", text, re.MULTILINE)) == has


@pytest.mark.parametrize("value", [wire.ModelSnapshot, wire.PlanNotice, wire.HealthNotice, wire.LogNotice])
def test_every_field_on_the_wire_is_explained(value: type) -> None:
    text = (REPOSITORY / "docs" / "wire.md").read_text()
    assert [field.name for field in dataclasses.fields(value) if f"`{field.name}`" not in text] == []


def strings_of(package: str) -> str:
    """Every piece of text in the sources, one a line."""
    trees = [ast.parse(file.read_text()) for file in (REPOSITORY / package).rglob("*.py")]
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    return "\n".join(node.value for node in nodes if isinstance(node.value, str))


def test_lines_of_the_log_are_quoted_as_they_are() -> None:
    """What is fixed in a quoted line, two words or more in a row, is found in the code."""
    text = (REPOSITORY / "docs" / "operating.md").read_text()
    table = text.partition("## 7. What the log says")[2].partition("\n## ")[0]
    rows = [line.split(" | ")[0] for line in table.splitlines() if line.startswith("| `")]
    quoted = [line for row in rows for line in re.findall(r"`([^`]+)`", row)]
    pieces = [piece.strip(" .,>") for line in quoted for piece in re.split(r"…|[:;()/]|\b[\d.]+\b", line)]
    fixed = [piece for piece in pieces if " " in piece]
    written = strings_of("autonomy")
    assert len(fixed) > 20
    assert [piece for piece in fixed if piece not in written] == []


def test_the_picture_is_small_enough_for_a_readme() -> None:
    assert (REPOSITORY / "docs" / "images" / "demo.png").stat().st_size < 400_000
