"""A whole mission before anyone gets wet: the boat's own configuration, on a sea that is known.

The core is the daemon's, the vessel that of `sim vessel`, and `DiscreteRun` jumps from deadline to deadline between the
two: there is no other loop, and no planning of its own. Nothing that the configuration says of networks and serial
ports is opened.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Topic
from autonomy.geometry import FloatArray
from autonomy.planning.survey import SurveyArea
from autonomy.wire import HealthNotice, LogNotice
from sim.autopilot import Autopilot, Options
from sim.discrete import DiscreteRun
from sim.field import Field, open_field
from sim.patchy import Levels, PatchyField
from sim.rehearsal.values import DryRunError, Moment, Sailed, Wishes
from sim.sensor import Sensor
from sim.truth_map import TruthMap
from sim.vessel import Battery, Handling, Position, SummedCurrent, UniformCurrent, Vessel

READINGS_PER_SAMPLE = 5
"""The probe reads so often between two samples, but not more than once a second."""

SAMPLES_PER_SIDE = 200
"""Where all readings teach (`sampling.spacing_m` 0), the probe reads so often on a side of the survey."""

NOISE_SHARE = 0.05
"""Standard deviation of the probe's noise, as a share of the field's."""

PATCHES_PER_SIDE = 4.0
"""Lengths of a made-up field on a side of the survey, where nobody says how long they are."""

BUDGET_SIDES = 16.0
"""How far a boat without a budget sails, in square roots of the water's area."""

MAP_CELLS = 130
JUDGED_SIDES = 0.25
"""The map is judged as often as this is sailed, in square roots of the water's area."""

_LONGEST_S = 30 * 86400.0
_JOB_S = 10.0  # what a plan takes on a small computer
_FASTEST = 20.0  # as often as this the core is not called in vain
_OLD_NEWS_S = 1e6
_HOTEL_W = 25.0
_HOTEL_SHARE = 0.3
_BATTERY_WH = 5000.0
_CRUISE_W = 120.0


def sail(
    configuration: Configuration,
    survey: SurveyArea,
    wishes: Wishes,
    progress: Callable[[float, float], None] = lambda km, hours: None,
) -> Sailed:
    """Sail a mission from a mission on board to its end.

    Args:
        configuration: the boat's.
        survey: what it describes.
        wishes: the rest.
        progress: is told kilometres and hours now and then.

    Raises:
        FieldError: the field can't be opened.
        DryRunError: the start is on land, the field knows nothing of the survey's water, or no mission comes on board.
    """
    run = _Rehearsal.begin(configuration, survey, wishes)
    try:
        run.start_survey()
    except RuntimeError:
        raise DryRunError(f"no mission comes on board: {_last_words(run)}") from None
    run.began = run.spent
    while not run.is_over:
        run.advance(1.0)
        run.look()
        progress(run.spent.km - run.began.km, run.spent.hours - run.began.hours)
    return run.record()


def open_sea(configuration: Configuration, survey: SurveyArea, wishes: Wishes) -> tuple[Field, float | None]:
    """The field, and the length of its kernel if it is made up. Raises FieldError."""
    if wishes.spec is not None:
        return open_field(wishes.spec, wishes.variable), None
    given = configuration.model.hyperparameters
    side_m = math.sqrt(survey.area_m2)
    length_m = wishes.patch_m or (
        side_m / PATCHES_PER_SIDE if given is None else math.sqrt(math.prod(given.lengthscales_m))
    )
    deviation = None if given is None else math.sqrt(given.signal_variance)
    levels = Levels.within(configuration.sensor, deviation)
    rng = np.random.default_rng((wishes.seed, 3))
    return PatchyField(survey, length_m, levels, configuration.sensor, rng), length_m


@dataclass(frozen=True)
class _Spent:
    km: float
    hours: float
    energy_wh: float


@dataclass
class _Rehearsal(DiscreteRun):
    """A discrete run that is looked at."""

    truth: TruthMap = field(kw_only=True)
    patch_m: float | None = field(kw_only=True)
    ends_after_s: float = field(kw_only=True)
    knows_energy: bool = field(kw_only=True)
    began: _Spent = field(default_factory=lambda: _Spent(0.0, 0.0, 0.0))
    moments: list[Moment] = field(default_factory=list)

    @classmethod
    def begin(cls, configuration: Configuration, survey: SurveyArea, wishes: Wishes) -> "_Rehearsal":
        """Everything as it is before the operator starts the survey."""
        sea, patch_m = open_sea(configuration, survey, wishes)
        truth = _truth_map(sea, survey)
        deviation = _check(truth, wishes.start_m)
        speed_mps, side_m = configuration.budget.speed_mps, math.sqrt(survey.area_m2)
        spacing_m = configuration.sampling.spacing_m
        sample_s = (spacing_m or side_m / SAMPLES_PER_SIDE) / speed_mps
        reading_s = max(1.0, sample_s / READINGS_PER_SAMPLE if spacing_m else sample_s)
        speedup = min(_FASTEST, max(1.0, sample_s))
        sensor = Sensor(
            sea,
            np.random.default_rng((wishes.seed, 0)),
            configuration.sensor.message_name,
            reading_s,
            NOISE_SHARE * deviation if wishes.noise is None else wishes.noise,
        )
        options = Options(
            system_id=configuration.mavlink.system_id or 1,
            speed_mps=speed_mps,
            waypoint_radius_m=configuration.mavlink.acceptance_radius_m or Options.waypoint_radius_m,
        )
        return cls(
            Core(_rehearsed(configuration), survey),
            Autopilot(_vessel(configuration, survey, sea, wishes), sensor, options),
            survey,
            job_s=_JOB_S / speedup,
            speedup=speedup,
            truth=truth,
            patch_m=patch_m,
            ends_after_s=_ends_after_s(configuration, wishes, BUDGET_SIDES * side_m / speed_mps),
            knows_energy=(wishes.consumption_j_per_m or configuration.budget.consumption_j_per_m) is not None,
        )

    @property
    def spent(self) -> _Spent:
        """Since the boat was switched on."""
        vessel = self.autopilot.vessel
        return _Spent(vessel.distance_sailed_m / 1e3, vessel.time_s / 3600.0, vessel.battery.used_wh)

    @property
    def is_over(self) -> bool:
        """Whether nothing more will come."""
        vessel = self.autopilot.vessel
        late = (self.spent.hours - self.began.hours) * 3600.0 >= self.ends_after_s
        return late or self._is_home or vessel.aground or vessel.battery.remaining <= 0.0

    @property
    def _is_home(self) -> bool:
        told = self.published[Topic.HEALTH]
        return bool(told) and told[-1].state == "finished"

    def look(self) -> None:
        """Judge the map, if enough was sailed since the last time."""
        step_km = JUDGED_SIDES * math.sqrt(self.survey.area_m2) / 1e3
        last_km = self.moments[-1].km if self.moments else 0.0
        if self.core.learner.born and self.spent.km - self.began.km >= last_km + step_km:
            self.moments.append(self._judged()[0])

    def _judged(self) -> tuple[Moment, FloatArray, FloatArray]:
        """How the map is now, with its mean and standard deviation on the cells of the truth's."""
        truth, time_s = self.truth, self.autopilot.vessel.time_s
        believed = self.core.learner.model(time_s).predict_grid(truth.x_axis_m, truth.y_axis_m)
        known = np.isfinite(truth.truth(time_s))
        mean, variance = (np.where(known, each, np.nan) for each in (believed.mean, believed.variance))
        moment = Moment(
            self.core.learner.samples,
            self.spent.km - self.began.km,
            self.spent.hours - self.began.hours,
            float(np.sqrt(np.nanmean((mean - truth.truth(time_s)) ** 2))),
            math.sqrt(max(0.0, float(np.nanmean(variance)))),
        )
        return moment, mean, np.sqrt(np.maximum(variance, 0.0))

    def record(self) -> Sailed:
        """What came of it."""
        vessel, sensor = self.autopilot.vessel, self.autopilot.sensor
        assert sensor is not None
        moment, mean, deviation = self._judged()
        return Sailed(
            truth=self.truth,
            patch_m=self.patch_m,
            noise=sensor.noise_std,
            reading_s=sensor.interval_s,
            is_home=self._is_home,
            is_aground=vessel.aground,
            is_drained=vessel.battery.remaining <= 0.0,
            km=moment.km,
            hours=moment.hours,
            energy_wh=self.spent.energy_wh - self.began.energy_wh if self.knows_energy else None,
            battery_wh=vessel.battery.capacity_wh,
            phases_s=_phases_s(self.published[Topic.HEALTH]),
            health=tuple(self.published[Topic.HEALTH]),
            plans=tuple(self.published[Topic.PLAN]),
            moments=(*self.moments, moment),
            field_std=float(np.nanstd(self.truth.truth(vessel.time_s))),
            mean=mean,
            deviation=deviation,
            basis_m=np.array(self.core.learner.basis, dtype=float).reshape(-1, 2),
            reestimates=sum(text.startswith("re-estimated") for _, text in self.log),
            warnings=self._warnings(),
        )

    def _warnings(self) -> tuple[str, ...]:
        """Of the core; not those about the simulated autopilot's failsafes, which say nothing of the boat's."""
        safeguards = self.core.safeguards
        known = set() if safeguards is None else set(safeguards.warnings)
        told: list[LogNotice] = self.published[Topic.LOG]
        said = (each.text for each in told if each.level in ("warning", "error"))
        return tuple(dict.fromkeys(text for text in said if text not in known))


def _last_words(run: DiscreteRun) -> str:
    """Of the log, each once, without what is said of the next try."""
    said = [text.partition("; trying again")[0] for _, text in run.log[-3:]]
    return "; ".join(dict.fromkeys(said))


def _truth_map(sea: Field, survey: SurveyArea) -> TruthMap:
    x_min, y_min, x_max, y_max = survey.bounds
    cell_m = survey.span_m / MAP_CELLS
    x_axis_m, y_axis_m = (np.arange(a + cell_m / 2, b, cell_m) for a, b in ((x_min, x_max), (y_min, y_max)))
    return TruthMap(sea, survey, x_axis_m, y_axis_m)


def _check(truth: TruthMap, start_m: FloatArray) -> float:
    """The field's standard deviation over the survey's water at the beginning.

    Raises:
        DryRunError: there is no such field, or the boat would lie on land.
    """
    sea, frame = truth.field, truth.survey.frame
    values = truth.truth(0.0)
    if not np.isfinite(values).any():
        bounds = sea.bounds
        raise DryRunError(
            f"{sea.info.description}: nothing of it lies in the survey's water; it reaches from latitude "
            f"{bounds.south:.4f} to {bounds.north:.4f} and from longitude {bounds.west:.4f} to {bounds.east:.4f}"
        )
    deviation = float(np.nanstd(values))
    if not deviation > 0.0:
        raise DryRunError(f"{sea.info.long_name} does not vary over the water: there is nothing to learn")
    lat_deg, lon_deg = frame.to_geodetic(start_m).tolist()
    if bool(sea.is_land(lat_deg, lon_deg)):
        raise DryRunError(f"the start at {lat_deg:.5f}, {lon_deg:.5f} is on land")
    return deviation


def _ends_after_s(configuration: Configuration, wishes: Wishes, endless_s: float) -> float:
    if wishes.hours is not None:
        return wishes.hours * 3600.0
    return _LONGEST_S if configuration.budget.is_limited else endless_s


def _rehearsed(configuration: Configuration) -> Configuration:
    """The configuration as it is, but that missions are sent, and told as often as is looked at here."""
    shore = configuration.shore.model_copy(update={"model_period_s": _OLD_NEWS_S, "health_period_s": 1.0})
    # The simulated probe reads where the position is told, and at once.
    sensor = configuration.sensor.model_copy(update={"intake_forward_m": 0.0, "intake_starboard_m": 0.0})
    sections: dict[str, object] = {"shore": shore, "sensor": sensor}
    if configuration.authority.mode == "observe":
        sections["authority"] = configuration.authority.model_copy(update={"mode": "missions"})
    return configuration.model_copy(update=sections)


def _vessel(configuration: Configuration, survey: SurveyArea, sea: Field, wishes: Wishes) -> Vessel:
    lat_deg, lon_deg = survey.frame.to_geodetic(wishes.start_m).tolist()
    budget = configuration.budget
    each = wishes.consumption_j_per_m or budget.consumption_j_per_m
    total_w = _HOTEL_W + _CRUISE_W if each is None else each * budget.speed_mps
    hotel_w = min(_HOTEL_W, _HOTEL_SHARE * total_w)
    battery = Battery(
        wishes.battery_wh or budget.energy_wh or _BATTERY_WH,
        hotel_w=hotel_w,
        propulsion_w_per_m3s3=(total_w - hotel_w) / budget.speed_mps**3,
        noise=wishes.battery_noise,
        rng=np.random.default_rng((wishes.seed, 1)),
    )
    tides = () if wishes.tide is None else (wishes.tide,)
    return Vessel(
        Position(lat_deg, lon_deg),
        handling=Handling(turn_rate_deg_s=configuration.vehicle.turn_rate_deg_s),
        current=SummedCurrent((sea, UniformCurrent(*wishes.current_mps), *tides)),
        land=sea,
        battery=battery,
    )


def _phases_s(told: list[HealthNotice]) -> dict[str, float]:
    """Model time in each state, from the start of the survey on; exploring without a sample is the way there."""
    phases: dict[str, float] = {}
    for before, after in pairwise(told):
        name = before.state.replace("_", " ")
        if name == "waiting for vehicle" or before.model_time_s is None or after.model_time_s is None:
            continue
        name = "way there" if name == "exploring" and not before.samples else name
        phases[name] = phases.get(name, 0.0) + after.model_time_s - before.model_time_s
    return phases
