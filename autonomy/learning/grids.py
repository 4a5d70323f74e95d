"""The covariance between basis vectors and the cells of a grid: no exponential per cell if the kernel separates."""

import numpy as np

from autonomy.learning.kernel import Component, Group
from autonomy.learning.numbers import FloatArray


class GridCovariance:
    """k_g(B, cells) of one group for a strip of a grid: all its rows, the columns `x_axis`.

    `basis` (m, 2). What depends on the columns alone is computed once.
    """

    def __init__(self, group: Group, basis: FloatArray, x_axis: FloatArray) -> None:
        self._components = group.components
        self._basis = basis
        self._east = [self._along(component, 0, x_axis) for component in group.components]

    def fill(self, out: FloatArray, y_axis: FloatArray, scratch: FloatArray) -> None:
        """The covariance with the cells of the rows `y_axis` into `out` (m, rows, columns); `scratch` likewise."""
        for i, (component, east) in enumerate(zip(self._components, self._east, strict=True)):
            into = scratch if i else out
            north = self._along(component, 1, y_axis)[:, :, None]
            if component.space.separable:
                north *= component.variance
                np.multiply(north, east[:, None, :], out=into)
            else:
                np.add(north, east[:, None, :], out=into)
                result = component.space.correlation(into)
                np.multiply(result, component.variance, out=into)
            if i:
                out += into

    def product(self, weights: FloatArray, y_axis: FloatArray) -> FloatArray | None:
        """weightsᵀ k_g (rows, columns) by one small matrix product for each component; None if one is not separable."""
        if not all(component.space.separable for component in self._components):
            return None
        total = np.zeros((len(y_axis), self._east[0].shape[1]))
        for component, east in zip(self._components, self._east, strict=True):
            north = self._along(component, 1, y_axis)
            north *= (component.variance * weights)[:, None]
            total += north.T @ east
        return total

    def _along(self, component: Component, axis: int, places: FloatArray) -> FloatArray:
        """What one axis contributes (m, len(places)): its correlation if the kernel separates, else to s."""
        scale = component.space.lengthscales_m[axis]
        squared = np.subtract.outer(self._basis[:, axis] / scale, places / scale)
        squared *= squared
        return component.space.correlation(squared) if component.space.separable else squared
