"""How sure the readings make us of the field's variance, and how much of it to believe in while they do not.

A fit takes the most probable signal variance. Where a survey has only begun, that is the variance of the piece of sea
it happens to have seen: intervals elsewhere would be far too narrow (measured on real fields: 65 % of the values inside
the 95 % interval after a tenth of a survey). The variance alone is therefore raised, by the more the less is known of
it; shares, length-scales, time-scales and noise stay, so that the map itself hardly changes.
"""

import math

import numpy as np

from autonomy.learning.kernel import Kernel
from autonomy.learning.numbers import FloatArray

# Chosen on 56 surveys of real and synthetic fields: with 4 the 95 % intervals hold .91 to .975 of the values in every
# tenth of them; with 3 too few in the second, with 0 (the most probable variance) .74 there and .865 of all.
# See docs/decisions/0004.
_PER_DOUBT = 4.0
# So that a fit which tells next to nothing raises the variance by no more than a factor of 400.
_MOST_DOUBT = 1.5


def cautious(kernel: Kernel, doubt: float) -> Kernel:
    """`kernel` with its signal variance × exp(4·doubt), where `doubt` is the posterior variance of its logarithm."""
    return kernel.scaled(math.exp(_PER_DOUBT * min(doubt, _MOST_DOUBT)), 1.0)


def posterior_variance(precision: FloatArray, widest: float) -> float:
    """Laplace: the first parameter's variance, from the negative Hessian (p, p) of the log posterior at its summit.

    At a bound or on a ridge the Hessian may not be positive; no direction counts as less known than `widest`, twice
    the widest prior's standard deviation.
    """
    values, vectors = np.linalg.eigh(0.5 * (precision + precision.T))
    return float(vectors[0] ** 2 @ (1.0 / np.maximum(values, widest**-2)))
