"""The squared-exponential kernel with one length-scale per axis (SE-ARD), and its hyperparameters.

Everything here is noise-free. Noise belongs to a *sample*, enters once, at the likelihood, and never hides
behind "x equals x'": a place visited twice would make the covariance of the readings singular.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def _positive(name: str, value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number, not {value!r:.60}") from None
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be positive and finite, not {value!r}")
    return number


@dataclass(frozen=True)
class Hyperparameters:
    """The kernel's parameters: variances in squared sensor units, length-scales in metres, one per axis.

    `timescale_s` is the decay time of the field's memory (Ornstein–Uhlenbeck); infinity means a still
    field. Raises ValueError for anything that is not positive, and for infinities anywhere but in
    `timescale_s`.
    """

    signal_variance: float
    noise_variance: float
    lengthscales_m: tuple[float, ...]
    timescale_s: float = math.inf

    def __post_init__(self) -> None:
        scales = cast(object, self.lengthscales_m)
        if isinstance(scales, str) or not isinstance(scales, Iterable):
            raise ValueError(
                f"lengthscales_m must be a sequence, one number per axis, e.g. (500.0, 500.0), not {scales!r}"
            )
        checked = tuple(_positive(f"lengthscales_m[{i}]", value) for i, value in enumerate(scales))
        if not checked:
            raise ValueError("lengthscales_m is empty: give one length-scale per axis, e.g. (500.0, 500.0)")
        object.__setattr__(self, "signal_variance", _positive("signal_variance", self.signal_variance))
        object.__setattr__(self, "noise_variance", _positive("noise_variance", self.noise_variance))
        object.__setattr__(self, "lengthscales_m", checked)
        if self.timescale_s != math.inf:
            object.__setattr__(self, "timescale_s", _positive("timescale_s", self.timescale_s))

    @property
    def dimensions(self) -> int:
        """Number of axes of the input."""
        return len(self.lengthscales_m)


def as_points(points: ArrayLike, dimensions: int, name: str = "points") -> FloatArray:
    """`points` as a finite float64 array of shape (N, dimensions); ValueError says what is wrong."""
    try:
        array = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers: {error}") from None
    if array.ndim != 2 or array.shape[1] != dimensions:
        raise ValueError(f"{name} must have shape (N, {dimensions}), not {array.shape}")
    _require_finite(array, name)
    return array


def as_vector(values: ArrayLike, name: str, length: int | None = None) -> FloatArray:
    """`values` as a finite float64 array of shape (length,); ValueError says what is wrong."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be an array of numbers: {error}") from None
    if array.ndim != 1 or (length is not None and array.shape != (length,)):
        raise ValueError(f"{name} must have shape ({'N' if length is None else length},), not {array.shape}")
    _require_finite(array, name)
    return array


def _require_finite(array: FloatArray, name: str) -> None:
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0]
        raise ValueError(f"{name}{where.tolist()} is {array[tuple(where)]}: every number must be finite")


def covariance(a: FloatArray, b: FloatArray, h: Hyperparameters) -> FloatArray:
    """Noise-free covariance of the field between `a` (n, d) and `b` (k, d): shape (n, k)."""
    exponent = np.zeros((len(a), len(b)))
    for axis, lengthscale in enumerate(h.lengthscales_m):
        # Differences first: |a|² + |b|² − 2ab would cancel at coordinates of 1e5 m and length-scales of
        # 10 m.
        difference = np.subtract.outer(a[:, axis] / lengthscale, b[:, axis] / lengthscale)
        np.multiply(difference, difference, out=difference)
        exponent += difference
    exponent *= -0.5
    np.exp(exponent, out=exponent)
    exponent *= h.signal_variance
    return exponent


def axis_factor(centres: FloatArray, axis: FloatArray, lengthscale_m: float) -> FloatArray:
    """The kernel's factor along one axis, shape (len(centres), len(axis)), without the signal variance.

    On a grid the kernel is the product of such factors, so a map needs exponentials along its two edges
    only.
    """
    difference = np.subtract.outer(centres / lengthscale_m, axis / lengthscale_m)
    factor: FloatArray = np.exp(-0.5 * difference * difference)
    return factor
