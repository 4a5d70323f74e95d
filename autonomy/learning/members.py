"""The basis vectors: where they are, and what they were added with. Oldest first."""

import numpy as np

from autonomy.learning.kernel import Group
from autonomy.learning.numbers import FloatArray

IntArray = np.ndarray[tuple[int], np.dtype[np.int64]]


class Members:
    """A list of basis vectors that grows at the end and may lose any."""

    def __init__(self, groups: tuple[Group, ...], dimensions: int) -> None:
        self._points = np.zeros((0, dimensions))
        self._readings = np.zeros(0)
        self._counts = np.zeros(0)
        self._births = np.zeros(0, dtype=np.int64)
        self._components = [
            [
                (component, 1.0 / np.array(component.space.lengthscales_m)[:, None])
                for component in group.components
            ]
            for group in groups
        ]
        self._scale()

    def __len__(self) -> int:
        return len(self._points)

    @property
    def points(self) -> FloatArray:
        """(m, d), metres."""
        return self._points

    @property
    def readings(self) -> FloatArray:
        """(m,), sensor units."""
        return self._readings

    @property
    def counts(self) -> FloatArray:
        """(m,): of how many readings each of `readings` is the mean."""
        return self._counts

    @property
    def births(self) -> IntArray:
        """(m,): how many updates there had been."""
        return self._births

    def fill(self, points: FloatArray, readings: FloatArray, counts: FloatArray, birth: int) -> None:
        """Replace all: `points` (m, d), `readings` (m,), `counts` (m,), born alike."""
        self._points, self._readings, self._counts = points.copy(), readings.copy(), counts.copy()
        self._births = np.full(len(points), birth, dtype=np.int64)
        self._scale()

    def append(self, point: FloatArray, reading: float, count: float, birth: int) -> None:
        """Add one at the end."""
        self._points = np.concatenate((self._points, point[None]))
        self._readings = np.append(self._readings, reading)
        self._counts = np.append(self._counts, count)
        self._births = np.append(self._births, birth)
        self._scale()

    def replace(self, index: int, point: FloatArray, reading: float, count: float, birth: int) -> None:
        """Remove one and add another at the end."""
        for array, entry in (
            (self._points, point),
            (self._readings, reading),
            (self._counts, count),
            (self._births, birth),
        ):
            array[index:-1] = array[index + 1 :]
            array[-1] = entry
        self._scale()

    def remove(self, index: int) -> None:
        """Remove one."""
        self._points = np.delete(self._points, index, axis=0)
        self._readings = np.delete(self._readings, index)
        self._counts = np.delete(self._counts, index)
        self._births = np.delete(self._births, index)
        self._scale()

    def covariance(self, group: int, point: FloatArray, out: FloatArray) -> None:
        """k_g(B, x) into `out` (m,) for one `point` (d,)."""
        column = point[:, None]
        (component, inverse), *others = self._components[group]
        difference = self._scaled[group][0] - column * inverse
        k = component.space.correlation(np.einsum("ij,ij->j", difference, difference))
        np.multiply(k, component.variance, out=out)
        for i, (component, inverse) in enumerate(others, 1):
            difference = self._scaled[group][i] - column * inverse
            k = component.space.correlation(np.einsum("ij,ij->j", difference, difference))
            k *= component.variance
            out += k

    def _scale(self) -> None:
        """The coordinates in units of each component's length-scales, (d, m) each."""
        rows = np.ascontiguousarray(self._points.T)
        self._scaled = [[rows * inverse for _, inverse in components] for components in self._components]
