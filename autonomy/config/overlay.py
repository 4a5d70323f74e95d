"""Values that the environment and the command line lay over a configuration file."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel

from autonomy.config.file import Document, KeyPath, parse_value
from autonomy.config.problems import ConfigurationError, Origin, Problem, Source
from autonomy.config.reference import field_at, section_of

PREFIX = "HALOCLINE_"


def apply_environment(document: Document, environment: Mapping[str, str], model: type[BaseModel]) -> None:
    """Lay variables such as HALOCLINE_MODEL__CAPACITY=50 over the document; mistakes go to its problems.

    A variable is meant for us if its first word is a key of the tree or if it has a double underscore; other
    variables with our prefix belong to somebody else.
    """
    for variable in sorted(environment):
        if not variable.startswith(PREFIX):
            continue
        path = tuple(variable.removeprefix(PREFIX).lower().split("__"))
        if len(path) > 1 or path[0] in model.model_fields:
            _lay(document, path, environment[variable], Origin(Source.ENVIRONMENT, variable), model)


def apply_overrides(document: Document, overrides: Sequence[str], model: type[BaseModel]) -> None:
    """Lay options such as `model.capacity=50` over the document; mistakes go to its problems."""
    for override in overrides:
        key, equals, text = override.partition("=")
        origin = Origin(Source.COMMAND_LINE, f"--set {key.strip()}")
        if not equals or not key.strip():
            document.problems.append(Problem(origin, "", "has no value", "--set SECTION.KEY=VALUE"))
            continue
        _lay(document, tuple(key.strip().split(".")), text, origin, model)


def _lay(
    document: Document, path: tuple[str, ...], text: str, origin: Origin, model: type[BaseModel]
) -> None:
    try:
        value = parse_value(text, origin, ".".join(path))
    except ConfigurationError as error:
        document.problems.extend(error.problems)
        return
    field = field_at(model, path)
    if field is not None and field.annotation is str and not isinstance(value, str):
        value = text  # a shell eats the quotes that would have made it text
    _put(document, path, value, origin, model)


def _put(
    document: Document, path: tuple[str, ...], value: Any, origin: Origin, model: type[BaseModel]
) -> None:
    if isinstance(value, dict) and value:
        # A mapping given for a section overrides key by key, as a file's section does.
        for name, inner in value.items():
            _put(document, (*path, name), inner, origin, model)
        return
    parent = document.data
    for depth, part in enumerate(path[:-1], start=1):
        field = field_at(model, path[:depth])
        if field is not None and section_of(field) is None:
            what = f"{'.'.join(path[:depth])} is a value, not a section"
            document.problems.append(Problem(origin, ".".join(path), what))
            return
        if parent.get(part) is None:
            parent[part] = {}
            document.origins.setdefault(path[:depth], origin)
        parent = parent[part]
        if not isinstance(parent, dict):
            return  # the file's own mistake, reported where it stands
    parent[path[-1]] = value
    _forget_below(document, path)
    document.origins[path] = origin


def _forget_below(document: Document, path: KeyPath) -> None:
    for known in [known for known in document.origins if known[: len(path)] == path]:
        del document.origins[known]
