"""YAML files as plain values in which the place of every key is known.

A dialect of YAML with fewer surprises: no aliases (so no file that grows without bound when read), no tags,
no dates, no octal or base-60 numbers; `1e-3` is a number.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from autonomy.config.problems import ConfigurationError, Origin, Problem, Source, printable

KeyPath = tuple[str | int, ...]

MAXIMUM_BYTES = 500_000
MAXIMUM_VALUES = 20_000
"""Keys, lists and mappings counted as well; PyYAML takes a second for so many."""

MAXIMUM_DEPTH = 16

_TAG = "tag:yaml.org,2002:"
_WORDS = {"yes": True, "true": True, "on": True, "no": False, "false": False, "off": False}


class _Refused(yaml.MarkedYAMLError):
    """YAML, but of a kind that has no place in a configuration."""


class _Composer(yaml.BaseLoader):
    """PyYAML's scanner and parser with the resolvers below; limits what a hostile file can cost."""

    depth = 0
    values = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        mark: Any = event.start_mark
        if self.check_event(yaml.AliasEvent):
            what = "aliases (*) are not supported: write the value again"
            raise _Refused(None, None, what, mark)
        if self.depth >= MAXIMUM_DEPTH:
            what = f"nested more than {MAXIMUM_DEPTH} levels deep"
            raise _Refused(None, None, what, mark)
        self.values += 1
        if self.values > MAXIMUM_VALUES:
            what = f"more than {MAXIMUM_VALUES} values; large polygons belong into GeoJSON files"
            raise _Refused(None, None, what, mark)
        self.depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self.depth -= 1


_EXPONENT = r"[eE][-+]?[0-9]+"
_FLOAT = rf"[-+]?(?:[0-9][0-9_]*\.[0-9_]*(?:{_EXPONENT})?|\.[0-9][0-9_]*(?:{_EXPONENT})?|[0-9]+{_EXPONENT})"
for _name, _pattern, _first in (
    ("null", r"~|null|Null|NULL|", ["~", "n", "N", ""]),
    ("bool", r"(?i:yes|no|true|false|on|off)", list("yYnNtTfFoO")),
    ("int", r"[-+]?(?:0|[1-9][0-9_]*)", list("-+0123456789")),
    ("float", rf"{_FLOAT}|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)", list("-+.0123456789")),
):
    _Composer.add_implicit_resolver(_TAG + _name, re.compile(rf"(?:{_pattern})\Z"), _first)


@dataclass
class Document:
    """What a file says.

    Attributes:
        file: the file's name as it was given.
        data: nested dictionaries, lists and scalars.
        origins: the place of every key and list entry, by its path.
        problems: mistakes that did not keep the rest from being read (keys given twice, …).
    """

    file: str
    data: dict[str, Any] = field(default_factory=dict)
    origins: dict[KeyPath, Origin] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)


def read_document(path: Path | str) -> Document:
    """Read a YAML file whose top level is a mapping.

    Raises:
        ConfigurationError: the file can't be read, is too large, not UTF-8, not YAML, or holds no mapping.
    """
    name = str(path)
    document = Document(name)
    text = _read_text(Path(path), name)
    node = _compose(text, name)
    if node is None:
        raise ConfigurationError(
            [Problem(Origin(Source.FILE, name, 1, 1), "", "the file is empty", "at least survey.area")]
        )
    data = _value(node, (), document)
    if not isinstance(data, dict):
        origin = _origin(name, node.start_mark)
        raise ConfigurationError(
            [
                Problem(
                    origin,
                    "",
                    f"must be a mapping of sections (got {shown(data)})",
                    "SECTION: {KEY: VALUE, …}",
                )
            ]
        )
    document.data = data
    return document


def parse_value(text: str, origin: Origin, key: str) -> Any:
    """A value from an environment variable or an option, written as YAML (`50`, `[12, 12]`, `null`).

    Raises:
        ConfigurationError: it is not YAML; the problem names `origin`.
    """
    try:
        node = _compose(text, "")
        document = Document("")
        value = None if node is None else _value(node, (), document)
        problems = document.problems
    except ConfigurationError as error:
        problems = list(error.problems)
    if problems:
        raise ConfigurationError(
            [Problem(origin, key, problem.what, problem.allowed) for problem in problems]
        )
    return value


def shown(value: object) -> str:
    """The value as a message shows it: short, on one line."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, int) and abs(value) >= 10**40:
        return "a huge number"
    text = ascii(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _read_text(path: Path, name: str) -> str:
    whole = Origin(Source.FILE, name)
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAXIMUM_BYTES + 1)
    except FileNotFoundError:
        raise ConfigurationError([Problem(whole, "", "no such file")]) from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise ConfigurationError([Problem(whole, "", f"cannot be read: {reason}")]) from None
    if len(raw) > MAXIMUM_BYTES:
        allowed = f"at most {MAXIMUM_BYTES} bytes; large polygons belong into GeoJSON files"
        raise ConfigurationError([Problem(whole, "", "the file is too large", allowed)])
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start].decode("utf-8", errors="replace")
        origin = _place(name, before, len(before))
        what = f"byte 0x{raw[error.start]:02x} is not UTF-8"
        raise ConfigurationError([Problem(origin, "", what, "text in UTF-8")]) from None


def _compose(text: str, name: str) -> Any:
    loader: _Composer | None = None
    try:
        loader = _Composer(text)
        return loader.get_single_node()
    except yaml.reader.ReaderError as error:
        what = f"the character {chr(error.character)!a} is not allowed in YAML"
        problem = Problem(_place(name, text, error.position), "", what)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        problem = Problem(_origin(name, mark), "", *_syntax_message(error, text, mark))
    except (ValueError, OverflowError) as error:
        # PyYAML lets these escape for impossible escapes and version numbers.
        assert loader is not None
        problem = Problem(_origin(name, loader.get_mark()), "", f"not YAML: {printable(str(error))}")
    raise ConfigurationError([problem])


def _syntax_message(error: yaml.MarkedYAMLError, text: str, mark: Any) -> tuple[str, str]:
    if isinstance(error, _Refused):
        return str(error.problem), ""
    if mark is not None and text[mark.index : mark.index + 1] == "\t":
        return "a tab here", "YAML indents with spaces"
    if (
        error.problem and "another document" in error.problem
    ) or error.context == "expected a single document in the stream":
        return "a second document starts here (---)", "one document"
    context = f" {error.context}" if error.context else ""
    return f"not YAML: {printable(error.problem or 'unreadable')}{printable(context)}", ""


def _origin(name: str, mark: Any) -> Origin:
    if mark is None:
        return Origin(Source.FILE, name)
    return Origin(Source.FILE, name, mark.line + 1, mark.column + 1)


def _place(name: str, text: str, index: int) -> Origin:
    before = text[:index]
    return Origin(Source.FILE, name, before.count("\n") + 1, index - (before.rfind("\n") + 1) + 1)


def _value(node: yaml.Node, path: KeyPath, document: Document) -> Any:
    if isinstance(node, yaml.MappingNode) and node.tag == _TAG + "map":
        return _mapping(node, path, document)
    if isinstance(node, yaml.SequenceNode) and node.tag == _TAG + "seq":
        for index, item in enumerate(node.value):
            document.origins[*path, index] = _origin(document.file, item.start_mark)
        return [_value(item, (*path, index), document) for index, item in enumerate(node.value)]
    if isinstance(node, yaml.ScalarNode):
        try:
            return _scalar(node.tag, node.value)
        except ValueError:
            what = f"not a value of the kind {printable(node.tag.removeprefix(_TAG))}"
            document.problems.append(Problem(_origin(document.file, node.start_mark), dotted(path), what))
            return None
    what = f"the tag {printable(node.tag)} is not allowed"
    document.problems.append(
        Problem(_origin(document.file, node.start_mark), dotted(path), what, "plain values")
    )
    return None


def _mapping(node: yaml.MappingNode, path: KeyPath, document: Document) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for key_node, value_node in node.value:
        origin = _origin(document.file, key_node.start_mark)
        if not isinstance(key_node, yaml.ScalarNode):
            document.problems.append(
                Problem(origin, dotted(path), "a key must be a word, not a list or a mapping")
            )
            continue
        here = (*path, key_node.value)
        if key_node.value in mapping:
            first = document.origins[here]
            what = f"given twice (first in line {first.line})"
            document.problems.append(Problem(origin, dotted(here), what, "each key once"))
            continue
        document.origins[here] = origin
        mapping[key_node.value] = _value(value_node, here, document)
    return mapping


def _scalar(tag: str, text: str) -> str | int | float | bool | None:
    match tag.removeprefix(_TAG):
        case "str":
            return text
        case "null":
            return None
        case "bool" if text.lower() in _WORDS:
            return _WORDS[text.lower()]
        case "int":
            return int(text.replace("_", ""))
        case "float":
            return float(re.sub(r"^([-+]?)\.(inf|nan)$", r"\1\2", text.lower()).replace("_", ""))
    raise ValueError(tag)


def dotted(path: KeyPath) -> str:
    """`("survey", "area", 2)` as people write it: `survey.area[2]`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text
