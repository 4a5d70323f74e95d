"""How far the boat may still sail: limits on distance, time and energy, what has been spent, and what legs cost."""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from autonomy.config import BudgetSection
from autonomy.consumption import Meter, MetreCost
from autonomy.geometry import FloatArray
from autonomy.mavlink.vehicle import VehicleState

DISTANCE, DURATION, ENERGY = range(3)
"""Columns of everything here that counts limits: metres over ground, seconds of model time, joules."""

CAUTION = 1.0
"""Standard deviations of what has been learnt, on the safe side, in the cost of a leg."""

COHERENT_M = 1000.0
"""Over such a way the weather stays as it is."""

LONGEST_GAP_S = 60.0
"""After a longer silence nobody knows how the boat has sailed meanwhile."""

GAUGE_STEP = 0.01
"""The autopilot tells the battery's charge in percent."""

_WH_J = 3600.0


class Stage(IntEnum):
    """How urgent the way home is."""

    FINE = 0
    LOW = 1
    CRITICAL = 2


@dataclass(frozen=True, eq=False)
class Reading:
    """What the vehicle tells at one moment; None is unknown.

    Attributes:
        time_s: model time.
        point_m: shape (2,), where it is, local metres.
        sailed_m: how far it has sailed over ground since whenever.
        consumed_j: BATTERY_STATUS.energy_consumed, in joules.
        drawn_c: BATTERY_STATUS.current_consumed, in coulombs.
        voltage_v: the battery's.
        charge: share of the battery's charge that is left, 0 to 1.
        is_sailing: whether it is under way by itself: what a metre costs is learnt then.
    """

    time_s: float
    point_m: FloatArray
    sailed_m: float
    consumed_j: float | None = None
    drawn_c: float | None = None
    voltage_v: float | None = None
    charge: float | None = None
    is_sailing: bool = True

    @classmethod
    def of(
        cls, vehicle: VehicleState, point_m: FloatArray, sailed_m: float, *, is_sailing: bool
    ) -> "Reading":
        """From the vehicle as last heard."""
        return cls(
            time_s=vehicle.model_time_s or 0.0,
            point_m=point_m,
            sailed_m=sailed_m,
            consumed_j=vehicle.battery_consumed_j,
            drawn_c=vehicle.battery_drawn_c,
            voltage_v=vehicle.battery_voltage_v,
            charge=vehicle.battery_remaining,
            is_sailing=is_sailing,
        )


class Budget:
    """The ledger of one survey, and the price of its legs.

    `begin` starts the counting; before it nothing is spent. Amounts are arrays of three: metres, seconds, joules, inf
    where there is no limit.
    """

    def __init__(self, section: BudgetSection) -> None:
        self._section = section
        capacity_j = None if section.energy_wh is None else section.energy_wh * _WH_J
        limits = (section.distance_m, section.duration_s, capacity_j)
        self._limits = np.array([math.inf if limit is None else limit for limit in limits])
        self._meter = Meter(capacity_j)
        self._pace = MetreCost(1.0 / section.speed_mps)
        self._consumption = MetreCost(section.consumption_j_per_m)
        self._now: Reading | None = None
        self._begun: Reading | None = None
        self._begun_j = 0.0

    @property
    def is_limited(self) -> bool:
        """Whether anything here can ever bring the boat home."""
        return self._section.is_limited

    @property
    def has_begun(self) -> bool:
        """Whether the counting has begun."""
        return self._begun is not None

    @property
    def limits(self) -> FloatArray:
        """The limits themselves, shape (3,)."""
        return self._limits

    @property
    def speed_mps(self) -> float:
        """Usual speed over ground."""
        return 1.0 / self._pace.mean

    @property
    def consumption_j_per_m(self) -> float:
        """Usual energy per metre over ground."""
        return self._consumption.mean

    def begin(self) -> None:
        """The survey starts (or another one) with what the battery holds now: nothing is spent yet."""
        self._begun, self._begun_j = self._now, self._meter.drawn_j or 0.0

    def follow(self, reading: Reading) -> None:
        """Take in what the vehicle tells; several times a second if it likes."""
        before, self._now = self._now, reading
        self._meter.follow(reading.consumed_j, reading.drawn_c, reading.voltage_v, reading.charge)
        if (
            before is None
            or not reading.is_sailing
            or not 0.0 <= reading.time_s - before.time_s <= LONGEST_GAP_S
        ):
            self._pace.pause()
            self._consumption.pause()
            return
        way = reading.sailed_m - before.sailed_m, reading.point_m - before.point_m
        self._pace.follow(reading.time_s, *way)
        if self._meter.drawn_j is not None:
            self._consumption.follow(self._meter.drawn_j, *way)

    def left(self) -> FloatArray:
        """What is left of the limits, the reserve included, shape (3,)."""
        now, begun = self._now, self._begun
        if now is None:
            return self._limits.copy()
        sailed_m = elapsed_s = drawn_j = 0.0
        if begun is not None:
            sailed_m, elapsed_s = now.sailed_m - begun.sailed_m, now.time_s - begun.time_s
            metered = self._meter.drawn_j
            drawn_j = sailed_m * self.consumption_j_per_m if metered is None else metered - self._begun_j
        left = self._limits - (sailed_m, elapsed_s, drawn_j)
        left[ENERGY] = min(left[ENERGY] - self._missing_j(begun or now), self._gauged_j(now))
        return left

    def usable(self) -> FloatArray:
        """What may still be spent: what is left without the reserve, shape (3,); negative where it is being eaten."""
        return np.where(np.isfinite(self._limits), self.left() - self._reserve(), math.inf)

    def costs(self, points_m: ArrayLike) -> FloatArray:
        """What each leg of a polyline, shape (k, 2), will cost, on the safe side: shape (k - 1, 3)."""
        steps = np.diff(np.asarray(points_m, dtype=float).reshape(-1, 2), axis=0)
        length_m = np.hypot(*steps.T)
        towards = steps / np.maximum(length_m, 1e-9)[:, None]
        rates = [meter.along(towards, CAUTION) for meter in (self._pace, self._consumption)]
        costs: FloatArray = length_m[:, None] * np.column_stack([np.ones(len(length_m)), *rates])
        return costs

    def cost(self, points_m: ArrayLike) -> FloatArray:
        """What a polyline, shape (k, 2), will cost in all, shape (3,).

        Wind and waves that are against the boat stay so for a while: what windows differ by is the less averaged out
        the shorter the way is, and what the last ones cost more than usual the next will cost as well.
        """
        total: FloatArray = self.costs(points_m).sum(axis=0)
        coherent_m = min(total[DISTANCE], math.sqrt(COHERENT_M * total[DISTANCE]))
        for column, meter in ((DURATION, self._pace), (ENERGY, self._consumption)):
            total[column] += coherent_m * (CAUTION * meter.spread + meter.excess)
        return total

    def affords(self, cost: FloatArray) -> bool:
        """Whether so much, shape (3,), may still be spent."""
        return bool((cost <= self.usable()).all())

    def metres(self) -> float:
        """What may still be spent, as metres over ground there and back; inf without a limit."""
        there_and_back = (0.0, 0.0)  # what the current takes one way it gives the other
        rates = [meter.along(there_and_back, CAUTION)[0] for meter in (self._pace, self._consumption)]
        rate, usable = np.array([1.0, *rates]), self.usable()
        bounded = np.isfinite(usable) & (rate > 0.0)
        return max(0.0, float((usable[bounded] / rate[bounded]).min())) if bounded.any() else math.inf

    def room(self, way_home_m: ArrayLike, margin: float) -> float:
        """What the way home, paid so many times, leaves of the scarcest limit, as a share of it; 1 without limits."""
        spare = self.usable() - margin * self.cost(way_home_m)
        limited = np.isfinite(self._limits)
        return float((spare[limited] / self._limits[limited]).min()) if limited.any() else 1.0

    def stage(self, way_home_m: ArrayLike) -> tuple[Stage, str]:
        """How urgent the way home, a polyline (k, 2), is, and why."""
        charge = None if self._now is None else self._now.charge
        section = self._section
        home, usable = self.cost(way_home_m), self.usable()
        low_margin = 0.5 * (1.0 + section.home_margin)
        for stage, threshold, margin in (
            (Stage.CRITICAL, section.critical_battery, 1.0),
            (Stage.LOW, section.low_battery, low_margin),
        ):
            if charge is not None and threshold is not None and charge <= threshold:
                return stage, f"the battery is at {charge:.0%}"
            short = np.flatnonzero(usable < margin * home)
            if len(short):
                return stage, self._said(int(short[0]), usable, home)
        return Stage.FINE, ""

    def said(self) -> str:
        """What may still be spent, for a person; empty without limits."""
        usable = self.usable()
        return ", ".join(_amount(k, float(usable[k])) for k in range(3) if math.isfinite(usable[k]))

    def _said(self, column: int, usable: FloatArray, home: FloatArray) -> str:
        return f"{_amount(column, usable[column])} left to spend, the way home takes {_amount(column, home[column])}"

    def _reserve(self) -> FloatArray:
        finite = np.where(np.isfinite(self._limits), self._limits, 0.0)
        reserve: FloatArray = self._section.reserve * finite
        return reserve

    def _missing_j(self, begun: Reading) -> float:
        """What the battery lacked when the counting began; a gauge's percent may hide as much again."""
        if not math.isfinite(self._limits[ENERGY]) or begun.charge is None:
            return 0.0
        hidden = GAUGE_STEP if self._meter.is_coarse else 0.0
        return float(self._limits[ENERGY] * min(1.0, 1.0 - begun.charge + hidden))

    def _gauged_j(self, now: Reading) -> float:
        """At most so much is left by the autopilot's own gauge, which may be right where the capacity is not."""
        if now.charge is None:
            return math.inf
        return float(self._limits[ENERGY] * (now.charge + GAUGE_STEP))


def _amount(column: int, amount: float) -> str:
    if column == DISTANCE:
        return f"{amount / 1e3:.1f} km"
    if column == DURATION:
        return f"{amount / 60.0:.0f} min"
    return f"{amount / _WH_J:.0f} Wh"
