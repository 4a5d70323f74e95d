"""The verbs of `sim`."""

from collections.abc import Sequence
from typing import NoReturn

from autonomy.verbs import Verb, leave, run_verb

_VERBS = {
    "vessel": Verb("sim.vessel_cli", "a simulated survey vessel that speaks MAVLink as ArduPilot Rover does"),
    "demo": Verb(
        "sim.demo_cli", "vessel, service and shore as three processes; a map is learned in two minutes"
    ),
    "dry-run": Verb("sim.dry_run_cli", "a whole mission at the desk, with the boat's own configuration"),
    "mask": Verb("sim.mask_cli", "make the land polygons of a field as GeoJSON"),
    "experiment": Verb("sim.experiment.cli", "the paper's figures, and comparisons with other strategies"),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; exit codes: 2 usage."""
    return run_verb("sim", "A simulated ocean and vessel for halocline.", _VERBS, arguments)


def entry() -> NoReturn:
    """What the command `sim` runs."""
    leave(main())
