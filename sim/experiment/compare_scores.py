"""How good a map is: its error, and whether it knows how large that is."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from autonomy.geometry import FloatArray
from autonomy.learning.prediction import Prediction

TWO_SIDED_95 = 1.959963984540054


@dataclass(frozen=True)
class Score:
    """Of one map at one instant, all over the water, in units of the field's standard deviation.

    Attributes:
        rmse: root mean square error of the mean.
        nlpd: mean negative log predictive density of a reading, nats; expected over the reading's noise.
        coverage: expected share of readings within their 95 % intervals.
    """

    rmse: float
    nlpd: float
    coverage: float


def score(
    prediction: Prediction, believed_noise: float, truth: FloatArray, noise: float, unit: float
) -> Score:
    """The score of what is believed of the field where it is `truth`, (n,).

    Readings are what a prediction is held against, so that the field's noise-free value need not be predicted more
    sharply than anyone could check: the field's variance and the `believed_noise` (a standard deviation) make up
    that of a reading; those that would be taken have the standard deviation `noise`. `unit` is the field's own.
    """
    error = (prediction.mean - truth) / unit
    spread = np.sqrt(np.maximum(prediction.variance, 0.0) + believed_noise**2) / unit
    true_noise = noise / unit
    nlpd = 0.5 * np.log(2.0 * np.pi * spread**2) + 0.5 * (error**2 + true_noise**2) / spread**2
    reach = TWO_SIDED_95 * spread
    inside = ndtr((error + reach) / true_noise) - ndtr((error - reach) / true_noise)
    return Score(float(np.sqrt(np.mean(error**2))), float(np.mean(nlpd)), float(np.mean(inside)))


def kilometres_to(goal: float, kilometres: FloatArray, rmse: FloatArray) -> float:
    """How far was sailed when the error (n,), at ascending `kilometres` (n,), came down to `goal` for good.

    Linear in between; infinite if it is above the goal at the end. "For good", since a map that is better for a moment
    by luck is none that one could have stopped at.
    """
    above = np.flatnonzero(rmse > goal)
    if not len(above):
        return float(kilometres[0])
    k = int(above[-1])
    if k == len(rmse) - 1:
        return float("inf")
    share = (rmse[k] - goal) / (rmse[k] - rmse[k + 1])
    return float(kilometres[k] + share * (kilometres[k + 1] - kilometres[k]))
