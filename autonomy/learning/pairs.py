"""The noise-free covariance of many readings with its derivatives, of which only the lower triangle is ever made."""

import math

import numpy as np

from autonomy.learning.kernel import Kernel
from autonomy.learning.numbers import FloatArray
from autonomy.learning.temporal import TemporalKernel


class Pairs:
    """What all kernels need to know of the readings' pairs: the lower triangle, column by column (LAPACK's packing)."""

    def __init__(self, x: FloatArray, times_s: FloatArray | None) -> None:
        n = len(x)
        columns, rows = np.triu_indices(n)
        self.squares = [(x[rows, axis] - x[columns, axis]) ** 2 for axis in range(x.shape[1])]
        self.lags_s = None if times_s is None else np.abs(times_s[rows] - times_s[columns])
        self.diagonal = np.cumsum([0, *range(n, 1, -1)]) if n else np.zeros(0, dtype=np.intp)
        self._work: list[FloatArray] = []

    def work(self, count: int) -> list[FloatArray]:
        """`count` arrays of one number a pair, always the same: fresh memory costs more than the sums."""
        while len(self._work) < count:
            self._work.append(np.empty_like(self.squares[0]))
        return self._work[:count]


class PackedCovariance:
    """The noise-free covariance of the readings, packed, and what its derivatives need."""

    def __init__(self, pairs: Pairs, kernel: Kernel) -> None:
        self.kernel = kernel
        self._pairs = pairs
        self._squared: list[FloatArray] = []
        self._parts: list[FloatArray] = []
        self._moving: dict[TemporalKernel, FloatArray] = {}
        *work, spare = pairs.work(2 * len(kernel.components) + 1)
        for component, squared, part in zip(kernel.components, work[::2], work[1::2], strict=True):
            _scaled(pairs.squares, component.space.lengthscales_m, squared, spare)
            np.copyto(part, squared)
            part = component.space.correlation(part)
            part *= component.variance
            motion = self._motion(component.time)
            if motion is not None:
                part *= motion
            self._squared.append(squared)
            self._parts.append(part)
        self.packed = (
            self._parts[0] if len(self._parts) == 1 else np.add(self._parts[0], self._parts[1], out=spare)
        )
        for part in self._parts[2:]:
            self.packed += part

    def _motion(self, time: TemporalKernel) -> FloatArray | None:
        """κ of the lags; None if it is one everywhere. Components that move alike share it."""
        if self._pairs.lags_s is None or math.isinf(time.timescale_s):
            return None
        if time not in self._moving:
            self._moving[time] = time.correlation(self._pairs.lags_s)
        return self._moving[time]

    def gradient(self, weights: FloatArray) -> list[float]:
        """Σ weights∘∂K for the logarithms of every component's parameters."""
        result: list[float] = []
        slopes = {
            time: time.slope(self._pairs.lags_s) for time in self._moving if self._pairs.lags_s is not None
        }
        for component, squared, part in zip(self.kernel.components, self._squared, self._parts, strict=True):
            result.append(float(weights @ part))
            steep = component.space.slope(squared)
            steep *= weights
            motion = self._motion(component.time)
            if motion is not None:
                steep *= motion
            for square, lengthscale in zip(self._pairs.squares, component.space.lengthscales_m, strict=True):
                result.append(component.variance / lengthscale**2 * float(steep @ square))
            if motion is not None:
                still = component.space.correlation(squared)
                still *= slopes[component.time]
                result.append(component.variance * float(weights @ still))
            elif not math.isinf(component.time.timescale_s):
                result.append(0.0)
        return result


def _scaled(
    squares: list[FloatArray], lengthscales_m: tuple[float, ...], out: FloatArray, spare: FloatArray
) -> None:
    """s = Σ (d_i/l_i)² of all pairs, into `out`."""
    np.multiply(squares[0], lengthscales_m[0] ** -2, out=out)
    for square, lengthscale in zip(squares[1:], lengthscales_m[1:], strict=True):
        np.multiply(square, lengthscale**-2, out=spare)
        out += spare
