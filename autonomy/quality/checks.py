"""The tests that need nothing but a reading and its neighbours.

Definitions: U.S. IOOS, Manual for Real-Time Quality Control of In-situ Temperature and Salinity Data, version 2.1,
2020 (QARTOD), tests 2 (syntax), 4 (gross range), 6 (spike) and 7 (rate of change).
"""

import math

from autonomy.quality.flags import Flag

NO_VALUE_ABOVE = 1e30
"""No quantity of the sea is as large in any unit; fill values (9.97e36, 1e37, 3.4e38) and read errors are."""


def syntax(value: float) -> Flag:
    """MISSING for NaN, which is how a probe says that it has no value; FAIL for what can't be a measurement."""
    if math.isnan(value):
        return Flag.MISSING
    return Flag.GOOD if abs(value) < NO_VALUE_ABOVE else Flag.FAIL


def gross_range(value: float, fail_span: tuple[float, float], suspect_span: tuple[float, float]) -> Flag:
    """FAIL outside what the probe can measure, SUSPECT outside what is expected there; the ends belong to a span."""
    if not fail_span[0] <= value <= fail_span[1]:
        return Flag.FAIL
    return Flag.GOOD if suspect_span[0] <= value <= suspect_span[1] else Flag.SUSPECT


def spike_height(before: float, value: float, after: float) -> float:
    """How far a value stands out from its neighbours: |v − (b + a)/2| − |b − a|/2, and 0 where that is negative.

    The deviation from the neighbours' mean, less half of what the neighbours differ by themselves (GTSPP and Argo's
    form of the test; ioos-qc's "differential"). Without the second term both sides of a front are spikes half as
    high as the front, and so is each good reading beside a spike.
    """
    return max(0.0, value - max(before, after), min(before, after) - value)


def above(quantity: float, suspect: float, fail: float) -> Flag:
    """The flag of a quantity that should not exceed these limits."""
    if quantity > fail:
        return Flag.FAIL
    return Flag.SUSPECT if quantity > suspect else Flag.GOOD
