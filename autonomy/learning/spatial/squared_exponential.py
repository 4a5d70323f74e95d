"""The squared-exponential kernel (the paper's): exp(−s/2), for fields that are smooth everywhere."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from autonomy.learning.numbers import FloatArray, lengthscales


@dataclass(frozen=True)
class SquaredExponential:
    """exp(−s/2) with one length-scale per axis (SE-ARD; Rasmussen & Williams 2006, eq. 4.9)."""

    lengthscales_m: tuple[float, ...]
    name: ClassVar[str] = "squared_exponential"
    separable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengthscales_m", lengthscales(self.lengthscales_m))

    def correlation(self, squared: FloatArray) -> FloatArray:
        """exp(−s/2); overwrites its argument."""
        np.multiply(squared, -0.5, out=squared)
        return np.exp(squared, out=squared)

    def slope(self, squared: FloatArray) -> FloatArray:
        """−2 d/ds exp(−s/2) = exp(−s/2)."""
        result: FloatArray = np.exp(-0.5 * squared)
        return result
