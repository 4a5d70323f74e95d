"""A field that does not move."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from autonomy.learning.numbers import FloatArray


@dataclass(frozen=True)
class Static:
    """κ = 1 for ever."""

    name: ClassVar[str] = "static"
    states: ClassVar[int] = 1

    @property
    def timescale_s(self) -> float:
        """Infinite."""
        return math.inf

    def transition(self, dt_s: float) -> FloatArray:
        """The identity."""
        return np.ones((1, 1))

    def correlation(self, lag_s: FloatArray) -> FloatArray:
        """Ones."""
        return np.ones_like(lag_s)

    def slope(self, lag_s: FloatArray) -> FloatArray:
        """Zeros: there is no time-scale."""
        return np.zeros_like(lag_s)
