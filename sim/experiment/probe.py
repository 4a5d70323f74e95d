"""The probe of a voyage: read all along the way, or once at each spot of the newest plan."""

import math
from dataclasses import dataclass, field

import numpy as np

from sim.experiment.orders import Orders
from sim.sensor import Sensor
from sim.vessel import Position, Vessel

READINGS_PER_SAMPLE = 5
"""The probe reads so often between two samples: after a turn a sample comes at most this share of the spacing late."""


@dataclass
class Probe(Sensor):
    """A sensor that remembers where it was read."""

    positions: list[Position] = field(default_factory=list)

    def read(self, position: Position, time_s: float) -> float:
        """As any sensor, and remember where."""
        self.positions.append(position)
        return super().read(position, time_s)

    def told(self, spots: list[Position]) -> None:
        """Another plan has these spots."""


@dataclass
class SpotProbe(Probe):
    """A probe that is read once at each spot of the newest plan, within `reach_m` of it."""

    vessel: Vessel = field(kw_only=True)
    reach_m: float = field(kw_only=True)
    spots: list[Position] = field(default_factory=list)

    @property
    def next_time_s(self) -> float:
        """At once where there is a spot to be read, else never."""
        return -math.inf if self._near(self.vessel.position) else math.inf

    def read(self, position: Position, time_s: float) -> float:
        """As any probe, and be done with the spots here."""
        self.spots = [spot for spot in self.spots if spot not in self._near(position)]
        return super().read(position, time_s)

    def told(self, spots: list[Position]) -> None:
        """These are to be read now, and no others."""
        self.spots = spots

    def _near(self, position: Position) -> list[Position]:
        return [spot for spot in self.spots if position.distance_to(spot) <= self.reach_m]


def make_probe(orders: Orders, vessel: Vessel, speed_mps: float, sample_s: float) -> Probe:
    """The probe that is ordered, on this vessel at this speed, with so long between two samples."""
    truth, rng = orders.waters.field, np.random.default_rng(orders.seed)
    name, interval_s = orders.configuration.sensor.message_name, sample_s / READINGS_PER_SAMPLE
    if not orders.spots_only:
        return Probe(truth, rng, name, interval_s, orders.noise)
    # In a step of a second the vessel gets that far.
    return SpotProbe(truth, rng, name, interval_s, orders.noise, vessel=vessel, reach_m=speed_mps)
