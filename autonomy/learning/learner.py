"""What the core owns: centring, the online model, the history; and the re-estimate a worker makes of them."""

import math
from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from autonomy.config import EstimationSection
from autonomy.learning.basis import select_basis
from autonomy.learning.field_model import FieldModel
from autonomy.learning.history import History, HistoryCells
from autonomy.learning.hyperparameters import Fit, Priors, fit
from autonomy.learning.kernel import FloatArray, Hyperparameters, Kernel
from autonomy.learning.sparse_gp import SparseOnlineGP, Update

_DIMENSIONS = 2
# On arrival novelty measures extrapolation, in a rebuild interpolation: the same threshold would leave
# a third of the capacity unused, and the error between and beyond the tracks would be a seventh larger.
# Much less would fill the basis at once, and too few newcomers would tell when to re-estimate.
_REBUILD_NOVELTY = 0.1
# How many readings a caller with other duties can afford to have learnt at once: a replacing update costs
# about _FIXED_COST + capacity² (in units of 10 ns), a slice about 10 ms of one core, whatever the capacity.
_SLICE_COST = 1_000_000
_FIXED_COST = 8_000

_Reading = tuple[FloatArray, float, float]


@dataclass(frozen=True)
class ReestimateRequest:
    """All that `reestimate` needs, picklable. `samples` names the request: the readings learnt by then."""

    cells: HistoryCells
    basis: FloatArray
    basis_readings: FloatArray
    basis_counts: FloatArray
    hyperparameters: Hyperparameters
    prior_mean: float
    refresh_mean: bool
    span_m: float
    capacity: int
    novelty: float
    jitter: float
    time_s: float
    samples: int
    options: EstimationSection
    seed: int


@dataclass(frozen=True)
class Reestimate:
    """New hyperparameters, the model rebuilt under them, how the `fit` went; `samples` names the request."""

    hyperparameters: Hyperparameters
    prior_mean: float
    gp: SparseOnlineGP
    log_likelihood: float
    points: int
    fit: Fit
    time_s: float
    samples: int


class Learner:
    """Learns the field from a stream of readings in local metres and model time. Picklable.

    The first `centring_samples` readings only tell offset and scale; then the model is born and learns
    them all. With 0 it is born at once with prior mean 0, and `hyperparameters` are required. `capacity`,
    `novelty`, `jitter`: see `SparseOnlineGP`.

    No call learns for long: birth and `adopt` leave what would take too long waiting, `behind` tells how
    much that is, and `catch_up` learns it slice by slice, in the order it came. Meanwhile everything may be
    used; the model only knows less than the history. What is learnt depends on the calls, never on a clock.
    """

    def __init__(
        self,
        span_m: float,
        capacity: int = 100,
        novelty: float = 1e-3,
        jitter: float = 1e-8,
        centring_samples: int = 20,
        history_cells: int = 2000,
        hyperparameters: Hyperparameters | None = None,
    ) -> None:
        if centring_samples < 0:
            raise ValueError(f"centring_samples must not be negative, but is {centring_samples}")
        if centring_samples == 0 and hyperparameters is None:
            raise ValueError(
                "without centring (centring_samples = 0) nothing tells the field's scale: "
                "give hyperparameters, or let the first readings (e.g. 20) tell it"
            )
        if hyperparameters is not None and hyperparameters.dimensions != _DIMENSIONS:
            raise ValueError(
                f"lengthscales_m must have {_DIMENSIONS} entries, not {hyperparameters.dimensions}"
            )
        self.history = History(span_m, history_cells)
        self._span_m = span_m
        self._capacity, self._novelty, self._jitter = capacity, novelty, jitter
        self._centring_samples = centring_samples
        self._given = hyperparameters
        self._collected: list[_Reading] = []
        self._waiting: deque[_Reading] = deque()
        self._slice = max(1, _SLICE_COST // (_FIXED_COST + capacity**2))
        self._since_request: list[_Reading] | None = None
        self._requested_at = -1
        self._time_s = -math.inf
        self._mark = 0
        self._replacements_at_mark = 0
        self._prior = FieldModel.prior(hyperparameters or Priors.scaled(span_m, 1.0).medians(_DIMENSIONS))
        self._gp: SparseOnlineGP | None = None
        if centring_samples == 0 and hyperparameters is not None:
            self._gp = self._new_gp(hyperparameters, 0.0)
        else:
            # So that a bad capacity, novelty or jitter is told now.
            self._new_gp(self._prior.kernel, 0.0)

    @property
    def born(self) -> bool:
        """Whether offset and scale are known, so that there is a model."""
        return self._gp is not None

    @property
    def gp(self) -> SparseOnlineGP:
        """The online model. Raises RuntimeError before it is born."""
        if self._gp is None:
            known = f"{len(self._collected)} of {self._centring_samples}"
            raise RuntimeError(f"the model is not born yet: {known} readings are in")
        return self._gp

    @property
    def samples(self) -> int:
        """Readings taken in so far, those for centring included."""
        return self.history.samples

    @property
    def behind(self) -> int:
        """How many readings wait to be learnt by the model; the history has them already."""
        return len(self._waiting)

    @property
    def basis(self) -> FloatArray:
        """Basis vectors (m, 2), metres; empty before birth."""
        return self._prior.basis if self._gp is None else self._gp.basis

    @property
    def fresh_count(self) -> int:
        """How many of the current basis vectors were added since the last mark."""
        return 0 if self._gp is None else int((self._gp.basis_births > self._mark).sum())

    @property
    def replaced_since_mark(self) -> int:
        """How many replacements there were since the last mark."""
        return 0 if self._gp is None else self._gp.replacements - self._replacements_at_mark

    def mark(self) -> None:
        """Count fresh basis vectors and replacements from here on."""
        self._mark = 0 if self._gp is None else self._gp.updates
        self._replacements_at_mark = 0 if self._gp is None else self._gp.replacements

    def add(self, point: ArrayLike, value: float, time_s: float) -> Update | None:
        """Learn `value` at `point` (2,) metres, model time `time_s`; None while it waits.

        It waits while offset and scale are unknown and while others wait. Of those the two oldest are
        learnt with every call, so that they grow fewer even if nobody calls `catch_up`. ValueError, and no
        change, for anything not finite. A reading from before the last one counts as simultaneous.
        """
        x = np.array(point, dtype=np.float64)
        self.history.add(x, value, time_s)
        reading = (x, float(value), float(time_s))
        if self._gp is None:
            self._collected.append(reading)
            if len(self._collected) < self._centring_samples:
                return None
            return self._give_birth()
        if self._since_request is not None:
            self._since_request.append(reading)
        self._waiting.append(reading)
        return self._work_off(2)

    def catch_up(self) -> bool:
        """Learn a slice of what waits, about 10 ms of work; whether readings still wait."""
        self._work_off(self._slice)
        return bool(self._waiting)

    def model(self) -> FieldModel:
        """The posterior; before birth the prior (of unit variance unless hyperparameters were given)."""
        return self._prior if self._gp is None else self._gp.model()

    def reestimate_request(self, seed: int, options: EstimationSection) -> ReestimateRequest:
        """The job for a worker; readings from now on are also kept for `adopt`. Replaces an earlier request.

        It covers every reading so far, those that wait included.

        Raises RuntimeError before the model is born.
        """
        gp = self.gp
        self._since_request = []
        self._requested_at = self.samples
        return ReestimateRequest(
            cells=self.history.cells(),
            basis=gp.basis,
            basis_readings=gp.basis_readings,
            basis_counts=gp.basis_counts,
            hyperparameters=gp.kernel.hyperparameters,
            prior_mean=gp.prior_mean,
            refresh_mean=self._centring_samples > 0,
            span_m=self._span_m,
            capacity=self._capacity,
            novelty=self._novelty,
            jitter=self._jitter,
            time_s=max([self._time_s, *(time_s for _, _, time_s in self._waiting)]),
            samples=self.samples,
            options=options,
            seed=seed,
        )

    def withdraw_request(self) -> None:
        """The job of the last request will not come back: stop keeping readings for it."""
        self._since_request, self._requested_at = None, -1

    def adopt(self, result: Reestimate) -> None:
        """Go on with the re-estimated model; what came in since the request waits to be learnt; marks.

        Raises ValueError if `result` does not answer the last request.
        """
        if self._since_request is None:
            raise ValueError(
                f"no request is open, so the re-estimate at {result.samples} samples answers none"
            )
        if result.samples != self._requested_at:
            raise ValueError(
                f"the re-estimate at {result.samples} samples does not answer "
                f"the open request, made at {self._requested_at}"
            )
        # Whatever waited at the request is in the history from which the new model was made.
        self._waiting = deque(self._since_request)
        self.withdraw_request()
        self._gp, self._time_s = result.gp, result.time_s
        self.mark()

    def _new_gp(self, h: Kernel | Hyperparameters, prior_mean: float) -> SparseOnlineGP:
        return SparseOnlineGP(h, self._capacity, self._novelty, self._jitter, prior_mean)

    def _give_birth(self) -> Update | None:
        values = np.array([value for _, value, _ in self._collected])
        h = self._given or Priors.scaled(self._span_m, _safe_variance(values)).medians(_DIMENSIONS)
        self._gp = self._new_gp(h, float(values.mean()))
        self._waiting.extend(self._collected)
        self._collected = []
        return self._work_off(self._slice)

    def _work_off(self, maximum: int) -> Update | None:
        """Learn at most `maximum` of the readings that wait; what became of the last of all, if it is learnt."""
        outcome = None
        for _ in range(min(maximum, len(self._waiting))):
            outcome = self._learn(self._waiting.popleft())
        return None if self._waiting else outcome

    def _learn(self, reading: _Reading) -> Update:
        point, value, time_s = reading
        self.gp.advance(max(0.0, time_s - self._time_s) if math.isfinite(self._time_s) else 0.0)
        self._time_s = max(self._time_s, time_s)
        return self.gp.update(point, value)


def reestimate(request: ReestimateRequest) -> Reestimate:
    """Fit the hyperparameters, rebuild the model under them from the history. Pure, slow: for the worker."""
    found = _fit(request)
    if found.kept_start:
        found = replace(found, prior_mean=request.prior_mean)
    gp = _rebuild(request, found.hyperparameters, found.prior_mean)
    points = len(request.basis) if request.options.data == "basis" else _fit_count(request)
    return Reestimate(
        hyperparameters=found.hyperparameters,
        prior_mean=found.prior_mean,
        gp=gp,
        log_likelihood=found.log_likelihood,
        points=points,
        fit=found,
        time_s=request.time_s,
        samples=request.samples,
    )


def _fit_count(request: ReestimateRequest) -> int:
    return min(len(request.cells), request.options.maximum_points)


def _fit(request: ReestimateRequest) -> Fit:
    options = request.options
    if options.data == "basis":
        x, y, noise_scale = request.basis, request.basis_readings, 1.0 / request.basis_counts
    else:
        chosen = np.random.default_rng(request.seed).permutation(len(request.cells))[: _fit_count(request)]
        sample = request.cells.take(chosen)
        x, y, noise_scale = sample.points, sample.means, 1.0 / sample.counts
    variance = _safe_variance(request.cells.means)
    return fit(
        x,
        y,
        request.hyperparameters,
        objective=options.objective,
        priors=Priors.scaled(request.span_m, variance) if options.priors else None,
        optimiser=options.optimiser,
        learning_rate=options.learning_rate,
        iterations=options.iterations,
        isotropic=options.isotropic,
        noise_scale=noise_scale,
        # The basis is a biased sample, too spread out to tell the mean better than it was known.
        mean="gls" if request.refresh_mean and options.data == "history" else request.prior_mean,
    )


def _rebuild(request: ReestimateRequest, h: Hyperparameters, prior_mean: float) -> SparseOnlineGP:
    """A new basis under the new kernel, by pivoted Cholesky over the cells; the whole history absorbed."""
    gp = SparseOnlineGP(h, request.capacity, request.novelty, request.jitter, prior_mean)
    cells = request.cells
    novelty = request.novelty * _REBUILD_NOVELTY
    chosen = np.array(select_basis(cells.points, h.kernel, request.capacity, novelty), dtype=np.intp)
    gp.start_basis(cells.points[chosen], cells.means[chosen], cells.counts[chosen])
    noise = h.noise_variance / cells.counts
    if h.timescale_s == math.inf:
        gp.absorb(cells.points, cells.means, noise)
        return gp
    # A field that forgets has to be told in the order of time.
    for i, time_s in enumerate(cells.times_s):
        gp.project(cells.points[i], float(cells.means[i]), float(noise[i]))
        following = cells.times_s[i + 1] if i + 1 < len(cells) else request.time_s
        gp.advance(max(0.0, float(following - time_s)))
    return gp


def _safe_variance(values: FloatArray) -> float:
    """The variance of the readings; something tiny but positive if they do not vary; 1 if there are none."""
    if not len(values):
        return 1.0
    scale = float(np.abs(values).max()) or 1.0
    return max(float(values.var()), (1e-9 * scale) ** 2)
