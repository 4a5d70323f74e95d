"""The newest observations in forty bytes each, on board and ashore."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from autonomy.quality import Check
from autonomy.wire_values import ObservationNotice

_ROW = np.dtype(
    [
        ("time", "f8"),
        ("lat", "f8"),
        ("lon", "f8"),
        ("value", "f8"),
        ("flag", "u1"),
        ("checks", "u1", (len(Check),)),
    ]
)


class ObservationRing:
    """Keeps so many; of more than that the oldest are dropped. Memory is taken as it is needed."""

    def __init__(self, capacity: int) -> None:
        if capacity < 1:
            raise ValueError(f"at least one observation must be kept, not {capacity}")
        self._rows = np.zeros(capacity, _ROW)
        self.end = 0
        """How many were ever put in: they are numbered from 0."""

    @property
    def oldest(self) -> int:
        """Number of the oldest that is kept."""
        return max(0, self.end - len(self._rows))

    def append(self, one: ObservationNotice) -> None:
        """Put the next one in."""
        place = (one.model_time_s, one.lat_deg, one.lon_deg, one.value)
        self._rows[self.end % len(self._rows)] = (*place, one.flag, one.checks)
        self.end += 1

    def rows(self, first: int, last: int) -> NDArray[np.void]:
        """A copy of those numbered from `first` to before `last`, which must be kept; for `notices`."""
        copied: NDArray[np.void] = self._rows[np.arange(first, last) % len(self._rows)]
        return copied


def notices(rows: NDArray[np.void]) -> tuple[ObservationNotice, ...]:
    """The observations in rows."""
    values: Iterable[tuple[float, float, float, float, int, list[int]]] = rows.tolist()
    return tuple(
        ObservationNotice(time_s, lat_deg, lon_deg, value, flag, tuple(map(int, checks)))
        for time_s, lat_deg, lon_deg, value, flag, checks in values
    )
