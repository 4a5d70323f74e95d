"""`autonomy shore`: the verbs of the people ashore."""

import argparse

from autonomy.shore import record_cli, serve_cli, watch_cli

_VERBS = {"watch": watch_cli, "serve": serve_cli, "record": record_cli}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs and their arguments."""
    verbs = parser.add_subparsers(dest="shore_verb", required=True, metavar="VERB")
    for name, module in _VERBS.items():
        summary = (module.__doc__ or "").split(": ", 1)[-1].strip().rstrip(".")
        module.add_arguments(verbs.add_parser(name, help=summary, description=summary))


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen verb."""
    code: int = _VERBS[arguments.shore_verb].run(arguments)
    return code
