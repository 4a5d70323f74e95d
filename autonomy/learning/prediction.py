"""What is believed of the field at some places: a Gaussian, seen through the sensor's units."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from autonomy.learning.numbers import FloatArray
from autonomy.learning.transform import Identity, Transform


@dataclass(frozen=True, eq=False)
class Prediction:
    """The field (no noise) at some places, in arrays of one shape.

    `latent_mean` and `latent_variance` are of the Gaussian the model works with, in units of `transform`;
    everything else is in the sensor's units. Without a transform the two are the same. Latent variances are not
    clipped: rounding may leave one a millionth of σf² below 0 or above σf².
    """

    latent_mean: FloatArray
    latent_variance: FloatArray
    transform: Transform = field(default_factory=Identity)

    @property
    def mean(self) -> FloatArray:
        """Expectation of the field, in sensor units."""
        return self._moments[0]

    @property
    def variance(self) -> FloatArray:
        """Variance of the field, in squared sensor units."""
        return self._moments[1]

    @cached_property
    def median(self) -> FloatArray:
        """What the field is as likely above as below, in sensor units."""
        return self.transform.inverse(self.latent_mean)

    def interval(self, level: float = 0.95) -> tuple[FloatArray, FloatArray]:
        """Lower and upper end of the central interval that holds the field with probability `level`, sensor units.

        Exact under any transform: quantiles pass through an increasing function. ValueError unless 0 < level < 1.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"level must lie between 0 and 1, e.g. 0.95, not {level!r}")
        reach = float(ndtri(0.5 + 0.5 * level)) * np.sqrt(np.maximum(self.latent_variance, 0.0))
        lower = self.transform.inverse(self.latent_mean - reach)
        return lower, self.transform.inverse(self.latent_mean + reach)

    @cached_property
    def _moments(self) -> tuple[FloatArray, FloatArray]:
        if isinstance(self.transform, Identity):
            return self.latent_mean, self.latent_variance
        return self.transform.moments(self.latent_mean, np.maximum(self.latent_variance, 0.0))
