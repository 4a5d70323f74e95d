"""What must hold of a whitened posterior whatever it has learnt, and how to see that it does."""

import numpy as np
from scipy.linalg.lapack import dpotrf

from autonomy.learning.numbers import FloatArray

# How far outside [0, 1] rounding may leave an eigenvalue of S. Variances are off by no more than that share of
# σf², far below what a map or a plan can tell.
TOLERANCE = 1e-6


def broken(state: FloatArray) -> str | None:
    """What is wrong with `state` (D + 1, D), S and below it μ; None if nothing is. O(D³).

    Finite, symmetric, the eigenvalues of S in [0, 1]: two attempts at a Cholesky factor tell.
    """
    S, size = state[:-1], state.shape[1]
    if not np.isfinite(state).all():
        row, column = np.argwhere(~np.isfinite(state))[0].tolist()
        what = f"mean[{column}]" if row == size else f"covariance[{row}, {column}]"
        return f"the state's {what} is {state[row, column]}"
    skew = float(np.abs(S - S.T).max(initial=0.0))
    if skew > TOLERANCE:
        return f"the state's covariance is not symmetric: it differs from its transpose by {skew:.3g}"
    identity = np.eye(size)
    for matrix, what in (
        (S + TOLERANCE * identity, "negative"),
        ((1.0 + TOLERANCE) * identity - S, "above 1, the prior's"),
    ):
        if size and dpotrf(matrix, lower=1, overwrite_a=1)[1]:
            return f"the state's covariance has an eigenvalue that is {what}"
    return None
