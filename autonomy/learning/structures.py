"""Named families of kernels among which a re-estimate chooses: parameter vector <-> kernel, bounds, weak priors.

A structure is a sum of parts. The parts that move share one temporal kernel and its time-scale, so that they share
one state in the filter. To add a structure, add an entry to `STRUCTURES`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.numbers import FloatArray, positive
from autonomy.learning.spatial import Matern32, SpatialKernel, SquaredExponential
from autonomy.learning.temporal import MaternMotion, OrnsteinUhlenbeck, Static, TemporalKernel

_AXES = 2
_SHARE_DEVIATION = 1.5
_SHARE_BOUND = 6.0


@dataclass(frozen=True)
class Scales:
    """What weak priors are scaled to: the survey's width, the variance of its readings, the time they took.

    `elapsed_s` of 0 means unknown: only structures that do not move have priors then. ValueError for anything
    that is not positive and finite.
    """

    span_m: float
    variance: float
    elapsed_s: float = 0.0

    def __post_init__(self) -> None:
        positive("span_m", self.span_m)
        positive("variance", self.variance)
        if self.elapsed_s != 0.0:
            positive("elapsed_s", self.elapsed_s)


@dataclass(frozen=True)
class Priors:
    """Independent normal priors of a parameter vector: `median`, `deviation`. Weak, and enough."""

    median: FloatArray
    deviation: FloatArray

    def log_density(self, theta: FloatArray) -> tuple[float, FloatArray]:
        """Log density, zero at the median, and its gradient."""
        z = (theta - self.median) / self.deviation
        return -0.5 * float(z @ z), -z / self.deviation


@dataclass(frozen=True)
class Part:
    """One summand: its spatial kernel, whether it moves, and how much shorter than the first it is (in the median)."""

    space: Callable[[tuple[float, ...]], SpatialKernel]
    moves: bool = False
    shorter: float = 1.0


@dataclass(frozen=True)
class Structure:
    """A family of kernels.

    Its parameters θ: log of the variance of all parts together; for every part but the last the logit of its share of
    what the parts before it have left; logs of the first part's length-scales (one, or one per axis if `ard`); for
    every other part the log of how much shorter it is; log of the time-scale if a part moves; log of the noise
    variance. The prior median of the first length-scale is `spans` times the survey's width. `penalty`, in nats, is
    what it has to gain on a simpler one; below `minimum_points` readings it is not a candidate.
    """

    name: str
    parts: tuple[Part, ...]
    motion: Callable[[float], TemporalKernel] = OrnsteinUhlenbeck
    ard: bool = False
    spans: float = 1.0 / 6.0
    penalty: float = 0.0
    minimum_points: int = 20

    @property
    def moves(self) -> bool:
        """Whether any part does."""
        return any(part.moves for part in self.parts)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 2 * len(self.parts) + self._first_axes + self.moves

    def kernel(self, theta: FloatArray) -> Kernel:
        """The kernel with the parameters θ (size,)."""
        variances = np.exp(theta[0] + _log_shares(theta[self._shares])[0]).tolist()
        lengthscales = np.exp(self._log_lengthscales(theta)).tolist()
        still: TemporalKernel = Static()
        motion = self.motion(math.exp(theta[-2])) if self.moves else still
        return Kernel(
            tuple(
                Component(variance, part.space(tuple(scales)), motion if part.moves else still)
                for part, variance, scales in zip(self.parts, variances, lengthscales, strict=True)
            ),
            math.exp(theta[-1]),
        )

    def parameters(self, kernel: Kernel, timescale_s: float = math.inf) -> FloatArray:
        """θ (size,) of a kernel of this structure; `timescale_s` stands in if nothing in it moves.

        ValueError if the kernel has another number of components.
        """
        if len(kernel.components) != len(self.parts):
            raise ValueError(f"{self.name} has {len(self.parts)} components, not {len(kernel.components)}")
        variances = np.array([component.variance for component in kernel.components])
        left = variances[::-1].cumsum()[::-1]
        scales = np.log([component.space.lengthscales_m for component in kernel.components])
        first = scales[0] if self.ard else scales[0].mean(keepdims=True)
        theta = [math.log(left[0]), *np.log(variances[:-1] / left[1:]), *first]
        theta += (scales[0].mean() - scales[1:].mean(axis=1)).tolist()
        if self.moves:
            known = [component.time.timescale_s for component in kernel.components]
            theta.append(math.log(min(*known, timescale_s)))
        return np.array([*theta, math.log(kernel.noise_variance)])

    def chain(self, theta: FloatArray, gradient: FloatArray) -> FloatArray:
        """The gradient with respect to θ, of that with respect to the kernel's log parameters (see `likelihood`)."""
        variances, scales, timescale = self._apart(gradient)
        result = np.zeros(self.size)
        result[0] = variances.sum()
        result[self._shares] = variances @ _log_shares(theta[self._shares])[1]
        first = scales.sum(axis=0)
        if self.ard:
            # The others are measured by the geometric mean of the first part's.
            first = scales[0] + scales[1:].sum() / _AXES
        result[self._lengthscales] = first if self.ard else first.sum()
        result[self._ratios] = -scales[1:].sum(axis=1)
        if self.moves:
            result[-2] = timescale
        result[-1] = gradient[-1]
        return result

    def priors(self, scales: Scales) -> Priors:
        """Weak priors; ValueError for one that moves if the elapsed time is unknown."""
        others = len(self.parts) - 1
        rows = [(math.log(scales.variance), 1.0)]
        rows += [(0.0, _SHARE_DEVIATION)] * others
        rows += [(math.log(scales.span_m * self.spans), 0.7)] * self._first_axes
        rows += [(math.log(part.shorter), 0.7) for part in self.parts[1:]]
        if self.moves:
            rows.append((math.log(positive("elapsed_s", scales.elapsed_s)), 2.0))
        rows.append((math.log(0.01 * scales.variance), 1.5))
        table = np.array(rows)
        return Priors(table[:, 0], table[:, 1])

    def shortened(self, theta: FloatArray, factor: float) -> FloatArray:
        """θ with all length-scales divided by `factor`."""
        result = theta.copy()
        result[self._lengthscales] -= math.log(factor)
        return result

    def median(self, scales: Scales) -> Kernel:
        """The kernel to begin with."""
        return self.kernel(self.priors(scales).median)

    def bounds(self, scales: Scales) -> FloatArray:
        """Where a parameter still means something (size, 2); a noise floor keeps the covariance well conditioned."""
        others = len(self.parts) - 1
        variance, span = math.log(scales.variance), math.log(scales.span_m)
        rows = [(variance + math.log(1e-3), variance + math.log(1e3))]
        rows += [(-_SHARE_BOUND, _SHARE_BOUND)] * others
        rows += [(span + math.log(1e-3), span + math.log(1e2))] * self._first_axes
        rows += [(math.log(0.1), math.log(100.0))] * others
        if self.moves:
            elapsed = math.log(positive("elapsed_s", scales.elapsed_s))
            rows.append((elapsed - math.log(100.0), elapsed + math.log(100.0)))
        rows.append((variance + math.log(1e-6), variance + math.log(10.0)))
        return np.array(rows)

    @property
    def _first_axes(self) -> int:
        return _AXES if self.ard else 1

    @property
    def _shares(self) -> slice:
        return slice(1, len(self.parts))

    @property
    def _lengthscales(self) -> slice:
        return slice(len(self.parts), len(self.parts) + self._first_axes)

    @property
    def _ratios(self) -> slice:
        begin = len(self.parts) + self._first_axes
        return slice(begin, begin + len(self.parts) - 1)

    def _log_lengthscales(self, theta: FloatArray) -> FloatArray:
        """Shape (parts, axes)."""
        first = theta[self._lengthscales]
        result = np.empty((len(self.parts), _AXES))
        result[0] = first
        result[1:] = (first.mean() - theta[self._ratios])[:, None]
        return result

    def _apart(self, gradient: FloatArray) -> tuple[FloatArray, FloatArray, float]:
        """By variances (parts,), length-scales (parts, axes) and the time-scale that the moving parts share."""
        variances, scales, timescale, at = [], [], 0.0, 0
        for part in self.parts:
            variances.append(gradient[at])
            scales.append(gradient[at + 1 : at + 1 + _AXES])
            at += 1 + _AXES
            if part.moves:
                timescale += float(gradient[at])
                at += 1
        return np.array(variances), np.array(scales), timescale


def _log_shares(logits: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logs of the shares (k + 1,) that `logits` (k,) leave, stick by stick, and their derivatives (k + 1, k)."""
    count = len(logits)
    shares, derivatives = np.zeros(count + 1), np.zeros((count + 1, count))
    for i, logit in enumerate(logits.tolist()):
        taken = -math.log1p(math.exp(-logit))
        shares[i] += taken
        shares[i + 1 :] += taken - logit
        derivatives[i, i] = -math.expm1(taken)
        derivatives[i + 1 :, i] = -math.exp(taken)
    return shares, derivatives


# Parts, medians and penalties as measured in docs/decisions/0003.
_SE, _M32 = SquaredExponential, Matern32
_LONG_SHORT = (Part(_SE), Part(_M32, shorter=6.0))
# An anomaly that is smooth, or rough, or both at once.
_STATIC_MOVING = (Part(_M32), Part(_SE, moves=True, shorter=1.5), Part(_M32, moves=True, shorter=6.0))
STRUCTURES: dict[str, Structure] = {
    structure.name: structure
    for structure in (
        # The paper's, with one length-scale or one per axis.
        Structure("squared_exponential", (Part(_SE),)),
        Structure("squared_exponential_ard", (Part(_SE),), ard=True, penalty=2.0, minimum_points=40),
        Structure("matern32", (Part(_M32),)),
        Structure("long_short", _LONG_SHORT, spans=1.0 / 3.0, minimum_points=30),
        Structure("ou", (Part(_SE, moves=True),), penalty=3.0, minimum_points=40),
        Structure("smooth_motion", (Part(_SE, moves=True),), MaternMotion, penalty=3.0, minimum_points=40),
        Structure("static_moving", _STATIC_MOVING, spans=1.0 / 3.0, penalty=7.0, minimum_points=60),
        Structure(
            "static_smooth_motion",
            _STATIC_MOVING,
            MaternMotion,
            spans=1.0 / 3.0,
            penalty=7.0,
            minimum_points=60,
        ),
    )
}


def structure_named(name: str) -> Structure:
    """The structure of this name; ValueError names those that exist."""
    try:
        return STRUCTURES[name]
    except KeyError:
        raise ValueError(f"there is no structure {name!r}, only {', '.join(STRUCTURES)}") from None
