"""The text of a first configuration: what was answered, and the keys that most boats change, each with its meaning."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from autonomy.commands.show_config import yaml_value
from autonomy.config import Configuration
from autonomy.config.reference import KeyReference, keys, section_of

_SHOWN = (
    "vehicle.name",
    "mavlink.endpoint",
    "mavlink.system_id",
    "mavlink.adopt",
    "mavlink.signing.key_file",
    "authority.mode",
    "authority.return_battery",
    "authority.fence_margin_m",
    "sensor.message_name",
    "sensor.variable",
    "sensor.units",
    "sensor.minimum",
    "sensor.maximum",
    "survey.area",
    "survey.keep_in",
    "survey.keep_out",
    "survey.land",
    "survey.depth",
    "survey.minimum_depth_m",
    "survey.standoff_m",
    "sampling.spacing_m",
    "sampling.minimum_speed_mps",
    "planning.planner",
    "budget.distance_m",
    "budget.duration_s",
    "budget.energy_wh",
    "budget.consumption_j_per_m",
    "budget.speed_mps",
    "budget.home",
    "shore.connect",
    "shore.model_period_s",
    "shore.tls.root_ca",
    "shore.tls.certificate",
    "shore.tls.private_key",
    "logging.level",
)
"""Keys of a starter, in their order; those that were not answered are there as comments, with their defaults."""

_WIDTH = 100
_HEAD = """\
A first configuration. What begins with "# " and a key is a default: take the # away to change it.

  autonomy check-config {file}          is it right?
  autonomy preflight --config {file}    is everything there, before the boat leaves?
  autonomy show-config {file}           what is in force, and why

All keys are in docs/configuration.md. Names of files are relative to this file.
"""


def starter_text(file: str, values: Mapping[tuple[str, str], Any]) -> str:
    """The file's content.

    Args:
        file: its name, for the comments.
        values: what was answered, by section and key; None leaves the default.
    """
    known = {".".join(key.path): key for key in keys(Configuration)}
    answered = {".".join(path): value for path, value in values.items() if value is not None}
    lines = list(_comment(_HEAD.format(file=file)))
    open_section: tuple[str, ...] = ()
    for name in _SHOWN:
        path = known[name].path
        lines += _sections(open_section, path[:-1], answered)
        open_section = path[:-1]
        lines += _key(known[name], answered)
    return "\n".join(lines) + "\n"


def _sections(before: tuple[str, ...], here: tuple[str, ...], answered: Mapping[str, Any]) -> Iterator[str]:
    """Headings of the sections that begin; one without an answer is empty, which means its defaults."""
    for depth in range(len(here)):
        if before[: depth + 1] == here[: depth + 1]:
            continue
        indent = "  " * depth
        if depth == 0:
            yield ""
            section = section_of(Configuration.model_fields[here[0]])
            yield from _comment((section.__doc__ or "").split("\n")[0] if section is not None else "")
        is_used = any(key.startswith(".".join(here[: depth + 1]) + ".") for key in answered)
        yield f"{indent}{'' if is_used or depth == 0 else '# '}{here[depth]}:"


def _key(key: KeyReference, answered: Mapping[str, Any]) -> Iterator[str]:
    name, indent = ".".join(key.path), "  " * (len(key.path) - 1)
    told = f"{key.meaning[:1].upper()}{key.meaning[1:]} ({', '.join(filter(None, (key.allowed, key.unit)))})."
    yield from _comment(told, indent)
    given = name in answered
    yield f"{indent}{'' if given else '# '}{key.path[-1]}: {yaml_value(answered[name] if given else key.default)}"


def _comment(text: str, indent: str = "") -> Iterator[str]:
    """Lines of a comment; what is indented stays as it is."""
    for line in text.rstrip("\n").split("\n"):
        parts = [line] if line.startswith(" ") else textwrap.wrap(line, _WIDTH - len(indent) - 2)
        yield from (f"{indent}# {part}".rstrip() for part in parts or [""])
