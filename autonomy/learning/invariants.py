"""What must hold of a whitened posterior whatever it has learnt, and how to see that it does."""

import math

import numpy as np
from scipy.linalg.lapack import dpotrf

from autonomy.learning.numbers import FloatArray

# How far outside [0, 1] rounding may leave an eigenvalue of S. Variances are off by no more than that share of
# σf², far below what a map or a plan can tell.
TOLERANCE = 1e-6


def broken_variances(diagonal: FloatArray) -> str | None:
    """What is wrong with `diagonal` (D,), the variances of S; None if nothing is. Next to free."""
    low, high = float(np.minimum.reduce(diagonal)), float(np.maximum.reduce(diagonal))
    if low >= -TOLERANCE and high <= 1.0 + TOLERANCE:
        return None
    return f"the state's variances reach from {low:.9g} to {high:.9g}, outside [0, 1]"


def broken_prediction(innovation: float, spread: float, variance: float, signal: float) -> str | None:
    """What is wrong with a reading's prediction: its `innovation`, of which the basis contributes `spread` to the
    `variance`; None if nothing is.

    `spread` is aᵀSa with |a|² ≤ `signal`, so it tells the eigenvalues of S in the one direction that matters now.
    """
    slack = TOLERANCE * signal
    if math.isfinite(innovation) and -slack <= spread <= signal + slack and 0.0 < variance < math.inf:
        return None
    return (
        f"a reading's innovation was {innovation:.9g} with variance {variance:.9g}, of which the state gave "
        f"{spread:.9g} where between 0 and {signal:.9g} is possible"
    )


def broken(state: FloatArray) -> str | None:
    """What is wrong with `state` (D + 1, D), S and below it μ; None if nothing is. O(D³).

    Finite, symmetric, the eigenvalues of S in [0, 1]: two attempts at a Cholesky factor tell.
    """
    size = state.shape[1]
    if not np.isfinite(state).all():
        row, column = np.argwhere(~np.isfinite(state))[0].tolist()
        what = f"mean[{column}]" if row == size else f"covariance[{row}, {column}]"
        return f"the state's {what} is {state[row, column]}"
    # All in column order, or most of the time would go into copies.
    S = state[:-1].copy(order="F")
    skew = float(np.abs(S - S.T.copy(order="F")).max(initial=0.0))
    if skew > TOLERANCE:
        return f"the state's covariance is not symmetric: it differs from its transpose by {skew:.3g}"
    for matrix, least, what in ((S, 0.0, "negative"), (-S, -1.0, "above 1, the prior's")):
        matrix.ravel(order="K")[:: size + 1] += TOLERANCE - least
        if size and dpotrf(matrix, lower=1, overwrite_a=1)[1]:
            return f"the state's covariance has an eigenvalue that is {what}"
    return None
