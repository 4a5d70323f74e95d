"""The verbs of `autonomy`."""

from collections.abc import Sequence
from typing import NoReturn

from autonomy.verbs import Verb, leave, run_verb

_VERBS = {
    "run": Verb("autonomy.commands.run", "run the service on board"),
    "survey": Verb("autonomy.commands.survey_import", "make the survey's file of what was drawn elsewhere"),
    "init": Verb("autonomy.commands.init", "write a first configuration, from five answers"),
    "check-config": Verb("autonomy.commands.check_config", "check configuration files"),
    "preflight": Verb(
        "autonomy.commands.preflight", "look whether everything is there, before the boat leaves"
    ),
    "show-config": Verb(
        "autonomy.commands.show_config", "show the configuration and where each value comes from"
    ),
    "bridge": Verb("autonomy.commands.bridge", "make readings of an instrument's lines of text"),
    "plan": Verb("autonomy.commands.plan", "make a plan without a boat"),
    "replay": Verb("autonomy.commands.replay", "run a recorded survey again and compare"),
    "export": Verb("autonomy.commands.export", "hand a recorded survey on as NetCDF, GeoJSON, MCAP and CSV"),
    "ctl": Verb("autonomy.commands.ctl", "command a vehicle from ashore, and hear what became of it"),
    "shore": Verb("autonomy.shore.cli", "the other end of the link: watch a vehicle"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; exit codes: 2 usage, 78 configuration."""
    return run_verb("autonomy", "Onboard autonomy for survey vessels.", _VERBS, arguments)


def entry() -> NoReturn:
    """What the command `autonomy` runs."""
    leave(main())
