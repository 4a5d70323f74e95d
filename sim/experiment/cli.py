"""`sim experiment VERB`: each verb's module has `add_arguments` and `run`, as those of `sim` itself have."""

import argparse
import importlib
import sys

from autonomy.verbs import Verb
from sim.experiment.cells import SweepError

_VERBS = {
    "paper": Verb("sim.experiment.paper_cli", "the paper's figures on a field of your choice"),
    "compare": Verb(
        "sim.experiment.compare_cli", "side by side with lawnmowers and other ways to choose samples"
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verbs and their arguments.

    Their modules are all imported for it, whichever is used: what is heavy they import in `run`.
    """
    verbs = parser.add_subparsers(dest="experiment_verb", required=True, metavar="VERB")
    for name, verb in _VERBS.items():
        module = importlib.import_module(verb.module)
        verb_parser = verbs.add_parser(name, help=verb.summary, description=verb.summary)
        module.add_arguments(verb_parser)
        verb_parser.set_defaults(run_experiment=module.run)


def run(arguments: argparse.Namespace) -> int:
    """Run the experiment.

    Exit codes: the verb's own; 1 if cells of a sweep have failed, 130 after Ctrl-C. What is finished is kept.
    """
    try:
        code: int = arguments.run_experiment(arguments)
    except SweepError as error:
        print(f"sim experiment {arguments.experiment_verb}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(
            f"sim experiment {arguments.experiment_verb}: stopped; finished cells are kept", file=sys.stderr
        )
        return 130
    return code
