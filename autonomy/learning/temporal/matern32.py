"""A field that moves smoothly: its rate of change is part of the state."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from autonomy.learning.numbers import FloatArray, positive


@dataclass(frozen=True)
class MaternMotion:
    """Matérn-3/2 in time: κ(t) = (1 + λt) exp(−λt) with λ = √3/τ; z = (f, f′/λ).

    Rasmussen & Williams 2006, eq. 4.17; as a linear system Hartikainen & Särkkä 2010.
    """

    timescale_s: float
    name: ClassVar[str] = "matern32_motion"
    states: ClassVar[int] = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "timescale_s", positive("timescale_s", self.timescale_s))

    def transition(self, dt_s: float) -> FloatArray:
        """exp(−λdt)·[[1 + λdt, λdt], [−λdt, 1 − λdt]]."""
        u = math.sqrt(3.0) * dt_s / self.timescale_s
        return math.exp(-u) * np.array([[1.0 + u, u], [-u, 1.0 - u]])

    def correlation(self, lag_s: FloatArray) -> FloatArray:
        """(1 + λt) exp(−λt)."""
        u = math.sqrt(3.0) * lag_s / self.timescale_s
        result: FloatArray = (1.0 + u) * np.exp(-u)
        return result

    def slope(self, lag_s: FloatArray) -> FloatArray:
        """∂κ/∂log τ = (λt)² exp(−λt)."""
        u = math.sqrt(3.0) * lag_s / self.timescale_s
        result: FloatArray = u * u * np.exp(-u)
        return result
