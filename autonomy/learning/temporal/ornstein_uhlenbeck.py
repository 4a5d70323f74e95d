"""A field that forgets: rough in time, as water that mixes."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from autonomy.learning.numbers import FloatArray, positive


@dataclass(frozen=True)
class OrnsteinUhlenbeck:
    """κ(t) = exp(−|t|/τ) (Rasmussen & Williams 2006, section 4.2.1: the Matérn kernel with ν = 1/2)."""

    timescale_s: float
    name: ClassVar[str] = "ornstein_uhlenbeck"
    states: ClassVar[int] = 1

    def __post_init__(self) -> None:
        object.__setattr__(self, "timescale_s", positive("timescale_s", self.timescale_s))

    def transition(self, dt_s: float) -> FloatArray:
        """exp(−dt/τ)."""
        return np.array([[math.exp(-dt_s / self.timescale_s)]])

    def correlation(self, lag_s: FloatArray) -> FloatArray:
        """exp(−|t|/τ)."""
        result: FloatArray = np.exp(-lag_s / self.timescale_s)
        return result

    def slope(self, lag_s: FloatArray) -> FloatArray:
        """∂κ/∂log τ = (t/τ) exp(−t/τ)."""
        u = lag_s / self.timescale_s
        result: FloatArray = u * np.exp(-u)
        return result
