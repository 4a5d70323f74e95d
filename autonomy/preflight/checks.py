"""All checks, from facts to findings: pure."""

from autonomy.preflight.autopilot_checks import autopilot_checks
from autonomy.preflight.computer_checks import computer_checks
from autonomy.preflight.energy_checks import energy_checks
from autonomy.preflight.facts import Facts
from autonomy.preflight.finding import Finding
from autonomy.preflight.link_checks import link_checks
from autonomy.preflight.position_checks import position_checks
from autonomy.preflight.probe_checks import probe_checks


def checks(facts: Facts) -> list[Finding]:
    """What is to be known before the boat leaves, in the order in which it would be mended."""
    return [
        *link_checks(facts),
        *autopilot_checks(facts),
        *position_checks(facts),
        *probe_checks(facts),
        *energy_checks(facts),
        *computer_checks(facts),
    ]
