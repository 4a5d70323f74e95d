"""The grid on which positions teach: so coarse that they travel in few bytes, so fine that no map can tell.

A reading's position is known to a metre or so, but as a number it has 52 bits. Snapped to a power of two, the
basis vectors travel exactly in some two bytes an axis, and whoever reads them computes the very same factors.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from autonomy.learning.numbers import FloatArray, positive

STEPS_PER_SPAN = 2**15
"""At least so many steps across the survey: each a thirtieth of the shortest length-scale that is ever fitted."""
COARSEST_M, FINEST_M = 1.0, 2.0**-10


def grid_step_m(span_m: float) -> float:
    """The grid of a survey `span_m` wide: the largest power of two, from 1 mm to 1 m, of which 32768 fit in it.

    1 m from 33 km on, 0.25 m at 10 km, 3 cm at 1 km. A position moves by at most 0.71 of it. ValueError for a
    span that is not positive and finite.
    """
    ideal = 2.0 ** math.floor(math.log2(positive("span_m", span_m) / STEPS_PER_SPAN))
    return min(max(ideal, FINEST_M), COARSEST_M)


def snapped(points: ArrayLike, step_m: float) -> FloatArray:
    """`points` (…, d) in metres, each at the nearest point of the grid. Exact: the step is a power of two.

    What is not finite stays so, for others to refuse.
    """
    with np.errstate(over="ignore"):
        result: FloatArray = np.rint(np.asarray(points, dtype=np.float64) / step_m) * step_m
    return result


def coarsest_step_m(points: FloatArray) -> float | None:
    """The largest power of two, at most 1 m, of which all coordinates are whole multiples.

    None if they are on no grid as coarse as 2⁻²⁰ m.
    """
    step = COARSEST_M
    while step >= 2.0**-20:
        if (np.remainder(points, step) == 0.0).all():
            return step
        step *= 0.5
    return None
