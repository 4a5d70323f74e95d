"""Whatever is in the file: a configuration or a ConfigurationError that can be printed, nothing else."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from autonomy.config import Configuration, ConfigurationError, Problem, load
from autonomy.config.reference import keys

KEYS = [key.path for key in keys(Configuration)]
AREA = [[33.0, -118.0], [33.2, -118.0], [33.2, -117.8]]
SETTINGS = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)

scalars: st.SearchStrategy[Any] = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20), st.just(10**400)
)
values: st.SearchStrategy[Any] = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
)
snippets = st.sampled_from(
    [
        *"-[]{},:#&*!|>'\"%@`\t\n\\?",
        "survey:",
        "area",
        "model",
        "capacity:",
        ".inf",
        ".nan",
        "1e3",
        "<<:",
        "*a",
        "&a",
        "---",
    ]
)


def loads_or_complains(file: Path, content: bytes, environment: dict[str, str] | None = None) -> None:
    file.write_bytes(content)
    problems: tuple[Problem, ...] = ()
    try:
        assert isinstance(load(file, environment or {}), Configuration)
    except ConfigurationError as error:
        problems = error.problems
        assert problems, "an error without a problem"
    for problem in problems:
        assert str(problem).isprintable()


@SETTINGS
@given(st.binary(max_size=200))
@example(b'"\\UFFFFFFFF"')
@example(b'"\\ud800": "\\ud800"')
@example(b"%YAML 1.999999999999999999999999999999\n---\n")
@example(b"seed: " + b"9" * 5000)
@example(b"seed: !!int x\nmodel: !!float ''")
@example(b"? ? ? ?\n: :\n")
@example(b"\xff\xfe\x00")
@example(b"survey: {area: 'a\0b', land: 3}")
@example(b'survey: {land: "a\\0b"}')
@example(b"survey: {land: " + b"x" * 5000 + b"}")
def test_any_bytes(tmp_path: Path, content: bytes) -> None:
    loads_or_complains(tmp_path / "boat.yaml", content)


@SETTINGS
@given(st.lists(snippets | st.text(max_size=3), max_size=30))
def test_any_heap_of_yaml_tokens(tmp_path: Path, tokens: list[str]) -> None:
    loads_or_complains(tmp_path / "boat.yaml", " ".join(tokens).encode("utf-8", "surrogatepass"))


@SETTINGS
@given(st.lists(st.tuples(st.sampled_from(KEYS), values), max_size=6))
def test_any_values_at_real_keys(tmp_path: Path, entries: list[tuple[tuple[str, ...], Any]]) -> None:
    data: dict[str, Any] = {"survey": {"area": AREA}}
    for path, value in entries:
        section = data
        for part in path[:-1]:
            if not isinstance(section.get(part), dict):
                section[part] = {}
            section = section[part]
        section[path[-1]] = value
    loads_or_complains(tmp_path / "boat.yaml", yaml.safe_dump(data).encode("utf-8", "surrogatepass"))


@SETTINGS
@given(st.sampled_from(KEYS), st.text(st.characters(exclude_characters="\0", codec="utf-8"), max_size=40))
def test_any_text_in_the_environment(tmp_path: Path, path: tuple[str, ...], text: str) -> None:
    variable = "HALOCLINE_" + "__".join(path).upper()
    loads_or_complains(
        tmp_path / "boat.yaml", yaml.safe_dump({"survey": {"area": AREA}}).encode(), {variable: text}
    )


@pytest.mark.parametrize("content", [b"[" * 900_000, b"a: {" * 200_000, b"? " * 400_000, b"- " * 400_000])
def test_deep_nesting_is_refused_before_it_costs_anything(content: bytes, tmp_path: Path) -> None:
    loads_or_complains(tmp_path / "boat.yaml", content)
