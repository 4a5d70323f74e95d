"""The vehicle's own clock as UTC, run by run of its software."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from autonomy.geometry import FloatArray

_STEP_S = 0.01
"""Smaller changes of the difference are not worth remembering."""


class Clock:
    """Differences between UTC and the vehicle's clock, as its models and its reports of health tell them.

    The vehicle's clock runs on evenly within a run, so a difference holds until another one is told, and the first
    one holds for what was before it too. Nothing else dates anything: where the vehicle never knew UTC, times are NaN,
    unless arrivals are let date them.
    """

    def __init__(self) -> None:
        self._told: dict[int, list[tuple[float, float]]] = {}
        self._arrived: dict[int, float] = {}
        self.by_arrival = False

    def tell(self, run: int, model_time_s: float, utc_s: float) -> None:
        """The vehicle says that its clock showed `model_time_s` at `utc_s`."""
        told, difference_s = self._told.setdefault(run, []), utc_s - model_time_s
        if not told or abs(told[-1][1] - difference_s) > _STEP_S:
            told.append((model_time_s, difference_s))

    def arrived(self, run: int, model_time_s: float, received_utc_s: float) -> None:
        """Something of that moment arrived then; of many, the one least delayed counts."""
        difference_s = received_utc_s - model_time_s
        self._arrived[run] = min(difference_s, self._arrived.get(run, difference_s))

    def knows(self, run: int) -> bool:
        """Whether the vehicle told the difference in a run."""
        return run in self._told

    def utc(self, run: int, model_time_s: ArrayLike) -> FloatArray:
        """Seconds since 1970 of moments of a run, as many; NaN where nothing dates them."""
        times: FloatArray = np.asarray(model_time_s, dtype=float)
        told: Sequence[tuple[float, float]] = sorted(self._told.get(run, ()))
        if not told:
            return times + (self._arrived.get(run, np.nan) if self.by_arrival else np.nan)
        starts, differences = np.transpose(told)
        rows: NDArray[np.intp] = np.maximum(np.searchsorted(starts, times, side="right") - 1, 0)
        dated: FloatArray = times + differences[rows]
        return dated

    def moment(self, run: int, model_time_s: float | None, received_utc_s: float) -> float:
        """When something was that says no time itself: as late as what came before it, if anything did."""
        return received_utc_s if model_time_s is None else float(self.utc(run, model_time_s))

    @property
    def guesses(self) -> bool:
        """Whether there are runs that only arrivals can date."""
        return not self._arrived.keys() <= self._told.keys()
