"""The verbs of `autonomy`."""

from collections.abc import Sequence

from autonomy.verbs import Verb, run_verb

_VERBS = {
    "run": Verb("autonomy.shell.run_cli", "run the service on board"),
    "check-config": Verb("autonomy.config_check_cli", "check configuration files"),
    "show-config": Verb("autonomy.config_show_cli", "show the configuration and where each value comes from"),
    "shore": Verb("autonomy.shore.cli", "the other end of the link: watch a vehicle"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; exit codes: 2 usage, 78 configuration."""
    return run_verb("autonomy", "Onboard autonomy for survey vessels.", _VERBS, arguments)
