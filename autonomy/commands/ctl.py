"""`autonomy ctl`: command a vehicle from ashore, and hear what became of it. See docs/operating.md."""

import argparse
import json
import os
import sys
from datetime import UTC, datetime
from pathlib import Path

from autonomy.effects import Answer, Outcome
from autonomy.endpoints import session_settings
from autonomy.option_types import above_zero
from autonomy.shore import way
from autonomy.shore.commanding import Commander, Result
from autonomy.shore.stopping import stop_on_signals
from autonomy.wire_commands import STATUS, VERBS, Token, TokenError, read_token
from autonomy.wire_rules import VEHICLE_NAME

EXIT_DONE, EXIT_REFUSED, EXIT_USAGE, EXIT_UNKNOWN = 0, 1, 2, 3
_SUMMARIES = {
    "start": "let the boat start by itself (authority.mode full)",
    "pause": "plan nothing more; the boat ends its leg and stays there",
    "resume": "go on with the survey",
    "replan": "make a new plan now",
    "finish": "sail the present path to its end, then home",
    "return": "go home at once",
    STATUS: "say how things are; changes nothing",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = "commands:\n" + "\n".join(f"  {name:7} {said}" for name, said in _SUMMARIES.items())
    parser.add_argument("command", choices=[*VERBS, STATUS], metavar="COMMAND", help="one of those below")
    parser.add_argument("--vehicle", required=True, type=_vehicle, metavar="NAME", help="which vehicle")
    way.add_arguments(parser)
    parser.add_argument(
        "--token", type=Path, metavar="FILE", help="the vehicle's token; only its owner may read the file"
    )
    parser.add_argument(
        "--timeout",
        type=above_zero("seconds"),
        default=30.0,
        metavar="S",
        help="how long to try; after that the command is void (default 30)",
    )
    parser.add_argument("--json", action="store_true", help="print a JSON object, not text")


def run(arguments: argparse.Namespace) -> int:
    """Command and wait: 0 done, 1 refused, 2 usage, 3 no answer, or none that could be verified."""
    try:
        certificates = way.certificates(arguments)
        token = _token(arguments.token)
    except ValueError as error:
        return _complain(EXIT_USAGE, str(error))
    settings = session_settings(
        "router" if arguments.listen else "client",
        connect=arguments.connect or (),
        listen=arguments.listen or (),
        certificates=certificates,
    )
    with stop_on_signals() as stopping:
        commander = Commander(settings, arguments.vehicle, token, stopping, _note)
        try:
            result = commander.ask(arguments.command, arguments.timeout)
        except OSError as error:
            return _complain(EXIT_USAGE, str(error))
    code = _code(result)
    if arguments.json:
        _say(json.dumps(_fields(arguments.vehicle, arguments.command, result)))
    else:
        _tell(arguments, result)
    return code


def _code(result: Result) -> int:
    if result.answer is None:
        return EXIT_REFUSED if result.error and result.sent else EXIT_UNKNOWN
    return {Outcome.DONE: EXIT_DONE, Outcome.UNKNOWN: EXIT_UNKNOWN}.get(result.answer.outcome, EXIT_REFUSED)


def _tell(arguments: argparse.Namespace, result: Result) -> None:
    name, answer = arguments.vehicle, result.answer
    if answer is None:
        _note(f"{name}: {_without_answer(arguments, result)}")
        return
    if answer.verb != STATUS:
        line = f"{name}: {answer.verb}: {answer.outcome.value}: {answer.text}"
        if answer.outcome is Outcome.DONE:
            _say(line)
        else:
            _note(line)
    if answer.state:
        _say(f"{name}: {_situation(answer)}")
    if answer.verb != STATUS and answer.outcome is Outcome.DONE and not result.recorded:
        _note(f"{name}: it is not on the boat's disk: after a restart there nobody will know of it")


def _without_answer(arguments: argparse.Namespace, result: Result) -> str:
    if not result.sent:
        return f"{result.error or 'stopped'}: the command was not sent"
    if result.error:
        return f"refused: {result.error}"
    text = f"no answer in {arguments.timeout:g} s, asked {result.sent} times"
    if result.unverified:
        text = (
            f"no answer in {arguments.timeout:g} s that could be verified, asked {result.sent} times; "
            f"the last, by whoever: {result.unverified}"
        )
    if arguments.command == STATUS:
        return text
    return (
        f"{text}: whether it was carried out is not known. It will not be any more once its time is over; "
        "`autonomy ctl status` tells how things are"
    )


def _situation(answer: Answer) -> str:
    clock = datetime.fromtimestamp(answer.utc_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    armed = "armed" if answer.armed else "disarmed"
    return f"{answer.state.replace('_', ' ')}: {answer.reason} ({answer.mode}, {armed}), {clock}"


def _fields(vehicle: str, verb: str, result: Result) -> dict[str, object]:
    answer = result.answer
    told: dict[str, object] = {
        "vehicle": vehicle,
        "command": verb,
        "id": result.command_id.hex(),
        "outcome": "unknown",
        "text": result.error or result.unverified,
        "sent": result.sent,
        "recorded": result.recorded,
    }
    if answer is None:
        return told | ({"outcome": "refused"} if _code(result) == EXIT_REFUSED else {})
    situation = {name: getattr(answer, name) for name in ("state", "reason", "mode", "armed", "utc_s")}
    return told | {"outcome": answer.outcome.value, "text": answer.text, **situation}


def _token(file: Path | None) -> Token | None:
    """The token in a file; ValueError that names the option if there is none."""
    if file is None:
        return None
    try:
        return read_token(file, os.environ)
    except TokenError as error:
        raise ValueError(f"--token: {error}") from None


def _vehicle(text: str) -> str:
    if not VEHICLE_NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"must match {VEHICLE_NAME.pattern} (got {text!r})")
    return text


def _printable(text: str) -> str:
    """Text from the network must not steer the terminal."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


def _say(text: str) -> None:
    sys.stdout.write(_printable(text) + "\n")


def _note(text: str) -> None:
    sys.stderr.write(_printable(text) + "\n")


def _complain(code: int, text: str) -> int:
    _note(f"autonomy ctl: {text}")
    return code
