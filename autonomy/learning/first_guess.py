"""The kernel that is believed in before the first fit: guessed from the readings, anew whenever they have doubled.

The first readings of a probe at 1 Hz lie within some metres. They tell the noise well and the field hardly, and what
is made of them has to say so, on the map as well as of the next reading:

- The noise is what second differences leave of the readings (Gasser, Sroka & Jennen-Steinmetz 1986), not a share of
  their variance: on a short stretch that is nearly all noise, in wide water nearly all field.
- A stretch shorter than the length-scale varies by σf²(1 − ρ) only, ρ the mean of its correlations: its variance is
  the more enlarged the shorter it is, and is taken to be no less than what noise alone might hide. No guess is less
  than half the one before: a stretch without a slope is no news of the field's size.
- The field is taken to be rough. A smooth kernel without noise carries the slope of the first minutes, or a wave of
  them, far out over the water (measured: the map's error rose to twelve times the field's standard deviation).

Constants and measurements: docs/decisions/0007.
"""

import math

import numpy as np

from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.numbers import FloatArray, positive
from autonomy.learning.spatial import Matern32

_SPANS = 1.0 / 6.0
_CAUTION = 50.0
# Where all readings are of nearly one place their variance says nothing of the field's.
_MOST = 5e4
_NOISE_SHARE = 1e-2
_LEAST_NOISE_SHARE = 1e-6
_PLACES = 64


class FirstGuess:
    """What the readings so far tell of noise and field. Picklable; adding is O(1), no more than 64 places are kept."""

    def __init__(self, span_m: float) -> None:
        lengthscale_m = positive("span_m", span_m) * _SPANS
        self._space = Matern32((lengthscale_m, lengthscale_m))
        self._count = 0
        self._next = 1
        self._mean, self._squares = 0.0, 0.0
        self._largest = 0.0
        self._least = 0.0
        self._last: list[tuple[FloatArray, float]] = []
        self._rough, self._triples = 0.0, 0
        # Every `_stride`-th place.
        self._places: list[FloatArray] = []
        self._stride = 1

    @property
    def is_due(self) -> bool:
        """Whether there are twice as many readings as when the kernel was last asked for."""
        return self._count >= self._next

    @property
    def mean(self) -> float:
        """Of all readings."""
        return self._mean

    def add(self, point: FloatArray, value: float) -> None:
        """A reading `value` at `point` (d,) metres, the next along the track."""
        if self._count % self._stride == 0:
            self._keep(point)
        self._count += 1
        self._largest = max(self._largest, abs(value))
        deviation = value - self._mean
        self._mean += deviation / self._count
        self._squares += deviation * (value - self._mean)
        self._last.append((point, value))
        if len(self._last) == 3:
            self._rough += _squared_difference(self._last)
            self._triples += 1
            del self._last[0]

    def kernel(self) -> Kernel:
        """The guess; the next is due when there are twice as many readings. ValueError before the first."""
        if not self._count:
            raise ValueError("there are no readings to guess a kernel from")
        self._next = 2 * self._count
        # Something tiny but positive if they do not vary.
        variance = max(self._squares / self._count, (1e-9 * (self._largest or 1.0)) ** 2)
        noise = self._rough / self._triples if self._triples else _NOISE_SHARE * variance
        noise = max(noise, _LEAST_NOISE_SHARE * variance)
        # The variance of n readings of noise alone is uncertain by about this.
        seen = max(variance - noise, noise / math.sqrt(self._count))
        signal = max(min(_CAUTION * seen / max(1.0 - self._alike, 1e-300), _MOST * variance), self._least)
        self._least = 0.5 * signal
        return Kernel((Component(signal, self._space),), noise)

    @property
    def _alike(self) -> float:
        """The mean of the correlations of the field at the places that are kept."""
        places = np.array(self._places)
        return float(Component(1.0, self._space).covariance(places, places).mean())

    def _keep(self, point: FloatArray) -> None:
        self._places.append(point)
        if len(self._places) == _PLACES:
            del self._places[1::2]
            self._stride *= 2


def _squared_difference(last: list[tuple[FloatArray, float]]) -> float:
    """How far the middle one of three readings is from the line between the others: squared, in units of the noise.

    Its expectation is the noise variance where the field is a plane, more where it is rough.
    """
    (before, first), (between, middle), (after, third) = last
    to_middle, from_middle = (
        math.dist(before.tolist(), between.tolist()),
        math.dist(between.tolist(), after.tolist()),
    )
    way = to_middle + from_middle
    share = from_middle / way if way > 0.0 else 0.5
    off = share * first + (1.0 - share) * third - middle
    return off**2 / (share**2 + (1.0 - share) ** 2 + 1.0)
