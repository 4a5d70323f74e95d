"""What the core owns: centring, the online model, the memory from which it can be made anew."""

import math
from collections import deque
from dataclasses import replace

from numpy.typing import ArrayLike

from autonomy.config import EstimationSection
from autonomy.learning.calibration import Calibration
from autonomy.learning.capacity import MOST, Budget, replacement_us
from autonomy.learning.field_model import FieldModel
from autonomy.learning.first_guess import FirstGuess
from autonomy.learning.history import History, HistoryCells
from autonomy.learning.kernel import Hyperparameters, Kernel
from autonomy.learning.lookahead import DISTANCES_PER_SPAN, Lookahead
from autonomy.learning.numbers import FloatArray
from autonomy.learning.positions import grid_step_m, snapped
from autonomy.learning.rebuild import Build, Reestimate, ReestimateRequest
from autonomy.learning.roughness import Roughness
from autonomy.learning.sparse_gp import SparseOnlineGP, Update
from autonomy.learning.structures import STRUCTURES, Scales
from autonomy.learning.transform import Identity, Transform

_DIMENSIONS = 2
_FIRST_STRUCTURE = "squared_exponential"
# What a caller with other duties can afford to have learnt at once.
_SLICE_US = 10_000.0

# Its number, place, value and time.
_Reading = tuple[int, FloatArray, float, float]


class Learner:
    """Learns the field from a stream of readings in local metres and model time. Picklable.

    The first `centring_samples` readings only tell offset and scale; then the model is born and learns
    them all. With 0 it is born at once with prior mean 0, and `hyperparameters` are required. Without these its
    kernel is a `FirstGuess`, made anew whenever the readings have doubled, until a fit is adopted. `capacity`
    None: chosen for `area_m2` of water (None: all of the span's square) within `budget`, anew with every kernel.
    `novelty`, `jitter`: see `SparseOnlineGP`. Readings pass through `transform`; history and
    model are in its latent units. Places are snapped to a grid (`grid_step_m`), those of a rebuilt basis too, so
    that basis vectors travel exactly in few bytes. `calibration` holds what was predicted of each reading
    against it, `ahead` what was predicted of some from afar; both since the kernel last changed. `roughness` holds
    how the field varies along the track; `budget_m` is how far the vessel will sail in all, if that is known.

    No call learns for long: birth and `adopt` leave what would take too long waiting, `behind` tells how
    much that is, and `catch_up` learns it slice by slice, in the order it came. Meanwhile everything may be
    used; the model only knows less than the history. What is learnt depends on the calls, never on a clock.
    The exceptions make a model anew from the history at once: a new guess, after ever longer, and a repair of
    a model whose state has broken, which `repairs` counts.
    """

    def __init__(
        self,
        span_m: float,
        capacity: int | None = None,
        novelty: float = 1e-3,
        jitter: float = 1e-8,
        centring_samples: int = 20,
        history_cells: int = 2000,
        hyperparameters: Hyperparameters | None = None,
        *,
        area_m2: float | None = None,
        budget: Budget | None = None,
        transform: Transform | None = None,
        budget_m: float | None = None,
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
        self.transform = transform or Identity()
        self.calibration = Calibration()
        self.ahead = Lookahead(span_m / DISTANCES_PER_SPAN)
        self.roughness = Roughness(math.sqrt(area_m2 or span_m**2), budget_m)
        self.repairs = 0
        self._span_m = span_m
        self._build = Build(
            area_m2 or span_m**2, capacity, budget or Budget(), min(MOST, history_cells), novelty, jitter
        )
        self._centring_samples = centring_samples
        self._given = None if hyperparameters is None else hyperparameters.kernel
        self._guess = FirstGuess(span_m) if hyperparameters is None else None
        # What one choice among structures hands on to the next.
        self._structure: str | None = None
        self._starts = self._first_starts()
        self._collected: list[_Reading] = []
        self._waiting: deque[_Reading] = deque()
        self._since_request: list[_Reading] | None = None
        self._requested_at = -1
        self._time_s = -math.inf
        self._judged = 0
        self._mark = 0
        self._replacements_at_mark = 0
        self._prior = FieldModel.prior(self._given or self._median_kernel(1.0))
        # Also so that a bad capacity, novelty or jitter is told now.
        unborn = self._build.model(self._prior.kernel, 0.0)
        self._gp: SparseOnlineGP | None = None if centring_samples else unborn

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
    def capacity(self) -> int:
        """The largest number of basis vectors under the present kernel."""
        return self._build.capacity_for(self._prior.kernel) if self._gp is None else self._gp.capacity

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
        change, for anything not finite and for values that `transform` does not take. A reading from before
        the last one counts as simultaneous.
        """
        x = self._snapped(point)
        latent = float(self.transform.forward(value))
        self.history.add(x, latent, time_s)
        self.roughness.add(x, latent, time_s)
        if self._guess is not None:
            self._guess.add(x, latent)
        reading = (self.samples, x, latent, float(time_s))
        if self._gp is None:
            self._collected.append(reading)
            if len(self._collected) < self._centring_samples:
                return None
            return self._give_birth()
        if self._since_request is not None:
            self._since_request.append(reading)
        self._waiting.append(reading)
        outcome = self._work_off(2)
        if self._guess is not None and self._guess.is_due:
            self._remake(self._guess.kernel(), self._guess.mean)
            # All of the basis is new since the last fit: there was none.
            self._mark, self._replacements_at_mark = -1, 0
        return outcome

    def catch_up(self) -> bool:
        """Learn one slice of the readings that wait; returns whether some still do."""
        self._work_off(self._slice)
        return bool(self._waiting)

    def model(self, time_s: float | None = None) -> FieldModel:
        """What is believed now: before birth, the prior.

        As of model time `time_s`, if that is after the last reading: what moves is known less and less well.
        """
        model = replace(self._prior if self._gp is None else self._gp.model(), transform=self.transform)
        ahead_s = 0.0 if time_s is None else time_s - self._time_s
        return model.advanced(ahead_s) if 0.0 < ahead_s < math.inf else model

    def reestimate_request(self, seed: int, options: EstimationSection) -> ReestimateRequest:
        """What `reestimate` needs. From now until `adopt` or `withdraw_request` new readings are kept for its answer.

        It covers every reading so far, those that wait included.

        Raises RuntimeError before the model is born.
        """
        gp = self.gp
        self._since_request = []
        self._requested_at = self.samples
        return ReestimateRequest(
            cells=self._cells(),
            basis=gp.basis,
            basis_readings=gp.basis_readings,
            basis_counts=gp.basis_counts,
            kernel=gp.kernel,
            structure=self._structure,
            starts=self._starts,
            prior_mean=gp.prior_mean,
            refresh_mean=self._centring_samples > 0,
            span_m=self._span_m,
            build=self._build,
            time_s=self._newest_s,
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
        self._starts = result.choice.starts
        if not result.fit.kept_start:
            self._structure = result.fit.structure
            self._guess = None
            self.calibration.restart()
            self.ahead.restart()
        self.mark()

    @property
    def _slice(self) -> int:
        size = self.capacity * (self._prior if self._gp is None else self._gp).kernel.states
        return max(1, int(_SLICE_US / replacement_us(size)))

    @property
    def _newest_s(self) -> float:
        """Model time of the newest reading, learnt or waiting."""
        return max([self._time_s, *(time_s for *_, time_s in self._waiting)])

    def _cells(self) -> HistoryCells:
        """The history, the mean places of its cells on the grid again: some of them become the basis."""
        cells = self.history.cells()
        return replace(cells, points=self._snapped(cells.points))

    def _snapped(self, points: ArrayLike) -> FloatArray:
        return snapped(points, grid_step_m(self._span_m))

    def _median_kernel(self, variance: float) -> Kernel:
        return STRUCTURES[_FIRST_STRUCTURE].median(Scales(self._span_m, variance))

    def _first_starts(self) -> dict[str, Kernel]:
        """Given hyperparameters are where the fits of their kind begin."""
        if self._given is None:
            return {}
        return dict.fromkeys((_FIRST_STRUCTURE, f"{_FIRST_STRUCTURE}_ard"), self._given)

    def _give_birth(self) -> Update | None:
        kernel = self._prior.kernel if self._guess is None else self._guess.kernel()
        mean = math.fsum(value for _, _, value, _ in self._collected) / len(self._collected)
        self._gp = self._build.model(kernel, mean)
        self._waiting.extend(self._collected)
        self._collected = []
        return self._work_off(self._slice)

    def _work_off(self, maximum: int) -> Update | None:
        """Learn at most `maximum` of the readings that wait; what became of the last of all, if it is learnt."""
        if not self._waiting:
            return None
        outcome = None
        for _ in range(min(maximum, len(self._waiting))):
            outcome = self._learn(self._waiting.popleft())
        if self.gp.fault() is not None:
            self._repair()
        return None if self._waiting else outcome

    def _learn(self, reading: _Reading) -> Update:
        number, point, value, time_s = reading
        self.gp.advance(max(0.0, time_s - self._time_s) if math.isfinite(self._time_s) else 0.0)
        self._time_s = max(self._time_s, time_s)
        # A reading that is learnt again, by a new model, was judged when it came.
        new, log_slope = number > self._judged, self.transform.log_slope(value)
        if new and self.gp.fault() is None:
            self.ahead.look(point, value, time_s, self.gp.model, log_slope)
        outcome = self.gp.update(point, value)
        residual = self.gp.residual
        if new and residual is not None and self.gp.fault() is None:
            self._judged = number
            self.calibration.add(residual.innovation, residual.variance, log_slope)
        return outcome

    def _repair(self) -> None:
        """Make the model anew from the history, under its present kernel: its state is worth nothing any more."""
        self._remake(self.gp.kernel, self.gp.prior_mean)
        self.repairs += 1
        self.mark()

    def _remake(self, kernel: Kernel, prior_mean: float) -> None:
        """Make the model anew from the history, which has those that wait, too."""
        now_s = self._newest_s
        self._waiting.clear()
        self._gp = self._build.rebuilt(self._cells(), kernel, prior_mean, now_s)
        self._time_s = now_s
