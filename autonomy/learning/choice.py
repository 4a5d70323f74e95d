"""The choice among structures: which of them explains the readings best, after penalties. Slow: for the worker."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autonomy.learning.fitting import Fit, Method, doubt, fit
from autonomy.learning.history import HistoryCells
from autonomy.learning.kernel import Component, Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.structures import STRUCTURES, structure_named

# What these are measured by: docs/decisions/0003.
INCUMBENT_BONUS = 2.0
# Beyond this many times the elapsed time a time-scale is as good as infinite, but would still let the model forget.
_STILL_BEYOND = 20.0
_NEGLIGIBLE_SHARE = 0.01
# So many readings have to lie near one that was taken much earlier or later before anything is believed to
# move: on a track that comes nowhere twice, motion explains a field that is rougher here than there just as well.
_REVISITS = 20
_NEAR_SPANS = 1.0 / 20.0
_LATER = 0.25


@dataclass(frozen=True)
class Choice:
    """What `choose` found: the winner's `fit`, all penalised `scores` in nats, and the `starts` of the next.

    `doubt`: posterior variance of the logarithm of the winner's signal variance.
    """

    fit: Fit
    scores: dict[str, float]
    starts: dict[str, Kernel]
    doubt: float = 0.0


def readings_of(
    cells: HistoryCells, maximum_points: int, rng: np.random.Generator, mean: float | None = None
) -> Readings:
    """At most `maximum_points` random cells as the readings of a fit; `mean` None means unknown."""
    chosen = np.sort(rng.permutation(len(cells))[:maximum_points])
    sample = cells.take(chosen)
    scale = 1.0 / sample.counts
    return Readings.of(sample.points, sample.means, scale, sample.times_s, "gls" if mean is None else mean)


def choose(
    readings: Readings,
    candidates: Sequence[str],
    span_m: float,
    incumbent: str | None = None,
    starts: Mapping[str, Kernel] | None = None,
    method: Method | None = None,
) -> Choice:
    """Fit each of the `candidates` (names) and take the one with the highest score less penalty.

    Each begins at its own kernel in `starts` if there is one (the last choice's `starts`); the `incumbent` gets a
    bonus. Candidates that need more readings than there are, are passed over, and those that move while hardly
    any place was visited twice; if that leaves none, the first is fitted. Motion that the readings do not ask for
    is taken out of the winner's kernel. Never raises for degenerate readings; ValueError for unknown or no
    candidates.
    """
    known = [structure_named(name) for name in candidates]
    if not known:
        raise ValueError(f"no candidates: give at least one of {', '.join(STRUCTURES)}")
    starts = dict(starts or {})
    seen_again = readings.revisits(_NEAR_SPANS * span_m, _LATER * readings.elapsed_s) >= _REVISITS
    able = [s for s in known if readings.n >= s.minimum_points and (seen_again or not s.moves)] or known[:1]
    fits = {s.name: fit(readings, s, span_m, starts.get(s.name), method) for s in able}
    scores = {s.name: fits[s.name].score - s.penalty + INCUMBENT_BONUS * (s.name == incumbent) for s in able}
    winner = fits[max(scores, key=lambda name: scores[name])]
    starts.update({name: found.kernel for name, found in fits.items() if not found.kept_start})
    unsure = (
        0.0
        if winner.kept_start
        else doubt(readings, structure_named(winner.structure), span_m, winner.kernel, method or Method())
    )
    return Choice(replace(winner, kernel=stilled(winner.kernel, readings.elapsed_s)), scores, starts, unsure)


def stilled(kernel: Kernel, elapsed_s: float) -> Kernel:
    """The kernel without motion too slow, or of too small a share, for readings that took `elapsed_s`."""
    moving = [c for c in kernel.components if not math.isinf(c.time.timescale_s)]
    static = [c for c in kernel.components if math.isinf(c.time.timescale_s)]
    if static and sum(c.variance for c in moving) < _NEGLIGIBLE_SHARE * kernel.signal_variance:
        return Kernel(tuple(static), kernel.noise_variance)
    return Kernel(
        tuple(
            Component(c.variance, c.space) if c.time.timescale_s > _STILL_BEYOND * elapsed_s else c
            for c in kernel.components
        ),
        kernel.noise_variance,
    )
