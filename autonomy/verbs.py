"""Command lines made of verbs: a verb's module is imported only when the verb is used, so `--help` stays quick."""

import argparse
import importlib
import logging
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NoReturn

from autonomy import __version__


@dataclass(frozen=True)
class Verb:
    """One verb: `module` has `add_arguments(parser)` and `run(arguments) -> int`."""

    module: str
    summary: str


def run_verb(program: str, about: str, verbs: Mapping[str, Verb], arguments: Sequence[str] | None) -> int:
    """Parse `PROGRAM [VERB] …`, run the verb, return its exit code; usage mistakes exit with 2."""
    # Before a verb imports numpy: on several threads BLAS fights with the worker for the cores, and small matrices,
    # which are all that there are here, take many times as long.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    words = list(sys.argv[1:] if arguments is None else arguments)
    width = max(map(len, verbs))
    parser = argparse.ArgumentParser(
        prog=program,
        usage=f"{program} [-h] [--version] VERB …",
        description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="verbs:\n" + "\n".join(f"  {name:{width}}  {verb.summary}" for name, verb in verbs.items()),
    )
    parser.add_argument("--version", action="version", version=f"halocline {__version__}")
    parser.add_argument("verb", choices=list(verbs), metavar="VERB", help="one of the verbs below")
    chosen = verbs[parser.parse_args(words[:1]).verb]
    module = importlib.import_module(chosen.module)
    verb_parser = argparse.ArgumentParser(prog=f"{program} {words[0]}", description=chosen.summary)
    module.add_arguments(verb_parser)
    code: int = module.run(verb_parser.parse_args(words[1:]))
    return code


def leave(code: int) -> NoReturn:
    """End the process with `code` at once, its output written, without taking the interpreter down first.

    zenoh's threads outlive their session. One that lets go of a Python object while the interpreter goes down aborts
    the process ("FATAL: exception not rethrown"): a clean stop would now and then look like a crash.
    """
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
