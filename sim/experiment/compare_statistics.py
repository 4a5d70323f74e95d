"""What many voyages say together: paired differences, and how sure they are for a field that was not tried."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t

from autonomy.geometry import FloatArray


@dataclass(frozen=True)
class Ratio:
    """How one strategy's figure relates to another's on the same voyages: a geometric mean with its uncertainty.

    Attributes:
        mean: geometric mean over fields of the geometric mean over each field's voyages.
        low, high: its 95 % confidence interval, from how much *fields* differ (Student's t): it speaks of another
            field of this kind, and more launches or seeds on the same fields do not narrow it beyond that. NaN with
            fewer than two fields.
        within: standard deviation of the logarithm among voyages of one field, pooled: launch, seed and noise. NaN
            if no field has two voyages.
        better: on how many voyages the first was better (smaller), and of how many.
        voyages: see there.
        fields: how many fields.
    """

    mean: float
    low: float
    high: float
    within: float
    better: int
    voyages: int
    fields: int


def ratio(pairs: Mapping[str, Sequence[tuple[float, float]]]) -> Ratio:
    """Of the pairs (ours, theirs) of each field, all positive. ValueError if there are none."""
    logs = {name: np.log(np.asarray(each, dtype=float)) for name, each in pairs.items() if len(each)}
    if not logs:
        raise ValueError("no voyages to compare")
    differences = [each[:, 0] - each[:, 1] for each in logs.values()]
    means = np.array([each.mean() for each in differences])
    low = high = float("nan")
    if len(means) > 1:
        reach = float(t.ppf(0.975, len(means) - 1)) * float(means.std(ddof=1)) / np.sqrt(len(means))
        low, high = float(np.exp(means.mean() - reach)), float(np.exp(means.mean() + reach))
    everything = np.concatenate(differences)
    return Ratio(
        mean=float(np.exp(means.mean())),
        low=low,
        high=high,
        within=pooled_deviation(differences),
        better=int(np.count_nonzero(everything < 0.0)),
        voyages=len(everything),
        fields=len(means),
    )


def pooled_deviation(groups: Sequence[FloatArray]) -> float:
    """Standard deviation within groups, pooled over them; NaN if no group has two members."""
    degrees = sum(len(each) - 1 for each in groups if len(each) > 1)
    if not degrees:
        return float("nan")
    squares = sum(float(np.sum((each - each.mean()) ** 2)) for each in groups)
    return float(np.sqrt(squares / degrees))
