"""What a tree of pydantic models says about its keys: meaning, unit, allowed values, defaults."""

import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from autonomy.config.types import FOLDER, SECRET

_UNITS = {"_mps": "m/s", "_hz": "Hz", "_deg": "degrees", "_s": "s", "_m": "m"}
_KINDS: dict[Any, str] = {int: "a whole number", float: "a number", str: "text", Path: "the name of a file"}


@dataclass(frozen=True)
class KeyReference:
    """One key: its path, meaning, unit (may be empty), allowed values, and default (`required` if none)."""

    path: tuple[str, ...]
    meaning: str
    unit: str
    allowed: str
    default: Any
    required: bool


def keys(model: type[BaseModel], path: tuple[str, ...] = ()) -> Iterator[KeyReference]:
    """Every key that holds a value, in the order of the tree; an optional section comes before its keys."""
    for name, field in model.model_fields.items():
        section = section_of(field)
        here = (*path, name)
        if section is None or _is_optional(field):
            default = None if field.is_required() else field.get_default(call_default_factory=True)
            meaning = field.description or ""
            yield KeyReference(here, meaning, unit(field, name), allowed(field), default, field.is_required())
        if section is not None:
            yield from keys(section, here)


def field_at(model: type[BaseModel], path: tuple[str | int, ...]) -> FieldInfo | None:
    """The field at this path of names; None if the tree has no such key."""
    field: FieldInfo | None = None
    named = False
    for part in path:
        if not isinstance(part, str):
            return field
        if field is not None and not named and get_origin(field.annotation) is dict:
            named = True  # a mapping of sections: its own keys are names that people choose
            continue
        named = False
        section: type[BaseModel] | None = model if field is None else section_of(field)
        field = section.model_fields.get(part) if section is not None else None
        if field is None:
            return None
    return field


def section_of(field: FieldInfo) -> type[BaseModel] | None:
    """The model behind a field that is a section, or may be one; None for a value."""
    for candidate in (field.annotation, *get_args(field.annotation)):
        if isinstance(candidate, type) and issubclass(candidate, BaseModel):
            return candidate
    return None


def holds_file(field: FieldInfo) -> bool:
    """Whether text at this key is the name of a file or folder."""
    return Path in set(_leaves(field.annotation))


def holds_folder(field: FieldInfo) -> bool:
    """Whether text at this key is the name of a folder, which need not be there yet."""
    return FOLDER in [*field.metadata, *_leaves(field.annotation)]


def holds_secret(field: FieldInfo) -> bool:
    """Whether text at this key is the name of a file that only its owner may read."""
    return SECRET in [*field.metadata, *_leaves(field.annotation)]


def unit(field: FieldInfo, name: str) -> str:
    """The unit: said by the field itself, or by the suffix of its name; empty for none."""
    extra = field.json_schema_extra
    if isinstance(extra, dict) and "unit" in extra:
        return str(extra["unit"])
    return next((unit for suffix, unit in _UNITS.items() if name.endswith(suffix)), "")


def allowed(field: FieldInfo) -> str:
    """What may stand at this key, in words."""
    extra = field.json_schema_extra
    if isinstance(extra, dict) and "allowed" in extra:
        return str(extra["allowed"])
    return _describe(field.annotation, field.metadata)


def _leaves(annotation: Any) -> Iterator[Any]:
    arguments = get_args(annotation)
    yield annotation
    for argument in arguments:
        yield from _leaves(argument)


def _is_optional(field: FieldInfo) -> bool:
    return type(None) in get_args(field.annotation)


def _describe(annotation: Any, metadata: list[Any]) -> str:
    if get_origin(annotation) is Annotated:
        inner, *extra = get_args(annotation)
        return _describe(inner, [*metadata, *_flat(extra)])
    if get_origin(annotation) is Literal:
        return "one of " + ", ".join(map(str, get_args(annotation)))
    if get_origin(annotation) in (Union, types.UnionType):
        words = [_describe(choice, metadata) for choice in get_args(annotation) if choice is not type(None)]
        # "a list of 2, each a number or null" would allow a null in the list.
        return ("; or " if any(", " in word for word in words) else " or ").join([*words, "null"])
    if get_origin(annotation) is tuple:
        sides = [_describe(side, []) for side in get_args(annotation)]
        return f"a list of {len(sides)}, each {sides[0]}"
    if annotation is bool:
        return "true or false"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return "a mapping with the keys " + ", ".join(annotation.model_fields)
    return f"{_KINDS.get(annotation, 'a value')} {_range(metadata)}".strip()


def _flat(metadata: list[Any]) -> Iterator[Any]:
    for item in metadata:
        if isinstance(item, FieldInfo):
            yield from item.metadata
        else:
            yield item


def _range(metadata: list[Any]) -> str:
    limits = {
        name: getattr(item, name)
        for item in metadata
        for name in ("ge", "gt", "le", "lt")
        if hasattr(item, name)
    }
    limits = {name: limit for name, limit in limits.items() if limit is not None}
    if {"ge", "le"} <= limits.keys():
        return f"from {limits['ge']} to {limits['le']}"
    words = {"ge": "of at least", "gt": "above", "le": "at most", "lt": "below"}
    return " and ".join(f"{words[name]} {limit}" for name, limit in limits.items())
