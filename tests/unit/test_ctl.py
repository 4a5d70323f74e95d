"""`autonomy ctl`, and the configuration of commands: what is refused before anything is sent."""

import argparse
import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from autonomy.commands import ctl
from autonomy.commands.configuration import load_with_survey
from autonomy.config import ConfigurationError
from autonomy.effects import Answer, Outcome
from autonomy.shore.commanding import Result
from autonomy.wire_commands import STATUS, VERBS

AREA = {"survey": {"area": [[33.4, -118.6], [33.4, -118.4], [33.6, -118.4]]}}
HERE = ("--vehicle", "boat1", "--connect", "tcp/127.0.0.1:7447")
ID = bytes(range(16))


def problem_of(folder: Path, shore: dict[str, Any], mode: int = 0o600) -> str:
    token = folder / "boat1.token"
    token.write_text("0123456789abcdef\n")
    (folder / "short.token").write_text("0123\n")
    for file in (token, folder / "short.token", folder / "own.pem"):
        file.touch()
        file.chmod(mode)
    file = folder / "boat.yaml"
    file.write_text(yaml.safe_dump(AREA | {"shore": shore}))
    try:
        load_with_survey(str(file), [])
    except ConfigurationError as error:
        return str(error)
    return ""


TLS = {"certificate": "own.pem", "private_key": "own.pem"}


@pytest.mark.parametrize(
    ("shore", "mode", "says"),
    [
        ({"commands": {"token_file": "boat1.token"}}, 0o600, ""),
        ({"commands": {"token_file": "boat1.token"}}, 0o644, "others may read"),
        ({"commands": {"token_file": "no.token"}}, 0o600, "no readable file"),
        ({"commands": {"token_file": "short.token"}}, 0o600, "at least 16 bytes, not 4"),
        (
            {"commands": {"trust_router": True}},
            0o600,
            "shore.commands.trust_router: is of no use without shore.tls.certificate",
        ),
        (
            {"commands": {"trust_router": True}, "connect": ["tls/a:1", "tcp/b:1"], "tls": TLS},
            0o600,
            "shore.commands.trust_router: is of no use: not every locator",
        ),
        ({"commands": {"trust_router": True}, "connect": ["tls/a:1"], "tls": TLS}, 0o600, ""),
    ],
)
def test_who_may_command_is_checked_with_the_configuration(
    tmp_path: Path, shore: dict[str, Any], mode: int, says: str
) -> None:
    told = problem_of(tmp_path, shore, mode)
    assert (says in told) if says else told == ""
    assert "0123" not in told


def parsed(*words: str) -> Any:

    parser = argparse.ArgumentParser()
    ctl.add_arguments(parser)
    return parser.parse_args(words)


@pytest.mark.parametrize(
    "words",
    [
        ("arm", *HERE),
        ("pause", "--connect", "tcp/127.0.0.1:7447"),
        ("pause", "--vehicle", "*", "--connect", "tcp/127.0.0.1:7447"),
        ("pause", "--vehicle", "boat1"),
        ("pause", *HERE, "--timeout", "0"),
        ("pause", *HERE, "--listen", "tcp/0.0.0.0:7447"),
    ],
)
def test_wrong_words_are_usage(words: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed(*words)
    assert ended.value.code == 2


def test_every_command_is_explained() -> None:
    assert set(ctl._SUMMARIES) == {*VERBS, STATUS}
    text = (Path(__file__).parents[2] / "docs" / "commands.md").read_text()
    assert all(f"| `{verb}` |" in text for verb in (*VERBS, STATUS))


def result(outcome: Outcome | None, **changes: Any) -> Result:
    answer = None
    if outcome is not None:
        answer = Answer(ID, "pause", outcome, "so\x1b[2J", "paused", "why", "AUTO", True, 1.7e9)
    fields = {"answer": answer, "recorded": True, "error": "", "sent": 2, "command_id": ID}
    return Result(**(fields | changes))


@pytest.mark.parametrize(
    ("found", "code", "out", "err"),
    [
        (result(Outcome.DONE), 0, "boat1: pause: done: so", ""),
        (result(Outcome.DONE, recorded=False), 0, "pause: done", "it is not on the boat's disk"),
        (result(Outcome.REFUSED), 1, "boat1: paused: why (AUTO, armed), 2023", "boat1: pause: refused: so"),
        (result(Outcome.EXPIRED), 1, "", "expired"),
        (result(Outcome.UNKNOWN), 3, "", "unknown"),
        (result(None, error="commands are off"), 1, "", "refused: commands are off"),
        (
            result(None, unverified="it is off\x1b[2J"),
            3,
            "",
            "that could be verified, asked 2 times; the last",
        ),
        (result(None), 3, "", "whether it was carried out is not known"),
        (result(None, sent=0, error="no router answers"), 3, "", "the command was not sent"),
    ],
)
def test_what_became_of_it_is_told(
    capsys: pytest.CaptureFixture[str], found: Result, code: int, out: str, err: str
) -> None:
    assert ctl._code(found) == code
    ctl._tell(parsed("pause", *HERE), found)
    told = capsys.readouterr()
    assert out in told.out
    assert err in told.err
    assert "\x1b" not in told.out + told.err


def test_for_programs_it_is_told_as_json() -> None:
    fields = json.loads(json.dumps(ctl._fields("boat1", "pause", result(Outcome.REFUSED))))
    assert (fields["outcome"], fields["state"], fields["id"]) == ("refused", "paused", ID.hex())
    assert ctl._fields("boat1", "pause", result(None))["outcome"] == "unknown"
    unverified = ctl._fields("boat1", "pause", result(None, unverified="it is off"))
    assert (unverified["outcome"], unverified["text"]) == ("unknown", "it is off")
