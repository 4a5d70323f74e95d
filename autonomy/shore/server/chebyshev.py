"""Smooth functions of two variables on a fine grid, from their values at few places.

A function that is analytic is reproduced by the polynomial through its values at Chebyshev's points with an error that
falls geometrically with their number (Trefethen, Approximation Theory and Approximation Practice, 2013, ch. 8).
"""

from collections.abc import Callable

import numpy as np

from autonomy.geometry import FloatArray


def points(low: float, high: float, count: int) -> FloatArray:
    """Chebyshev's points of the first kind in [low, high], shape (count,), descending."""
    angles = np.pi * (np.arange(count) + 0.5) / count
    placed: FloatArray = 0.5 * (low + high) + 0.5 * (high - low) * np.cos(angles)
    return placed


def interpolation(low: float, high: float, count: int, places: FloatArray) -> FloatArray:
    """Matrix (len(places), count) from values at `points` to values of their polynomial at places in [low, high]."""
    scaled = np.clip((2.0 * places - low - high) / (high - low), -1.0, 1.0)
    degrees = np.arange(count)
    # The polynomial's coefficients are a cosine transform of its values at the points.
    to_coefficients = np.cos(np.outer(degrees, np.pi * (degrees + 0.5) / count)) * (2.0 / count)
    to_coefficients[0] *= 0.5
    matrix: FloatArray = np.cos(np.outer(np.arccos(scaled), degrees)) @ to_coefficients
    return matrix


def on_grid(
    function: Callable[[FloatArray, FloatArray], FloatArray],
    rows: FloatArray,
    columns: FloatArray,
    counts: tuple[int, int],
    checks: int,
) -> tuple[FloatArray, FloatArray]:
    """Several functions on a grid, and how far they are out at some of its cells.

    Args:
        function: of two arrays (n,) of places, gives the functions' values there, shape (k, n).
        rows: first coordinate of the grid's rows, at least two, monotonic.
        columns: second coordinate of its columns, likewise.
        counts: of points along each.
        checks: cells, spread over the grid, at which the result is compared with the functions themselves.

    Returns:
        Values, shape (k, rows, columns), and the largest error of each function, shape (k,).
    """
    ends = [(float(axis.min()), float(axis.max())) for axis in (rows, columns)]
    nodes = [points(*end, count) for end, count in zip(ends, counts, strict=True)]
    first, second = (
        interpolation(*end, count, axis)
        for end, count, axis in zip(ends, counts, (rows, columns), strict=True)
    )
    a, b = (each.ravel() for each in np.meshgrid(*nodes, indexing="ij"))
    i, j = _spread(checks, len(rows), len(columns))
    known = function(np.concatenate([a, rows[i]]), np.concatenate([b, columns[j]]))
    values = first @ known[:, : len(a)].reshape(-1, *counts) @ second.T
    return values, np.abs(values[:, i, j] - known[:, len(a) :]).max(axis=1)


def _spread(count: int, rows: int, columns: int) -> tuple[FloatArray, FloatArray]:
    """Cells spread evenly without falling into line: the R2 sequence of the plastic number (Roberts 2018)."""
    number = np.arange(1, count + 1)[:, None] * np.array([0.7548776662466927, 0.5698402909980532]) % 1.0
    cells = (number * [rows, columns]).astype(np.intp)
    return cells[:, 0], cells[:, 1]
