"""`autonomy check-config FILE…`: whether the service would accept these configurations."""

import argparse
import sys

from autonomy.commands.configuration import add_override_argument, doubts, load_with_survey, tell
from autonomy.config import ConfigurationError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument("files", metavar="FILE", nargs="+", help="configuration in YAML")
    add_override_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Print `FILE: ok`, or every mistake to standard error; 0 if all files are good, else 78."""
    code = 0
    for file in arguments.files:
        try:
            loaded, survey = load_with_survey(file, arguments.overrides)
        except ConfigurationError as error:
            code = tell(error)
        else:
            for doubt in doubts(loaded, survey):
                sys.stderr.write(f"{file}: warning: {doubt}\n")
            sys.stdout.write(f"{file}: ok\n")
    return code
