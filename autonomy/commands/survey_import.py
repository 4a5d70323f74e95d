"""`autonomy survey import FILE…`: the survey from where people draw it."""

import argparse
import asyncio
import json
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import get_args

from autonomy.commands.places import place
from autonomy.commands.sketch import Sketch, fence_drawn, sketch
from autonomy.commands.survey_doubts import doubts_of, told_of
from autonomy.config import MavlinkSection, SigningSection, SurveySection
from autonomy.endpoints import parse_link
from autonomy.planning.errors import SurveyError
from autonomy.planning.polygon_files import Role
from autonomy.planning.rings import Drawn
from autonomy.planning.survey import SurveyArea, read_survey

EXIT_USAGE = 2
EXIT_DATA = 65
"""EX_DATAERR of sysexits.h."""

EXIT_UNAVAILABLE = 69
"""EX_UNAVAILABLE: the vehicle does not answer."""

EXIT_NO_OUTPUT = 73
"""EX_CANTCREAT of sysexits.h."""

_PATIENCE_S = 60.0


class NoFenceError(Exception):
    """The vehicle's fence can't be had; says why."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    verbs = parser.add_subparsers(dest="survey_verb", required=True, metavar="VERB")
    summary = "make the survey's file of what was drawn elsewhere"
    verb = verbs.add_parser("import", help=summary, description=summary)
    verb.add_argument(
        "files",
        metavar="[ROLE=]FILE",
        nargs="*",
        type=_file,
        help="QGroundControl .plan, KML or KMZ of Google Earth, or GeoJSON; ROLE is one of area, keep_in, keep_out and "
        "land, for files that do not say it themselves",
    )
    verb.add_argument("--out", type=Path, required=True, metavar="FILE", help="the GeoJSON file to write")
    verb.add_argument("--replace", action="store_true", help="write over a file that is there")
    verb.add_argument(
        "--from-vehicle",
        metavar="ENDPOINT",
        type=_link,
        help="take the fence on the autopilot too: udpin:HOST:PORT, udpout:…, tcp:… or serial:DEVICE:BAUD",
    )
    verb.add_argument(
        "--system-id", type=int, metavar="ID", help="MAVLink system of the vehicle, if there are more"
    )
    verb.add_argument("--signing-key", type=Path, metavar="FILE", help="key of a link that is signed")
    verb.add_argument(
        "--signing-form", choices=("passphrase", "key"), default="passphrase", help="what that file holds"
    )
    verb.add_argument(
        "--start",
        type=place,
        metavar="LAT,LON",
        help="where the boat will be launched, to see that it lies in the survey's water (--start=-33.5,18.4)",
    )
    verb.add_argument(
        "--standoff-m",
        type=float,
        default=SurveySection.model_fields["standoff_m"].default,
        metavar="M",
        help="distance from land and keep-out that is counted with (survey.standoff_m, %(default)g)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Import; exit codes: 0 written, 2 usage, 65 a file can't be used, 69 no vehicle, 73 it can't be written."""
    if not arguments.files and arguments.from_vehicle is None:
        return _failed("name a file, or --from-vehicle ENDPOINT", EXIT_USAGE)
    if not 0.0 <= arguments.standoff_m < float("inf"):
        return _failed(f"--standoff-m must be zero or more metres, not {arguments.standoff_m:g}", EXIT_USAGE)
    out: Path = arguments.out
    if out.exists() and not arguments.replace:
        return _failed(f"{out} is there already; --replace writes over it", EXIT_NO_OUTPUT)
    if any(out.resolve() == file.resolve() for _, file in arguments.files):
        return _failed(f"{out} is one of the files that are read", EXIT_USAGE)
    try:
        fence = [] if arguments.from_vehicle is None else asyncio.run(_fence(arguments))
        drawn = sketch(arguments.files, fence)
        text = json.dumps(drawn.geojson(), indent=1, allow_nan=False) + "\n"
        survey = _read_back(text, drawn, out, arguments.standoff_m)
    except NoFenceError as error:
        return _failed(str(error), EXIT_UNAVAILABLE)
    except SurveyError as error:
        return _failed(str(error), EXIT_DATA)
    try:
        _write(text, out)
    except OSError as error:
        return _failed(f"{out}: {error.strerror or error}", EXIT_NO_OUTPUT)
    sys.stdout.write("\n".join([*told_of(drawn, survey), *_section(drawn, out)]) + "\n")
    for doubt in doubts_of(drawn, survey, arguments.start):
        sys.stderr.write(f"{out}: warning: {doubt}\n")
    return 0


async def _fence(arguments: argparse.Namespace) -> list[Drawn]:
    """The zones of the fence on the vehicle.

    Raises:
        NoFenceError: it can't be had.
        SurveyError: a zone is no polygon.
    """
    # The transport needs a while to import.
    from autonomy.mavlink.signing import KeyFileError
    from autonomy.mavlink.telemetry import Telemetry
    from autonomy.preflight.conversation import Conversation
    from autonomy.preflight.listening import listen

    signing = SigningSection(key_file=arguments.signing_key, form=arguments.signing_form)
    section = MavlinkSection(endpoint=arguments.from_vehicle, system_id=arguments.system_id, signing=signing)
    conversation = Conversation(section, Telemetry("", vehicle_system_id=section.system_id), ())

    def is_read() -> bool:
        return conversation.safeguards is not None and conversation.safeguards.known is not None

    try:
        heard = await listen(section, conversation, _PATIENCE_S, until=is_read)
    except KeyFileError as error:
        raise NoFenceError(str(error)) from None
    reading = conversation.safeguards
    if reading is None:
        why = heard.trouble or heard.refused or f"no autopilot is heard ({heard.bytes_in} bytes came in)"
        raise NoFenceError(f"{section.endpoint}: {why}")
    if reading.known is None:
        raise NoFenceError(f"{section.endpoint}: {reading.problem}")
    known = reading.known
    if not known.has_fence:
        raise NoFenceError(f"{section.endpoint}: the vehicle has no fence")
    return fence_drawn(known.inclusions, known.exclusions, f"{section.endpoint} fence")


def _read_back(text: str, drawn: Sketch, out: Path, standoff_m: float) -> SurveyArea:
    """The survey that the service will read from what is about to be written.

    Raises:
        SurveyError: there is none.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "survey.geojson"
        file.write_text(text, encoding="utf-8")
        named: dict[str, object] = dict.fromkeys(drawn.roles, file)
        try:
            return read_survey(SurveySection.model_validate({"standoff_m": standoff_m, **named}))
        except SurveyError as error:
            raise SurveyError(str(error).replace(str(file), str(out))) from None


def _write(text: str, out: Path) -> None:
    """All of it or nothing."""
    part = out.with_name(f".{out.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        os.replace(part, out)
    finally:
        part.unlink(missing_ok=True)


def _section(drawn: Sketch, out: Path) -> list[str]:
    """How the configuration names the file."""
    keys = [f"  {role}: {json.dumps(out.name)}" for role in drawn.roles]
    return [f"{out}: written; in the configuration beside it:", "", "survey:", *keys]


def _failed(why: str, code: int) -> int:
    sys.stderr.write(f"autonomy survey import: {why}\n")
    return code


def _file(text: str) -> tuple[Role | None, Path]:
    match = re.fullmatch(r"(?:(\w+)=)?(.+)", text, re.DOTALL)
    if match is None:
        raise argparse.ArgumentTypeError("the name of a file is empty")
    said = match[1]
    if said is not None and said not in get_args(Role) and not Path(text).exists():
        raise argparse.ArgumentTypeError(f"{said!r} is no role; one of {', '.join(get_args(Role))} is")
    role = next((role for role in get_args(Role) if role == said), None)
    return role, Path(match[2] if role is not None else text)


def _link(text: str) -> str:
    try:
        parse_link(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text
