"""The Matérn-3/2 kernel: (1 + √(3s)) exp(−√(3s)), for fields with fronts."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from autonomy.learning.numbers import FloatArray, lengthscales


@dataclass(frozen=True)
class Matern32:
    """(1 + u) exp(−u) with u = √(3s) and one length-scale per axis (Rasmussen & Williams 2006, eq. 4.17)."""

    lengthscales_m: tuple[float, ...]
    name: ClassVar[str] = "matern32"
    separable: ClassVar[bool] = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengthscales_m", lengthscales(self.lengthscales_m))

    def correlation(self, squared: FloatArray) -> FloatArray:
        """(1 + u) exp(−u); overwrites its argument."""
        u = np.multiply(squared, 3.0, out=squared)
        np.sqrt(u, out=u)
        decay = np.exp(-u)
        u += 1.0
        u *= decay
        return u

    def slope(self, squared: FloatArray) -> FloatArray:
        """−2 dg/ds = 3 exp(−u)."""
        result: FloatArray = 3.0 * np.exp(-np.sqrt(3.0 * squared))
        return result
