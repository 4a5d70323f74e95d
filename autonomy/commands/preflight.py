"""`autonomy preflight`: is everything there, before the boat leaves?"""

import argparse
import asyncio
import json
import os
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from autonomy.commands.configuration import add_override_argument, doubts, load_with_survey, tell
from autonomy.config import Configuration, ConfigurationError
from autonomy.option_types import between
from autonomy.planning.survey import SurveyArea
from autonomy.preflight.finding import Finding, Grade

if TYPE_CHECKING:
    from autonomy.preflight.facts import Facts

EXIT_FAILED = 1
_WIDTH = 110
_NAME = 26


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("--config", required=True, metavar="FILE", help="configuration in YAML")
    parser.add_argument(
        "--seconds",
        type=between(1.0, 3600.0, "seconds"),
        default=20.0,
        metavar="N",
        help="how long the vehicle is listened to (%(default)g); nothing is sent to it but heartbeats and questions",
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")
    add_override_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Look and tell; exit codes: 0 nothing fails, 1 something does, 2 usage, 78 configuration."""
    try:
        loaded, survey = load_with_survey(arguments.config, arguments.overrides)
    except ConfigurationError as error:
        return tell(error)
    # The transport and the learner take a while to import: a wrong configuration is told before.
    from autonomy.preflight.checks import checks

    if not arguments.json:
        endpoint = loaded.configuration.mavlink.endpoint
        sys.stderr.write(f"listening to {endpoint} for {arguments.seconds:g} s\n")
    facts = asyncio.run(
        _gather(loaded.configuration, survey, tuple(doubts(loaded, survey)), arguments.seconds)
    )
    findings = checks(facts)
    tells = _as_json(findings) if arguments.json else "\n".join(_table(findings))
    sys.stdout.write(f"{tells}\n")
    return EXIT_FAILED if any(each.grade is Grade.FAIL for each in findings) else 0


async def _gather(
    configuration: Configuration, survey: SurveyArea, doubts: tuple[str, ...], seconds: float
) -> "Facts":
    """Everything that the checks want to know."""
    from autonomy.preflight.conversation import Conversation
    from autonomy.preflight.facts import Facts, Link, probe_of, vehicle_of
    from autonomy.preflight.listening import listen
    from autonomy.preflight.surroundings import folders, routers

    conversation = Conversation.of(configuration)
    heard, dialled = await asyncio.gather(
        listen(configuration.mavlink, conversation, seconds), asyncio.to_thread(routers, configuration.shore)
    )
    passed_s = heard.ended_s - heard.began_s
    counters = heard.counters
    return Facts(
        configuration,
        survey,
        doubts,
        Link(
            heard.trouble,
            passed_s,
            heard.bytes_in,
            counters.messages,
            counters.bad_frames,
            heard.refused,
            dict(conversation.autopilots),
        ),
        vehicle_of(conversation, passed_s, (heard.ended_s, heard.utc_s)),
        probe_of(conversation, configuration, survey),
        folders(configuration, os.environ),
        dialled,
    )


def _table(findings: Sequence[Finding]) -> Iterator[str]:
    """A line for each finding, and what to do under those that are not as they should be."""
    for each in findings:
        grade = each.grade.value if each.grade in (Grade.PASS, Grade.SKIP) else each.grade.value.upper()
        yield from _wrapped(f"{grade:5}{each.check:{_NAME}} ", each.says)
        if each.remedy:
            yield from _wrapped(f"{'':{3 + _NAME}} → ", each.remedy)
    counts = Counter(each.grade for each in findings)
    told = [f"{counts[grade]} {grade.value}" for grade in Grade if counts[grade]]
    yield ""
    yield f"{', '.join(told)}: {'do not sail yet' if counts[Grade.FAIL] else 'ready, as far as can be seen from here'}"


def _wrapped(head: str, text: str) -> list[str]:
    indent = " " * (5 + _NAME + 1)
    return textwrap.wrap(text, _WIDTH, initial_indent=head, subsequent_indent=indent, break_on_hyphens=False)


def _as_json(findings: Sequence[Finding]) -> str:
    rows = [
        {"check": each.check, "grade": each.grade.value, "says": each.says, "remedy": each.remedy}
        for each in findings
    ]
    ready = not any(each.grade is Grade.FAIL for each in findings)
    return json.dumps({"ready": ready, "findings": rows}, indent=1, ensure_ascii=False)
