"""Checked numbers and arrays: what comes in from outside is finite and has the right shape, or is refused."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def positive(name: str, value: float) -> float:
    """`value` as a positive finite float; ValueError, naming it, for anything else."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be a number, not {value!r:.60}") from None
    if not (math.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be positive and finite, not {value!r}")
    return number


def positive_variance(values: FloatArray) -> float:
    """The variance of `values` (n,), n ≥ 1; something tiny but positive if they do not vary."""
    scale = float(np.abs(values).max()) or 1.0
    return max(float(values.var()), (1e-9 * scale) ** 2)


def lengthscales(values: object) -> tuple[float, ...]:
    """`values` as a tuple of positive length-scales in metres, one per axis; ValueError for anything else."""
    if isinstance(values, str) or not hasattr(values, "__iter__"):
        raise ValueError(
            f"lengthscales_m must be a sequence, one number per axis, e.g. (500.0, 500.0), not {values!r}"
        )
    checked = tuple(positive(f"lengthscales_m[{i}]", value) for i, value in enumerate(values))
    if not checked:
        raise ValueError("lengthscales_m is empty: give one length-scale per axis, e.g. (500.0, 500.0)")
    return checked


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
