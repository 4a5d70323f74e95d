"""Spatial kernels: how alike the field is at two places. One file each; `SPATIAL` names them all.

A kernel here is a correlation g(s) of the squared scaled distance s = Σ ((x_i − x'_i)/l_i)²: 1 at s = 0. Variance and
time belong to the component that uses it.
"""

from typing import ClassVar, Protocol

from autonomy.learning.numbers import FloatArray
from autonomy.learning.spatial.matern32 import Matern32
from autonomy.learning.spatial.squared_exponential import SquaredExponential

__all__ = ["SPATIAL", "Matern32", "SpatialKernel", "SquaredExponential"]


class SpatialKernel(Protocol):
    """What a component asks of its spatial kernel; a frozen value, one length-scale per axis, in metres."""

    name: ClassVar[str]
    separable: ClassVar[bool]
    """Whether g factorises over the axes, so that a map needs g along its two edges only."""

    @property
    def lengthscales_m(self) -> tuple[float, ...]:
        """One per axis."""
        ...

    def correlation(self, squared: FloatArray) -> FloatArray:
        """g(s), elementwise. The argument may be overwritten by the result."""
        ...

    def slope(self, squared: FloatArray) -> FloatArray:
        """−2 dg/ds, elementwise: ∂g/∂log l_i is this times ((x_i − x'_i)/l_i)². Keeps the argument."""
        ...


SPATIAL: dict[str, type[SquaredExponential] | type[Matern32]] = {
    kernel.name: kernel for kernel in (SquaredExponential, Matern32)
}
