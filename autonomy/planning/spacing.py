"""How far apart lanes and sites may be, from what has been learnt of the field."""

import math

from autonomy.learning.kernel import Component, Kernel

_COARSEST = 2.0
_SPACING = 1.15
"""Of the length-scale: the best spacing of a tour that goes round for ever; finer ones come round too rarely."""


def lane_spacing_m(kernel: Kernel) -> float:
    """Distance between lanes that resolves the field: 1.15 × the length-scale of its largest part that changes.

    What moves decides, if anything does: the rest is known after a few rounds. Of unequal axes the shorter counts.
    """
    return _SPACING * min(leading_component(kernel).space.lengthscales_m)


def leading_component(kernel: Kernel) -> Component:
    """The component of the largest variance among those that move; among all if none does."""
    moving = [component for component in kernel.components if not math.isinf(component.time.timescale_s)]
    return max(moving or kernel.components, key=lambda component: component.variance)


def round_spacing_m(kernel: Kernel, area_m2: float, speed_mps: float) -> float:
    """Distance between the sites of a round that is sailed for ever over `area_m2` of water.

    That of `lane_spacing_m` while a round of it (area / spacing long) takes no longer than the field remembers. A field
    that forgets faster is better known in a coarser round, that comes back in time: up to twice the length-scale, from
    where on a coarser one sees no more for each metre.
    """
    component = leading_component(kernel)
    lengthscale_m = min(component.space.lengthscales_m)
    # A field that stands still is remembered for ever, and the quotient is 0.
    in_time_m = area_m2 / (speed_mps * component.time.timescale_s)
    return min(max(_SPACING * lengthscale_m, in_time_m), _COARSEST * lengthscale_m)
