"""How far one belief about a field is from another that shall stand for it."""

import math
from dataclasses import dataclass

import numpy as np

from autonomy.learning.field_model import FieldModel
from autonomy.learning.numbers import FloatArray

_LATTICE = 256
# Beyond the outermost basis vectors a map goes on for a while.
_MARGIN = 0.1


@dataclass(frozen=True)
class StatedError:
    """The greatest difference of mean and of standard deviation that was found, as shares of the field's own, σf.

    In the latent units of the model's transform.
    """

    mean: float = 0.0
    sd: float = 0.0


def difference(model: FieldModel, other: FieldModel) -> StatedError:
    """How far `other` is from `model`, at the basis vectors and on a lattice among them: some hundred places.

    Between those the difference may be larger, by a fifth or so where a map has much detail.
    """
    places = np.concatenate([model.basis, lattice(model.basis)])
    one, two = model.predict(places), other.predict(places)
    sd = [np.sqrt(np.maximum(prediction.latent_variance, 0.0)) for prediction in (one, two)]
    unit = np.sqrt(model.kernel.signal_variance)
    differences = (one.latent_mean - two.latent_mean, sd[0] - sd[1])
    return StatedError(*(float(np.abs(each).max(initial=0.0) / unit) for each in differences))


def lattice(basis: FloatArray) -> FloatArray:
    """Some 300 places (n, d) spread evenly over the box around `basis` (m, d) and a tenth more; none for no basis.

    None either of a basis in one place, or of other than two axes.
    """
    if not len(basis) or basis.shape[1] != 2:
        return np.zeros((0, basis.shape[1]))
    low, high = basis.min(axis=0), basis.max(axis=0)
    margin = _MARGIN * float((high - low).max())
    low, high = low - margin, high + margin
    step = float(np.sqrt(np.prod(high - low) / _LATTICE))
    if not step > 0.0:
        return np.zeros((0, 2))
    axes = [
        np.linspace(*ends, 1 + math.ceil((ends[1] - ends[0]) / step)) for ends in zip(low, high, strict=True)
    ]
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
