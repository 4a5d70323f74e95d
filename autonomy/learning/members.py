"""The basis vectors: where they are, and what they were added with. Oldest first."""

import numpy as np
from numpy.typing import NDArray

from autonomy.learning import arithmetic
from autonomy.learning.kernel import Group
from autonomy.learning.numbers import FloatArray

IntArray = NDArray[np.int64]


class Members:
    """A list of basis vectors that grows at the end and may lose any.

    One table (rows, m) holds a column for each: coordinates in metres, reading, count, birth, and the
    coordinates in units of the length-scales of every component, group by group. So they move together.
    """

    def __init__(self, groups: tuple[Group, ...], dimensions: int) -> None:
        self._dimensions = dimensions
        self._groups = tuple(
            tuple((component.space, component.variance) for component in group.components) for group in groups
        )
        scales = [component.space.lengthscales_m for group in groups for component in group.components]
        self._recipe = _recipe(groups)
        self._inverse = 1.0 / np.array(scales).ravel()
        self._axes = np.tile(np.arange(dimensions), len(scales))
        self._table = np.zeros((dimensions + 3 + len(self._inverse), 0))

    def __len__(self) -> int:
        return self._table.shape[1]

    @property
    def points(self) -> FloatArray:
        """(m, d), metres."""
        result: FloatArray = self._table[: self._dimensions].T.copy()
        return result

    @property
    def readings(self) -> FloatArray:
        """(m,), in the units of what was learnt."""
        result: FloatArray = self._table[self._dimensions].copy()
        return result

    @property
    def counts(self) -> FloatArray:
        """(m,): of how many readings each of `readings` is the mean."""
        result: FloatArray = self._table[self._dimensions + 1].copy()
        return result

    @property
    def births(self) -> IntArray:
        """(m,): how many updates there had been."""
        result: IntArray = self._table[self._dimensions + 2].astype(np.int64)
        return result

    def append(self, point: FloatArray, reading: float, count: float, birth: int) -> None:
        """Add one at the end: `point` (d,), `reading`, of how many it is the mean, when it was born."""
        column = self._column(point, reading, count, birth)
        self._table = np.concatenate((self._table, column[:, None]), axis=1)

    def replace(self, index: int, point: FloatArray, reading: float, count: float, birth: int) -> None:
        """Remove one and add another at the end."""
        self._table[:, index:-1] = self._table[:, index + 1 :]
        self._table[:, -1] = self._column(point, reading, count, birth)

    def remove(self, index: int) -> None:
        """Remove one."""
        self._table = np.delete(self._table, index, axis=1)

    def covariances(self, point: FloatArray, parts: list[FloatArray]) -> None:
        """k_g(B, x) of each group into the first m entries of its own of `parts`, for one `point` (d,)."""
        m, first = self._table.shape[1], self._dimensions + 3
        here = self._scaled(point)
        if arithmetic.covariances is not None and self._recipe is not None:
            for part in parts:
                part[:m] = 0.0
            arithmetic.covariances(self._table, first, here, self._recipe, parts)
            return
        coordinates = iter(zip(self._table[first:], here.tolist(), strict=True))
        for part, components in zip(parts, self._groups, strict=True):
            out = part[:m]
            for i, (space, variance) in enumerate(components):
                row, here = next(coordinates)
                squared = row - here
                squared *= squared
                for _ in range(1, self._dimensions):
                    row, here = next(coordinates)
                    difference = row - here
                    difference *= difference
                    squared += difference
                k = space.correlation(squared)
                if i:
                    k *= variance
                    out += k
                else:
                    np.multiply(k, variance, out=out)

    def _scaled(self, point: FloatArray) -> FloatArray:
        """`point` (d,) in units of the length-scales of every component, one after the other."""
        scaled: FloatArray = point[self._axes] * self._inverse
        return scaled

    def _column(self, point: FloatArray, reading: float, count: float, birth: int) -> FloatArray:
        return np.concatenate((point, (reading, count, birth), self._scaled(point)))


def _recipe(groups: tuple[Group, ...]) -> FloatArray | None:
    """What the compiled covariances need to know of the components; None if they don't know one of the kernels."""
    columns = [
        (g, arithmetic.KINDS.get(component.space.name, np.nan), component.variance)
        for g, group in enumerate(groups)
        for component in group.components
    ]
    recipe = np.array(columns, order="C").T
    return None if np.isnan(recipe).any() else recipe
