"""The field as a sum of components, each a variance times a spatial times a temporal kernel.

Everything here is noise-free. Noise belongs to a *sample*, enters once, at the likelihood, and never hides
behind "x equals x'": a place visited twice would make the covariance of the readings singular.
"""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from autonomy.learning.numbers import FloatArray, lengthscales, positive
from autonomy.learning.spatial import SpatialKernel, SquaredExponential
from autonomy.learning.temporal import OrnsteinUhlenbeck, Static, TemporalKernel


@dataclass(frozen=True)
class Component:
    """One summand of the field: `variance` (squared units of what is learnt) × spatial × temporal correlation."""

    variance: float
    space: SpatialKernel
    time: TemporalKernel = field(default_factory=Static)

    def __post_init__(self) -> None:
        object.__setattr__(self, "variance", positive("variance", self.variance))

    def covariance(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Covariance at one moment between the places `a` (n, d) and `b` (k, d): shape (n, k)."""
        result = self.space.correlation(squared_distances(a, b, self.space.lengthscales_m))
        result *= self.variance
        return result


@dataclass(frozen=True)
class Group:
    """The components that move alike: in the filter they share one state, whose prior is the sum of their kernels."""

    time: TemporalKernel
    components: tuple[Component, ...]

    @property
    def variance(self) -> float:
        """Their variance together."""
        return math.fsum(component.variance for component in self.components)

    def covariance(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Covariance at one moment between the places `a` (n, d) and `b` (k, d): shape (n, k)."""
        result = self.components[0].covariance(a, b)
        for component in self.components[1:]:
            result += component.covariance(a, b)
        return result


@dataclass(frozen=True)
class Kernel:
    """What is believed of the field before any reading, and the noise of one reading.

    Raises ValueError for components that disagree about the number of axes, and for none.
    """

    components: tuple[Component, ...]
    noise_variance: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "components", tuple(self.components))
        object.__setattr__(self, "noise_variance", positive("noise_variance", self.noise_variance))
        if not self.components:
            raise ValueError("a kernel needs at least one component")
        axes = {len(component.space.lengthscales_m) for component in self.components}
        if len(axes) != 1:
            raise ValueError(f"all components need the same number of axes, not {sorted(axes)}")

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The components by how they move, in the order in which each way of moving first occurs."""
        ways = dict.fromkeys(component.time for component in self.components)
        return tuple(
            Group(time, tuple(component for component in self.components if component.time == time))
            for time in ways
        )

    @property
    def dimensions(self) -> int:
        """Number of axes of the input."""
        return len(self.components[0].space.lengthscales_m)

    @property
    def states(self) -> int:
        """Coordinates of the filter's state per basis vector."""
        return sum(group.time.states for group in self.groups)

    @property
    def signal_variance(self) -> float:
        """Variance of the field: that of all components together."""
        return math.fsum(component.variance for component in self.components)

    @property
    def is_static(self) -> bool:
        """Whether nothing moves."""
        return all(math.isinf(component.time.timescale_s) for component in self.components)

    @property
    def hyperparameters(self) -> "Hyperparameters":
        """The same as `Hyperparameters`; ValueError unless it is one squared-exponential component (OU or static)."""
        component = self.components[0]
        plain = isinstance(component.space, SquaredExponential) and isinstance(
            component.time, Static | OrnsteinUhlenbeck
        )
        if len(self.components) != 1 or not plain:
            raise ValueError("only one squared-exponential component, static or OU, has Hyperparameters")
        return Hyperparameters(
            component.variance,
            self.noise_variance,
            component.space.lengthscales_m,
            component.time.timescale_s,
        )

    def scaled(self, signal: float, noise: float) -> "Kernel":
        """This kernel with its signal variance × `signal` and its noise variance × `noise`."""
        components = tuple(replace(c, variance=c.variance * signal) for c in self.components)
        return Kernel(components, self.noise_variance * noise)

    def covariance(self, a: FloatArray, b: FloatArray, lag_s: FloatArray | None = None) -> FloatArray:
        """Covariance of the field between `a` (n, d) and `b` (k, d): shape (n, k).

        `lag_s`, absolute differences of time, shape (n, k); None if all is at one moment.
        """
        result = np.zeros((len(a), len(b)))
        for group in self.groups:
            part = group.covariance(a, b)
            if lag_s is not None and not math.isinf(group.time.timescale_s):
                part *= group.time.correlation(lag_s)
            result += part
        return result


@dataclass(frozen=True)
class Hyperparameters:
    """The paper's case in one value: one squared-exponential component, static or forgetting.

    Variances in squared units of what is learnt, length-scales in metres, one per axis. `timescale_s` is the decay time
    of the field's memory (Ornstein–Uhlenbeck); infinity means a still field. Raises ValueError for anything
    that is not positive, and for infinities anywhere but in `timescale_s`.
    """

    signal_variance: float
    noise_variance: float
    lengthscales_m: tuple[float, ...]
    timescale_s: float = math.inf

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengthscales_m", lengthscales(self.lengthscales_m))
        object.__setattr__(self, "signal_variance", positive("signal_variance", self.signal_variance))
        object.__setattr__(self, "noise_variance", positive("noise_variance", self.noise_variance))
        if self.timescale_s != math.inf:
            object.__setattr__(self, "timescale_s", positive("timescale_s", self.timescale_s))

    @property
    def dimensions(self) -> int:
        """Number of axes of the input."""
        return len(self.lengthscales_m)

    @property
    def kernel(self) -> Kernel:
        """The kernel of one component that this describes."""
        time = Static() if math.isinf(self.timescale_s) else OrnsteinUhlenbeck(self.timescale_s)
        component = Component(self.signal_variance, SquaredExponential(self.lengthscales_m), time)
        return Kernel((component,), self.noise_variance)


def as_kernel(kernel: Kernel | Hyperparameters) -> Kernel:
    """The kernel, whichever way it was given."""
    return kernel.kernel if isinstance(kernel, Hyperparameters) else kernel


def squared_distances(a: FloatArray, b: FloatArray, lengthscales_m: tuple[float, ...]) -> FloatArray:
    """s = Σ ((a_i − b_i)/l_i)² between `a` (n, d) and `b` (k, d): shape (n, k)."""
    total = np.zeros((len(a), len(b)))
    for axis, lengthscale in enumerate(lengthscales_m):
        # Differences first: |a|² + |b|² − 2ab would cancel at coordinates of 1e5 m and length-scales of
        # 10 m.
        difference = np.subtract.outer(a[:, axis] / lengthscale, b[:, axis] / lengthscale)
        np.multiply(difference, difference, out=difference)
        total += difference
    return total
