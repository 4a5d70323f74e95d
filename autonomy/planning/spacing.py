"""How far apart lanes and sites may be, from what has been learnt of the field."""

import math

from autonomy.learning.kernel import Component, Kernel

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
