"""Temporal kernels: how alike the field is at two times, and how its state moves. One file each; `TEMPORAL` names all.

A kernel κ(t) with κ(0) = 1 is the first coordinate of a linear system z ← A(dt) z + noise whose stationary covariance
is the identity: the noise has covariance I − A Aᵀ (Hartikainen & Särkkä 2010, in scaled coordinates).
"""

from typing import ClassVar, Protocol

from autonomy.learning.numbers import FloatArray
from autonomy.learning.temporal.matern32 import MaternMotion
from autonomy.learning.temporal.ornstein_uhlenbeck import OrnsteinUhlenbeck
from autonomy.learning.temporal.static import Static

__all__ = ["TEMPORAL", "MaternMotion", "OrnsteinUhlenbeck", "Static", "TemporalKernel"]


class TemporalKernel(Protocol):
    """What a component asks of its temporal kernel; a frozen value, times in seconds of model time."""

    name: ClassVar[str]
    states: ClassVar[int]
    """Coordinates of z; the first is the field."""

    @property
    def timescale_s(self) -> float:
        """How long the field remembers; infinite if it does not move."""
        ...

    def transition(self, dt_s: float) -> FloatArray:
        """A(dt), shape (states, states), for dt ≥ 0."""
        ...

    def correlation(self, lag_s: FloatArray) -> FloatArray:
        """κ of absolute lags, elementwise."""
        ...

    def slope(self, lag_s: FloatArray) -> FloatArray:
        """∂κ/∂log τ, elementwise; zero for a field that does not move."""
        ...


TEMPORAL: dict[str, type[Static] | type[OrnsteinUhlenbeck] | type[MaternMotion]] = {
    kernel.name: kernel for kernel in (Static, OrnsteinUhlenbeck, MaternMotion)
}
