"""The slow half of learning: fit kernels to the memory, rebuild the model under the best. For the worker."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from autonomy.config import EstimationSection
from autonomy.learning.basis import select_basis
from autonomy.learning.capacity import Budget, choose_capacity
from autonomy.learning.caution import cautious
from autonomy.learning.choice import Choice, choose, readings_of, stilled
from autonomy.learning.fitting import Fit, Method, fit
from autonomy.learning.history import HistoryCells
from autonomy.learning.kernel import Kernel
from autonomy.learning.likelihood import Readings
from autonomy.learning.numbers import FloatArray
from autonomy.learning.sparse_gp import SparseOnlineGP
from autonomy.learning.structures import structure_named

# On arrival novelty measures extrapolation, in a rebuild interpolation: the same threshold would leave
# a third of the capacity unused, and the error between and beyond the tracks would be a seventh larger.
# Much less would fill the basis at once, and too few newcomers would tell when to re-estimate.
_REBUILD_NOVELTY = 0.1
# Below this, revisits of a lattice and standing still would join the basis again and again.
_LEAST_NOVELTY = 1e-6
# The chosen structure's parameters are worth more points than the choice.
_REFINED = 2


@dataclass(frozen=True)
class Build:
    """How a model is built, whatever its kernel.

    `capacity` None means chosen for `area_m2` of water within `budget`, at most `most`. `novelty` and `jitter`
    are shares of the signal variance, see `SparseOnlineGP`.
    """

    area_m2: float
    capacity: int | None
    budget: Budget
    most: int
    novelty: float
    jitter: float

    def __post_init__(self) -> None:
        if not 0 <= self.novelty < 1:
            raise ValueError(f"novelty is a share of the signal variance in [0, 1), not {self.novelty!r}")

    def model(self, kernel: Kernel, prior_mean: float) -> SparseOnlineGP:
        """An empty model. Its novelty is at most σn²/σf²: what noise does not hide is worth a basis vector."""
        novelty = min(self.novelty, max(kernel.noise_variance / kernel.signal_variance, _LEAST_NOVELTY))
        return SparseOnlineGP(kernel, self.capacity_for(kernel), novelty, self.jitter, prior_mean)

    def capacity_for(self, kernel: Kernel) -> int:
        """The capacity of a model under `kernel`."""
        if self.capacity is not None:
            return self.capacity
        return choose_capacity(kernel, self.area_m2, self.budget, self.most)

    def rebuilt(
        self, cells: HistoryCells, kernel: Kernel, prior_mean: float, time_s: float
    ) -> SparseOnlineGP:
        """The model that has learnt all `cells`, as of `time_s`: a basis under `kernel`, and a replay."""
        gp = self.model(kernel, prior_mean)
        if not len(cells):
            return gp
        relevance = _relevance(kernel, time_s - cells.times_s)
        chosen = np.array(
            select_basis(cells.points, kernel, gp.capacity, gp.novelty * _REBUILD_NOVELTY, relevance),
            dtype=np.intp,
        )
        gp.start_basis(cells.points[chosen], cells.means[chosen], cells.counts[chosen])
        replay(gp, cells, time_s)
        return gp


@dataclass(frozen=True)
class ReestimateRequest:
    """All that `reestimate` needs, picklable. `samples` names the request: the readings learnt by then.

    `structure` is the name of the structure that won the last choice, None before the first; `starts` are the
    kernels from which the fits begin, by structure.
    """

    cells: HistoryCells
    basis: FloatArray
    basis_readings: FloatArray
    basis_counts: FloatArray
    kernel: Kernel
    structure: str | None
    starts: Mapping[str, Kernel]
    prior_mean: float
    refresh_mean: bool
    span_m: float
    build: Build
    time_s: float
    samples: int
    options: EstimationSection
    seed: int


@dataclass(frozen=True)
class Reestimate:
    """The new kernel, the model rebuilt under it, how the choice went; `samples` names the request.

    `points` is the number of readings in the fit.
    """

    kernel: Kernel
    prior_mean: float
    gp: SparseOnlineGP
    points: int
    choice: Choice
    time_s: float
    samples: int

    @property
    def fit(self) -> Fit:
        """The fit that won."""
        return self.choice.fit


def reestimate(request: ReestimateRequest) -> Reestimate:
    """Choose a kernel, rebuild the model under it from the history. Pure, slow: for the worker."""
    options = request.options
    method = Method(
        options.objective, options.optimiser, options.priors, options.iterations, options.learning_rate
    )
    readings = _readings(request, options.maximum_points)
    choice = choose(readings, options.candidates, request.span_m, request.structure, request.starts, method)
    if not choice.fit.kept_start:
        more = _readings(request, _REFINED * options.maximum_points)
        if more.n > readings.n:
            readings, choice = more, _refined(choice, more, request.span_m, method)
    kernel, prior_mean = cautious(choice.fit.kernel, choice.doubt), choice.fit.prior_mean
    if choice.fit.kept_start:
        kernel, prior_mean = request.kernel, request.prior_mean
    return Reestimate(
        kernel=kernel,
        prior_mean=prior_mean,
        gp=request.build.rebuilt(request.cells, kernel, prior_mean, request.time_s),
        points=readings.n,
        choice=choice,
        time_s=request.time_s,
        samples=request.samples,
    )


def replay(gp: SparseOnlineGP, cells: HistoryCells, time_s: float) -> None:
    """Teach `cells`, oldest first, to a model whose basis stands; then let time pass until `time_s`.

    A field that does not move is told all at once; one that does, in the order of time.
    """
    noise = gp.kernel.noise_variance / cells.counts
    if gp.kernel.is_static:
        gp.absorb(cells.points, cells.means, noise)
        return
    told_s = cells.times_s.tolist()
    for i, (cell_s, following_s) in enumerate(zip(told_s, [*told_s[1:], time_s], strict=True)):
        gp.project(cells.points[i], float(cells.means[i]), float(noise[i]))
        gp.advance(max(0.0, following_s - cell_s))


def _relevance(kernel: Kernel, ages_s: FloatArray) -> FloatArray:
    """How much of what each group was at a cell is left of it now: (groups, n).

    With f_g(x, t) a cell tells κ_g(age)·f_g(x, t) of the present. A basis chosen for the covariance of these
    stands where something is known of the present.
    """
    ages = np.maximum(ages_s, 0.0)
    return np.array(
        [
            np.ones(len(ages)) if math.isinf(group.time.timescale_s) else group.time.correlation(ages)
            for group in kernel.groups
        ]
    )


def _refined(choice: Choice, readings: Readings, span_m: float, method: Method) -> Choice:
    """The winner fitted again, from where it is, to more readings than the choice was made with."""
    name = choice.fit.structure
    found = fit(readings, structure_named(name), span_m, choice.starts[name], method)
    still = replace(found, kernel=stilled(found.kernel, readings.elapsed_s))
    return replace(choice, fit=still, starts={**choice.starts, name: found.kernel})


def _readings(request: ReestimateRequest, most: int) -> Readings:
    """What a fit is made of: at most so many random cells of the history, or the basis vectors' own readings."""
    if request.options.data == "basis":
        # A biased sample, too spread out to tell the mean better than it was known; of no known times.
        scale = 1.0 / request.basis_counts
        return Readings.of(request.basis, request.basis_readings, scale, None, request.prior_mean)
    rng = np.random.default_rng(request.seed)
    mean = None if request.refresh_mean else request.prior_mean
    return readings_of(request.cells, most, rng, mean)
