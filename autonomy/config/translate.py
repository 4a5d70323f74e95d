"""pydantic's findings as problems that say where, which key, what is wrong and what would be right."""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from autonomy.config.file import Document, KeyPath, dotted, shown
from autonomy.config.problems import Origin, Problem, Source
from autonomy.config.reference import allowed, field_at, keys, section_of

_MUST = {
    "greater_than": "must be above {gt}",
    "greater_than_equal": "must be at least {ge}",
    "less_than": "must be below {lt}",
    "less_than_equal": "must be at most {le}",
    "finite_number": "must be a finite number",
    "int_type": "must be a whole number",
    "float_type": "must be a number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "string_unicode": "must be text",
    "path_type": "must be the name of a file",
    "list_type": "must be a list",
    "tuple_type": "must be a list",
    "model_type": "must be a mapping of keys",
    "dict_type": "must be a mapping of keys",
    "literal_error": "must be one of {expected}",
    "string_too_short": "must not be empty",
    "string_pattern_mismatch": "not allowed here",
}
# The tags of `survey.area`'s two forms turn up in pydantic's locations; they are no keys.
_TAGS = ("corners", "file")


@dataclass(frozen=True)
class Finding:
    """A problem and the paths of all the keys that take part in it."""

    paths: tuple[KeyPath, ...]
    problem: Problem


def translate(error: ValidationError, document: Document, model: type[BaseModel]) -> Iterator[Finding]:
    """Every problem with the paths of its keys; a missing key is placed at its nearest parent."""
    for finding in error.errors(include_url=False):
        path = tuple(part for part in finding["loc"] if part not in _TAGS)
        if is_consequence(finding):
            continue
        if finding["type"] == "conflict":
            yield from _conflicts(path, finding["ctx"]["conflicts"], document)
        elif finding["type"] == "missing" and path and isinstance(path[-1], int):
            what = f"needs {path[-1] + 1} entries or more (got {path[-1]})"
            yield Finding((path[:-1],), _problem(path[:-1], what, document, model))
        elif finding["type"] == "extra_forbidden":
            yield Finding((path,), _unknown_key(path, document, model))
        else:
            yield Finding((path,), _problem(path, _what(finding, path), document, model))


def is_consequence(finding: ErrorDetails) -> bool:
    """Whether a list is only too short for pydantic, which has left out the entries that are wrong in themselves."""
    if finding["type"] != "too_short" or not isinstance(finding["input"], list | tuple):
        return False
    return len(finding["input"]) >= int(finding["ctx"]["min_length"])


def origin_at(path: KeyPath, document: Document) -> Origin:
    """Where the key stands: itself, else the first thing below it, else its nearest parent, else the file."""
    if path in document.origins:
        return document.origins[path]
    below = [origin for known, origin in document.origins.items() if path and known[: len(path)] == path]
    if below:
        return below[0]
    for length in range(len(path) - 1, 0, -1):
        if path[:length] in document.origins:
            return document.origins[path[:length]]
    return Origin(Source.FILE, document.file, 1, 1)


def _conflicts(section: KeyPath, conflicts: Any, document: Document) -> Iterator[Finding]:
    for conflict in conflicts:
        paths = [(*section, *key.split(".")) for key in conflict.keys]
        # The key that somebody wrote is the one to point at, even if the check is named after the other.
        placed = next((path for path in paths if path in document.origins), paths[0])
        problem = Problem(origin_at(placed, document), dotted(paths[0]), conflict.what, conflict.allowed)
        yield Finding(tuple(paths), problem)


def _problem(path: KeyPath, what: str, document: Document, model: type[BaseModel]) -> Problem:
    field = field_at(model, path)
    return Problem(origin_at(path, document), dotted(path), what, allowed(field) if field else "")


def _what(finding: ErrorDetails, path: KeyPath) -> str:
    kind, context, value = finding["type"], finding.get("ctx", {}), finding["input"]
    if kind == "missing":
        return "is missing"
    if kind == "too_short":
        return f"needs at least {context['min_length']} entries (got {context['actual_length']})"
    if kind == "too_long":
        return f"takes at most {context['max_length']} entries (got {context['actual_length']})"
    if kind not in _MUST:
        return finding["msg"]
    what = f"{_MUST[kind].format_map(_Readable(context))} (got {shown(value)})"
    return what + _hint(kind, path, value)


def _hint(kind: str, path: KeyPath, value: Any) -> str:
    if kind == "string_type" and isinstance(value, int | float):
        return "; put it into quotes"
    if (
        kind == "float_type"
        and isinstance(value, str)
        and value.replace(",", ".", 1).replace(".", "", 1).isdigit()
    ):
        return "; without quotes and with a decimal point"
    latitude = len(path) == 4 and path[:2] == ("survey", "area") and path[3] == 0
    if latitude and kind in ("greater_than_equal", "less_than_equal") and abs(value) <= 360:
        return "; each pair is [latitude, longitude], are they swapped?"
    return ""


class _Readable(dict[str, Any]):
    """Limits without the trailing .0 that pydantic gives them."""

    def __init__(self, context: Mapping[str, Any]) -> None:
        super().__init__(context)

    def __getitem__(self, name: str) -> Any:
        value = super().__getitem__(name)
        return int(value) if isinstance(value, float) and value.is_integer() else value


def _unknown_key(path: KeyPath, document: Document, model: type[BaseModel]) -> Problem:
    parent = field_at(model, path[:-1]) if len(path) > 1 else None
    section = model if parent is None else section_of(parent)
    names = list(section.model_fields) if section else []
    name = str(path[-1])
    what = "unknown key"
    near = difflib.get_close_matches(name, names, n=1) or _elsewhere(name, model)
    if near:
        what += f"; did you mean {near[0]}?"
    return Problem(origin_at(path, document), dotted(path), what, ", ".join(names))


def _elsewhere(name: str, model: type[BaseModel]) -> list[str]:
    """The dotted key that has this name in another section."""
    return [dotted(reference.path) for reference in keys(model) if reference.path[-1] == name]
