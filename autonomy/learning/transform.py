"""Between the sensor's units and those in which the field is Gaussian.

Chlorophyll spans decades and a plume's salinity sticks to its two ends: no Gaussian is either. Their logarithm or
logit may be. The model then lives in the transformed ("latent") units: readings pass through `forward` before
anything learns them, and what is predicted comes back through `moments` and `inverse`. Quantiles pass through an
increasing function as they are, so intervals are exact.

A transform is a frozen value of finite numbers, strictly increasing; `TRANSFORMS` names them all.
"""

import math
from dataclasses import Field, dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, log_expit

from autonomy.config import SensorSection
from autonomy.learning.numbers import FloatArray

__all__ = ["TRANSFORMS", "Identity", "Log", "Logit", "Transform", "transform_of"]

# E g(Z) by Gauss–Hermite quadrature: within 1e-6 of the range for standard deviations up to 2, 1e-3 up to 4.
_NODES = 32


class Transform(Protocol):
    """Sensor units <-> latent units. Arrays of any shape; results have the shape of the argument."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    name: ClassVar[str]

    def refusal(self, value: float) -> str | None:
        """Why `value` has no image, for a person; None if it has one."""
        ...

    def forward(self, values: ArrayLike) -> FloatArray:
        """Sensor units to latent units; ValueError for a value outside the domain."""
        ...

    def inverse(self, latent: ArrayLike) -> FloatArray:
        """Latent units to sensor units."""
        ...

    def log_slope(self, latent: float) -> float:
        """log d forward / d value where the reading is `latent` after the transform.

        A log density per sensor unit is one per latent unit plus this.
        """
        ...

    def moments(self, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean and variance in sensor units (and their square) of latent N(mean, variance), variance ≥ 0."""
        ...


@dataclass(frozen=True)
class Identity:
    """The field is Gaussian as it is."""

    name: ClassVar[str] = "none"

    def refusal(self, value: float) -> str | None:
        """Only what is not finite has no image."""
        return None if math.isfinite(value) else "readings must be finite"

    def forward(self, values: ArrayLike) -> FloatArray:
        """The values themselves."""
        array = np.asarray(values, dtype=np.float64)
        return _inside(self, array, np.isfinite(array))

    def inverse(self, latent: ArrayLike) -> FloatArray:
        """The values themselves."""
        return np.asarray(latent, dtype=np.float64)

    def log_slope(self, latent: float) -> float:
        """0."""
        return 0.0

    def moments(self, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same."""
        return mean, variance


@dataclass(frozen=True)
class Log:
    """log(value + offset), for what is positive and spans decades; an `offset` above 0 lets zeros in."""

    offset: float = 0.0
    name: ClassVar[str] = "log"

    def __post_init__(self) -> None:
        object.__setattr__(self, "offset", _finite("offset", self.offset))

    def refusal(self, value: float) -> str | None:
        """Values must lie above −offset."""
        if math.isfinite(value) and value + self.offset > 0.0:
            return None
        return f"the logarithm needs values above {-self.offset or 0.0:g}"

    def forward(self, values: ArrayLike) -> FloatArray:
        """log(value + offset)."""
        array = np.asarray(values, dtype=np.float64)
        inside = _inside(self, array, np.isfinite(array) & (array + self.offset > 0.0))
        result: FloatArray = np.log(inside + self.offset)
        return result

    def inverse(self, latent: ArrayLike) -> FloatArray:
        """exp(latent) − offset; infinite where that is beyond floating point."""
        with np.errstate(over="ignore"):
            return np.exp(np.asarray(latent, dtype=np.float64)) - self.offset

    def log_slope(self, latent: float) -> float:
        """−log(value + offset)."""
        return -latent

    def moments(self, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Those of the log-normal distribution: exp(m + v/2) − offset and (exp(v) − 1) exp(2m + v)."""
        with np.errstate(over="ignore", divide="ignore"):
            # log(exp(v) − 1) = v + log(1 − exp(−v)): no infinity times nothing, however far out.
            spread = np.exp(2.0 * (mean + variance) + np.log1p(-np.exp(-variance)))
            return np.exp(mean + 0.5 * variance) - self.offset, spread


@dataclass(frozen=True)
class Logit:
    """log((value − lower)/(upper − value)), for what lies between two ends and likes to be near them."""

    lower: float
    upper: float
    name: ClassVar[str] = "logit"

    def __post_init__(self) -> None:
        object.__setattr__(self, "lower", _finite("lower", self.lower))
        object.__setattr__(self, "upper", _finite("upper", self.upper))
        if not (self.lower < self.upper and math.isfinite(self.upper - self.lower)):
            raise ValueError(f"lower must be below upper, not {self.lower!r} and {self.upper!r}")

    def refusal(self, value: float) -> str | None:
        """Values must lie between the ends."""
        if self.lower < value < self.upper:
            return None
        return f"the logit needs values between {self.lower:g} and {self.upper:g}, the ends excluded"

    def forward(self, values: ArrayLike) -> FloatArray:
        """log(value − lower) − log(upper − value)."""
        array = np.asarray(values, dtype=np.float64)
        inside = _inside(self, array, (self.lower < array) & (array < self.upper))
        result: FloatArray = np.log(inside - self.lower) - np.log(self.upper - inside)
        return result

    def inverse(self, latent: ArrayLike) -> FloatArray:
        """lower + (upper − lower)/(1 + exp(−latent))."""
        share: FloatArray = expit(np.asarray(latent, dtype=np.float64))
        return self.lower + (self.upper - self.lower) * share

    def log_slope(self, latent: float) -> float:
        """log((upper − lower)/((value − lower)(upper − value)))."""
        return -math.log(self.upper - self.lower) - float(log_expit(latent) + log_expit(-latent))

    def moments(self, mean: FloatArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By Gauss–Hermite quadrature; they have no closed form."""
        nodes, weights = np.polynomial.hermite_e.hermegauss(_NODES)
        weights /= weights.sum()
        deviation, centre = np.sqrt(variance), expit(mean)
        first, second = np.zeros_like(centre), np.zeros_like(centre)
        # Node by node, so that a map needs no memory but maps; about `centre`, so that nothing cancels.
        for node, weight in zip(nodes.tolist(), weights.tolist(), strict=True):
            difference = expit(mean + node * deviation) - centre
            first += weight * difference
            second += weight * difference * difference
        width = self.upper - self.lower
        spread: FloatArray = width * np.sqrt(np.maximum(second - first * first, 0.0))
        with np.errstate(over="ignore"):
            return self.lower + width * (centre + first), spread * spread


TRANSFORMS: dict[str, type[Identity] | type[Log] | type[Logit]] = {
    transform.name: transform for transform in (Identity, Log, Logit)
}


def transform_of(sensor: SensorSection) -> Transform:
    """The transform that the configuration asks for; ValueError if it lacks what that needs."""
    match sensor.transform:
        case "none":
            return Identity()
        case "log":
            return Log(sensor.transform_offset)
        case "logit":
            if sensor.transform_bounds is None:
                raise ValueError("sensor.transform logit needs sensor.transform_bounds")
            return Logit(*sensor.transform_bounds)


def _finite(name: str, value: float) -> float:
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{name} must be finite, not {value!r}")
    return number


def _inside(transform: Transform, values: FloatArray, has_image: NDArray[np.bool_]) -> FloatArray:
    """`values`, all of which have an image; otherwise ValueError names the first that has none."""
    if not has_image.all():
        value = float(values[~has_image].ravel()[0])
        raise ValueError(f"{value!r} cannot be transformed: {transform.refusal(value)}")
    return values
