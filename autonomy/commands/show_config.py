"""`autonomy show-config FILE`: every value that is in force, and where it comes from."""

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from autonomy.commands.configuration import add_override_argument, tell
from autonomy.config import ConfigurationError, Loaded, load_with_origins
from autonomy.config.file import KeyPath
from autonomy.config.problems import DEFAULT


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("file", metavar="FILE", help="configuration in YAML")
    add_override_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print the configuration as YAML, each value with its origin in a comment; 0, or 78 if it is wrong."""
    try:
        loaded = load_with_origins(arguments.file, overrides=arguments.overrides)
    except ConfigurationError as error:
        return tell(error)
    sys.stdout.write("\n".join(show(loaded)) + "\n")
    return 0


def show(loaded: Loaded) -> Iterator[str]:
    """The lines of a YAML file that loads to the same configuration."""
    return _section(loaded.configuration, loaded, ())


def _section(section: BaseModel, loaded: Loaded, path: KeyPath) -> Iterator[str]:
    indent = "  " * len(path)
    for name in type(section).model_fields:
        value, here = getattr(section, name), (*path, name)
        if isinstance(value, BaseModel):
            yield f"{indent}{name}:"
            yield from _section(value, loaded, here)
        else:
            yield f"{indent}{name}: {yaml_value(value)}  # {loaded.origins.get(here, DEFAULT)}"


def yaml_value(value: Any) -> str:
    """The value as this project's YAML writes it, on one line."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(yaml_value, value))}]"
    if isinstance(value, str | Path):
        # Always quoted: a unit of "1" must stay text.
        return yaml.safe_dump(str(value), default_style='"', allow_unicode=True, width=math.inf).strip()
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, float) and math.isinf(value):
        return ".inf" if value > 0 else "-.inf"
    return repr(value)
