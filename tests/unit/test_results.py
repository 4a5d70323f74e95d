"""The page of results and README: every figure has its command beside it, and its commit."""

import re
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PAGE = REPOSITORY / "docs" / "results.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^(?:\S*/)?(make [\w-]+|(?:sim|autonomy) \w.*)", re.MULTILINE)
COMMIT = re.compile(r"commit `([0-9a-f]{7,40})`")
TABLE = re.compile(r"^\|[ :-]*-[|: -]*\|$", re.MULTILINE)
PICTURE = re.compile(r"^!\[", re.MULTILINE)


def sections(text: str) -> list[str]:
    """The parts of a page, each with its heading, cut at headings of the second level."""
    return [part for part in re.split(r"^(?=## )", text, flags=re.MULTILINE) if part.startswith("##")]


def shown(section: str) -> list[int]:
    """Where tables and pictures begin."""
    return sorted(found.start() for what in (TABLE, PICTURE) for found in what.finditer(section))


def lacking(section: str) -> list[str]:
    """What a section that shows something has not named before it."""
    places = shown(section)
    if not places:
        return []
    before = section[: places[0]]
    has_command = any(COMMAND.search(body) for kind, body in FENCE.findall(before) if not kind)
    return [
        what for what, named in (("command", has_command), ("commit", COMMIT.search(before))) if not named
    ]


RESULTS = sections(PAGE.read_text())


@pytest.mark.parametrize("section", RESULTS, ids=[section.splitlines()[0] for section in RESULTS])
def test_what_a_section_shows_has_its_command_and_commit_above_it(section: str) -> None:
    assert lacking(section) == []


@pytest.mark.parametrize(
    ("section", "missing"),
    [
        ("## A\n\n```\nmake bench\n```\n\nAt commit `0123abc`:\n\n| a | b |\n|---|---|\n", []),
        ("## A\n\nAt commit `0123abc`:\n\n| a | b |\n| --- | --: |\n", ["command"]),
        ("## A\n\n```\nsim experiment paper --seed 1\n```\n\n![map](a.png)\n", ["commit"]),
        ("## A\n\n| a |\n|---|\n\n```\nmake bench\n```\n\nAt commit `0123abc`.\n", ["command", "commit"]),
        ("## A\n\nNothing is shown.\n", []),
    ],
)
def test_this_reader_of_pages_finds_what_is_missing(section: str, missing: list[str]) -> None:
    assert lacking(section) == missing


def test_commits_exist() -> None:
    """Where there is a checkout with its history."""
    named = COMMIT.findall(PAGE.read_text())

    def git(*words: str) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            ["git", "-C", str(REPOSITORY), *words], capture_output=True, text=True, check=False
        )

    if git("rev-parse", "--is-shallow-repository").stdout.strip() != "false":
        pytest.skip("no history here")
    assert [one for one in named if git("cat-file", "-e", f"{one}^{{commit}}").returncode] == []


def test_figures_of_the_readme_follow_the_command_that_prints_them() -> None:
    """A fence that is no command shows what one has printed: it is named in the paragraph above it."""
    text = (REPOSITORY / "README.md").read_text()
    for found in FENCE.finditer(text):
        if found[1] or COMMAND.search(found[2]) or not re.search(r"\d\.\d", found[2]):
            continue
        above = text[: found.start()].rstrip().rpartition("\n## ")[2]
        assert re.search(r"`(make|sim|autonomy) [\w-]+", above), found[2]
