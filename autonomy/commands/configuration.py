"""What the verbs that take a configuration share: their arguments, and how its mistakes are told."""

import argparse
import os
import sys
from pathlib import Path

from autonomy.config import ConfigurationError, Loaded, Origin, Problem, load_with_origins
from autonomy.config.file import KeyPath
from autonomy.config.problems import Source
from autonomy.planning.survey import SurveyArea, SurveyError, read_survey

EXIT_CONFIGURATION = 78
"""EX_CONFIG of sysexits.h; systemd does not restart the service after it."""


def add_override_argument(parser: argparse.ArgumentParser) -> None:
    """Give the verb the option `--set KEY=VALUE`."""
    parser.add_argument(
        "--set",
        dest="overrides",
        metavar="KEY=VALUE",
        type=_override,
        action="append",
        default=[],
        help="override one value, such as model.capacity=50; may be repeated",
    )


def load_with_survey(file: str, overrides: list[str]) -> tuple[Loaded, SurveyArea]:
    """Read a configuration and the files of polygons and depths that it names; its secrets are tried too.

    Raises:
        ConfigurationError: one of them can't be used.
    """
    loaded = load_with_origins(file, overrides=overrides)
    _try_keys(loaded, file)
    try:
        return loaded, read_survey(loaded.configuration.survey)
    except SurveyError as error:
        raise ConfigurationError([_survey_problem(loaded, file, error)]) from error


def doubts(loaded: Loaded, survey: SurveyArea) -> list[str]:
    """What is allowed but seldom meant, in words: the land above all, since nothing else keeps the vessel off it."""
    found = []
    if loaded.configuration.survey.land is None:
        found.append("survey.land: no polygons of land are given: all of the survey area counts as water")
    elif not survey.obstacles.intersects(survey.ground):
        found.append(
            "survey.land: the polygons of land do not touch the survey area: all of it counts as water"
        )
    tls = loaded.configuration.shore.tls
    if tls.certificate is not None:
        from autonomy.shell.certificate import doubt

        of_certificate = doubt(loaded.configuration.vehicle.name, tls.certificate, tls.private_key)
        found += [f"shore.tls.certificate: {of_certificate}"] if of_certificate else []
    return found


def tell(error: ConfigurationError) -> int:
    """Print every mistake, one a line, to standard error; return the exit code."""
    sys.stderr.write(f"{error}\n")
    return EXIT_CONFIGURATION


def _override(text: str) -> str:
    key, equals, _ = text.partition("=")
    if not equals or not key.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form SECTION.KEY=VALUE")
    return text


def _try_keys(loaded: Loaded, file: str) -> None:
    """ConfigurationError if the signing key or the token that is named can't be used."""
    configuration = loaded.configuration
    if configuration.mavlink.signing.key_file is not None:
        from autonomy.mavlink.signing import KeyFileError, read_key

        try:
            read_key(configuration.mavlink.signing, os.environ)
        except KeyFileError as error:
            raise _key_problem(loaded, file, ("mavlink", "signing", "key_file"), error) from None
    if configuration.shore.commands.token_file is not None:
        from autonomy.wire_commands import TokenError, read_token

        try:
            read_token(configuration.shore.commands.token_file, os.environ)
        except TokenError as error:
            raise _key_problem(loaded, file, ("shore", "commands", "token_file"), error) from None


def _key_problem(loaded: Loaded, file: str, path: KeyPath, error: ValueError) -> ConfigurationError:
    origin = loaded.origins.get(path, Origin(Source.FILE, file))
    return ConfigurationError([Problem(origin, ".".join(map(str, path)), str(error))])


def _survey_problem(loaded: Loaded, file: str, error: SurveyError) -> Problem:
    """The reader's message, placed at the key that names the file in question, else at the section."""
    section = loaded.configuration.survey
    files = {
        key: value for key in type(section).model_fields if isinstance(value := getattr(section, key), Path)
    }
    named = [key for key, value in files.items() if str(value) in str(error)]
    key = next((key for key in named if ("survey", key) in loaded.origins), None)
    path = ("survey",) if key is None else ("survey", key)
    origin = loaded.origins.get(path, Origin(Source.FILE, file))
    return Problem(origin, ".".join(path), str(error))
