"""`autonomy init FILE`: a first configuration, from five answers."""

import argparse
import os
import shlex
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from autonomy.commands.configuration import EXIT_CONFIGURATION, doubts, load_with_survey
from autonomy.commands.sketch import roles_by_name
from autonomy.commands.starter import starter_text
from autonomy.config import (
    ConfigurationError,
    MavlinkSection,
    SensorSection,
    ShoreSection,
    VehicleSection,
)
from autonomy.planning.polygon_files import read_drawn, read_polygons

EXIT_USAGE = 2
EXIT_NO_OUTPUT = 73
"""EX_CANTCREAT of sysexits.h."""

NOTHING = "none"
"""The answer for land and router when there is none."""

Values = dict[tuple[str, str], Any]
"""Keys of the configuration and what is written there."""


@dataclass(frozen=True)
class Question:
    """One answer that is needed.

    Attributes:
        flag: that gives it without being asked.
        text: what is asked; `default` is offered.
        values: what an answer comes to; raises ValueError that says what would be right.
    """

    flag: str
    text: str
    default: str
    values: Callable[[str, Path], Values]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="the configuration to write; it must not be there yet"
    )
    parser.add_argument(
        "--link", metavar="ENDPOINT", help="where the autopilot is, such as serial:/dev/ttyAMA0:921600"
    )
    parser.add_argument(
        "--sensor",
        metavar='"NAME VARIABLE UNITS"',
        help='name in NAMED_VALUE_FLOAT, CF standard name, unit: "SALT sea_water_practical_salinity 1"',
    )
    parser.add_argument("--survey", metavar="FILE", help="the survey area: GeoJSON, .plan, KML or KMZ")
    parser.add_argument("--land", metavar="FILE", help=f"polygons of land, or {NOTHING}")
    parser.add_argument(
        "--router", metavar="LOCATOR", help=f"zenoh router ashore, such as tcp/HOST:7447, or {NOTHING}"
    )
    parser.add_argument("--name", default="boat1", help="name of the vehicle (%(default)s)")


def run(arguments: argparse.Namespace) -> int:
    """Ask what the flags leave open, and write.

    Exit codes: 0 written, 2 usage, 73 it can't be written, 78 the service would refuse it.
    """
    file: Path = arguments.file
    if file.exists():
        return _failed(f"{file} is there already, and stays as it is", EXIT_NO_OUTPUT)
    try:
        values: Values = _checked(VehicleSection, {"name": arguments.name}, "vehicle")
        values |= _answers(vars(arguments), file.absolute().parent)
    except (ValueError, EOFError, KeyboardInterrupt) as error:
        return _failed(str(error) or "nothing is written", EXIT_USAGE)
    part, text = file.with_name(f".{file.name}.part"), starter_text(file.name, values)
    try:
        part.write_text(text, encoding="utf-8")
        loaded, survey = load_with_survey(str(part), [])
        with file.open("x", encoding="utf-8") as new:  # never over a file that has come meanwhile
            new.write(text)
    except ConfigurationError as error:
        sys.stderr.write(f"{error}\n".replace(str(part), str(file)))
        return EXIT_CONFIGURATION
    except OSError as error:
        return _failed(f"{file}: {error.strerror or error}", EXIT_NO_OUTPUT)
    finally:
        part.unlink(missing_ok=True)
    for doubt in doubts(loaded, survey):
        sys.stderr.write(f"{file}: warning: {doubt}\n")
    sys.stdout.write(f"{file}: written; next: autonomy preflight --config {shlex.quote(str(file))}\n")
    return 0


def _answers(given: Mapping[str, Any], folder: Path) -> Values:
    """What flags and answers come to.

    Raises:
        ValueError: a flag is wrong, or is missing where nobody can be asked.
        EOFError: the person has had enough.
    """
    values: Values = {}
    for question in QUESTIONS:
        answer = given[question.flag]
        if answer is not None:
            try:
                values |= question.values(answer, folder)
            except ValueError as error:
                raise ValueError(f"--{question.flag}: {error}") from None
    # A survey's file may have its land in it.
    open_still = [
        each for each in QUESTIONS if given[each.flag] is None and ("survey", each.flag) not in values
    ]
    if open_still and not sys.stdin.isatty():
        raise ValueError(
            f"nobody can be asked here: give {', '.join(f'--{each.flag}' for each in open_still)}"
        )
    for question in open_still:
        if ("survey", question.flag) not in values:
            values |= _asked(question, folder)
    return values


def _asked(question: Question, folder: Path) -> Values:
    """The values of an answer, asked for until it is right."""
    default = f" [{question.default}]" if question.default else ""
    while True:
        answer = input(f"{question.text}{default}: ").strip() or question.default
        try:
            return question.values(answer, folder)
        except ValueError as error:
            sys.stderr.write(f"  {error}\n")


def _link(answer: str, _: Path) -> Values:
    return _checked(MavlinkSection, {"endpoint": answer}, "mavlink")


def _sensor(answer: str, _: Path) -> Values:
    words = shlex.split(answer)
    if len(words) != 3:
        raise ValueError(f"three words are needed, NAME VARIABLE UNITS, not {len(words)}")
    return _checked(
        SensorSection, dict(zip(("message_name", "variable", "units"), words, strict=True)), "sensor"
    )


def _survey(answer: str, folder: Path) -> Values:
    path = Path(answer)
    read_polygons(path, "area")
    drawn = read_drawn(path)
    roles = {each.role for each in drawn if each.role is not None}
    if not roles and roles_by_name(drawn) - {"area"}:
        named = ", ".join(sorted(roles_by_name(drawn)))
        raise ValueError(
            f"{path}: by their names its polygons are {named}, and all of them would be the area: "
            f"autonomy survey import {shlex.quote(answer)} --out survey.geojson makes a file that keeps them apart"
        )
    keys = ["area", *(role for role in ("keep_in", "keep_out", "land") if role in roles)]
    return {("survey", key): _relative(path, folder) for key in keys}


def _land(answer: str, folder: Path) -> Values:
    if answer == NOTHING:
        return {("survey", "land"): None}
    path = Path(answer)
    read_polygons(path, "land")
    return {("survey", "land"): _relative(path, folder)}


def _router(answer: str, _: Path) -> Values:
    return {} if answer == NOTHING else _checked(ShoreSection, {"connect": [answer]}, "shore")


QUESTIONS = (
    Question("link", "Autopilot (udpin:, udpout:, tcp: or serial:)", "udpin:0.0.0.0:14551", _link),
    Question(
        "sensor",
        "Sensor: its name on the link, CF standard name, unit",
        "SALT sea_water_practical_salinity 1",
        _sensor,
    ),
    Question("survey", "File of the survey area (GeoJSON, .plan, KML)", "", _survey),
    Question("land", f"File of the land, or {NOTHING}", NOTHING, _land),
    Question("router", f"zenoh router ashore (tcp/HOST:7447), or {NOTHING}", NOTHING, _router),
)


def _checked(section: type[BaseModel], given: dict[str, Any], name: str) -> Values:
    """The values, if the section takes them; raises ValueError that says why not."""
    try:
        section.model_validate(given)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = str(first["loc"][0])
        allowed = (section.model_fields[key].json_schema_extra or {}).get("allowed", "")  # type: ignore[union-attr]
        raise ValueError(
            f"{given[key]!r}: {first['msg']}{f'; allowed: {allowed}' if allowed else ''}"
        ) from None
    return {(name, key): value for key, value in given.items()}


def _relative(path: Path, folder: Path) -> str:
    """As the configuration names it."""
    return os.path.relpath(path.absolute(), folder)


def _failed(why: str, code: int) -> int:
    sys.stderr.write(f"autonomy init: {why}\n")
    return code
