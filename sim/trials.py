"""Offline trials of planners: a still field, a launch and a budget; what maps do the readings of each track allow?

No vessel and no wire: tracks are polylines, readings are taken at equal distances along them with seeded noise, and
the same Gaussian process maps all of them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from autonomy.geometry import FloatArray, advance_along, path_length_m
from autonomy.learning.field_model import FieldModel
from autonomy.learning.history import HistoryCells
from autonomy.learning.kernel import Hyperparameters
from autonomy.learning.roughness import Roughness
from autonomy.planning.plan import Plan
from autonomy.planning.request import PlanRequest
from autonomy.planning.survey import SurveyArea
from autonomy.planning.sweeps import lawnmowers

__all__ = ["Matern32Map", "Readings", "Sea", "Trial"]

READINGS_PER_SIDE = 50
PLANS = 7
_CHUNK = 2000
_LONGEST = 2.0
_SHORTEST = 0.02

Planner = Callable[[PlanRequest, SurveyArea], Plan]


@dataclass(frozen=True, eq=False)
class Matern32Map:
    """A zero-mean Matérn-3/2 Gaussian process about `mean`; the noise is that of one reading, variances in units²."""

    lengthscale_m: float
    signal_variance: float
    noise_variance: float
    mean: float

    @classmethod
    def most_likely(cls, points_m: FloatArray, values: FloatArray, side_m: float) -> "Matern32Map":
        """Maximum likelihood on readings, (n, 2) and (n,); the signal's variance in closed form."""
        distance, centred = cdist(points_m, points_m) / side_m, values - values.mean()

        def profile(theta: FloatArray) -> tuple[float, float]:
            matrix = _matern32(distance / np.exp(theta[0])) + np.exp(theta[1]) * np.eye(len(values))
            factor = cho_factor(matrix, lower=True)
            variance = float(centred @ cho_solve(factor, centred)) / len(values)
            return float(
                np.log(np.diagonal(factor[0])).sum() + 0.5 * len(values) * np.log(variance)
            ), variance

        bounds = [(np.log(_SHORTEST), np.log(_LONGEST)), (np.log(1e-5), 0.0)]
        starts = [np.array([np.log(scale), np.log(1e-3)]) for scale in (0.1, 0.4)]
        found = [minimize(lambda t: profile(t)[0], s, bounds=bounds, method="L-BFGS-B") for s in starts]
        theta = min(found, key=lambda result: result.fun).x
        variance = profile(theta)[1]
        return cls(
            float(np.exp(theta[0]) * side_m),
            variance,
            float(np.exp(theta[1]) * variance),
            float(values.mean()),
        )

    def predict(self, readings: "Readings", points_m: FloatArray) -> FloatArray:
        """The posterior mean at points (n, 2), shape (n,)."""
        places = readings.points_m / self.lengthscale_m
        matrix = self.signal_variance * _matern32(cdist(places, places))
        matrix[np.diag_indices_from(matrix)] += self.noise_variance
        alpha = cho_solve(cho_factor(matrix, lower=True), readings.values - self.mean)
        parts = []
        for start in range(0, len(points_m), _CHUNK):
            cross = _matern32(cdist(points_m[start : start + _CHUNK] / self.lengthscale_m, places))
            parts.append(self.mean + self.signal_variance * cross @ alpha)
        return np.concatenate(parts)


def _matern32(distance: FloatArray) -> FloatArray:
    u = np.sqrt(3.0) * distance
    return np.asarray((1.0 + u) * np.exp(-u))


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings along a track: places (n, 2) in metres, values (n,)."""

    points_m: FloatArray
    values: FloatArray


@dataclass(frozen=True, eq=False)
class Sea:
    """A still field.

    Attributes:
        name: for a person.
        survey: its water.
        value: the field at points (n, 2) of the water, shape (n,).
        points_m, truth: shapes (m, 2) and (m,), where and by what maps are judged.
    """

    name: str
    survey: SurveyArea
    value: Callable[[FloatArray], FloatArray]
    points_m: FloatArray
    truth: FloatArray

    @property
    def side_m(self) -> float:
        """√(water area)."""
        return float(np.sqrt(self.survey.area_m2))

    @cached_property
    def noise(self) -> float:
        """Standard deviation of the readings' noise: 2 % of the field's."""
        return 0.02 * float(self.truth.std())

    @cached_property
    def judge(self) -> Matern32Map:
        """The map that judges all tracks: fitted to noisy values at 400 places, drawn at random."""
        rng = np.random.default_rng(0)
        chosen = rng.choice(len(self.truth), min(400, len(self.truth)), replace=False)
        values = self.truth[chosen] + self.noise * rng.normal(size=len(chosen))
        return Matern32Map.most_likely(self.points_m[chosen], values, self.side_m)

    def launch(self, number: int) -> FloatArray:
        """A navigable place .03 of the side off the shore or, where there is no land, the edge; shape (2,)."""
        rng = np.random.default_rng([number, *self.name.encode()])
        obstacles, reach_m = self.survey.obstacles, 0.03 * self.side_m
        edge = (self.survey.navigable if obstacles.is_empty else obstacles).boundary
        while True:
            place, angle = (
                edge.interpolate(float(rng.random()), normalized=True),
                rng.uniform(0.0, 2.0 * np.pi),
            )
            start = np.array([place.x + reach_m * np.cos(angle), place.y + reach_m * np.sin(angle)])
            if self.survey.is_navigable(start)[0]:
                return start

    def error(self, readings: Readings) -> float:
        """RMSE of the judge's map."""
        return float(np.sqrt(np.mean((self.judge.predict(readings, self.points_m) - self.truth) ** 2)))


@dataclass(frozen=True, eq=False)
class Trial:
    """One launch with one budget.

    Attributes:
        sea: the field.
        start_m: shape (2,).
        length: the budget in √(water area).
        seed: of the readings' noise.
    """

    sea: Sea
    start_m: FloatArray
    length: float
    seed: int = 0

    @property
    def budget_m(self) -> float:
        """In metres."""
        return self.length * self.sea.side_m

    @property
    def spacing_m(self) -> float:
        """Between readings."""
        return self.sea.side_m / READINGS_PER_SIDE

    def lawnmowers(self) -> list[FloatArray]:
        """Tracks (k, 2) of the densest lawnmower in each of two directions, from the launch, one cover each."""
        best: dict[float, tuple[tuple[float, float], FloatArray]] = {}
        for sweep in lawnmowers(self.sea.survey, self.start_m, self.budget_m):
            rank = sweep.spacing_m, sweep.inset_m
            if sweep.heading_rad not in best or rank < best[sweep.heading_rad][0]:
                best[sweep.heading_rad] = rank, np.concatenate([self.start_m[None], sweep.route_m])
        return [track for _, track in best.values()]

    def read(self, track_m: FloatArray) -> Readings:
        """Readings at equal distances along a track, its start included."""
        places = resampled(track_m, self.spacing_m)
        noise = np.random.default_rng(self.seed).normal(size=len(places))
        return Readings(places, self.sea.value(places) + self.sea.noise * noise)

    def sailed(self, planner: Planner, plans: int = PLANS) -> FloatArray:
        """The track (k, 2) of a planner that is asked at the start and at each of `plans` equal parts of the budget."""
        track = self.start_m[None]
        roughness = Roughness(self.sea.side_m, self.budget_m)
        heard = 0
        remainder = np.empty((0, 2))
        for number in range(plans):
            readings = self.read(track)
            for k in range(heard, len(readings.values)):
                roughness.add(readings.points_m[k], float(readings.values[k]), float(k))
            heard = len(readings.values)
            left_m = self.budget_m - path_length_m(track)
            plan = planner(self._request(track[-1], left_m, remainder, readings, roughness), self.sea.survey)
            if plan.length_m > left_m * (1.0 + 1e-9):
                raise ValueError(f"{plan.planner} plans {plan.length_m:.0f} m where {left_m:.0f} m are left")
            sail_m = left_m if number == plans - 1 else self.budget_m / plans
            done, remainder = parted(np.concatenate([track[-1:], plan.route_m]), sail_m)
            track = np.concatenate([track, done[1:]])
        return track

    def _request(
        self,
        here_m: FloatArray,
        left_m: float,
        remainder: FloatArray,
        readings: Readings,
        roughness: Roughness,
    ) -> PlanRequest:
        judge, count = self.sea.judge, len(readings.values)
        kernel = Hyperparameters(
            judge.signal_variance, self.sea.noise**2, (judge.lengthscale_m, judge.lengthscale_m)
        )
        return PlanRequest(
            model=FieldModel.prior(kernel, judge.mean),
            start_m=here_m,
            spots=20,
            lattice=(12, 12),
            reason="trial",
            remainder_m=remainder,
            measured=HistoryCells(
                readings.points_m, readings.values, np.ones(count), np.arange(count, dtype=float)
            ),
            budget_m=left_m,
            sample_spacing_m=self.spacing_m,
            roughness=roughness.frozen(),
        )


def resampled(track_m: FloatArray, spacing_m: float) -> FloatArray:
    """Places every `spacing_m` along a polyline (k, 2), its start included."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track_m, axis=0).T))])
    wanted = np.arange(0.0, travelled[-1] + 1e-9 * spacing_m, spacing_m)
    return np.column_stack([np.interp(wanted, travelled, track_m[:, axis]) for axis in range(2)])


def parted(track_m: FloatArray, sail_m: float) -> tuple[FloatArray, FloatArray]:
    """A polyline (k, 2) up to `sail_m`, both ends included, and the corners after that."""
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(track_m, axis=0).T))])
    passed = int(np.searchsorted(travelled, sail_m, side="left"))
    if passed == len(track_m):
        return track_m, track_m[:0]
    return np.concatenate([track_m[:passed], advance_along(track_m, sail_m)[None]]), track_m[passed:]
