"""The instrument: it reads the field where the boat is, with noise, at its own interval."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sim.faults import Fault
from sim.vessel import Position, ScalarField


@dataclass
class Sensor:
    """A scalar instrument with white Gaussian noise.

    Readings fall on whole multiples of `interval_s` of simulated time. A reading where the field knows no
    value (on land, outside its data) is NaN, as a real instrument out of the water would say. `faults` come last, each
    upon what the one before it makes of a reading. `says` is told each reading, for an instrument that the autopilot
    knows nothing of; None: it is wired to the autopilot, which sends NAMED_VALUE_FLOAT.
    """

    field: ScalarField
    rng: np.random.Generator
    name: str = "SALT"
    interval_s: float = 1.0
    noise_std: float = 0.0
    faults: Sequence[Fault] = ()
    says: Callable[[float], None] | None = None
    taken: int = dataclasses.field(default=0, init=False)

    def __post_init__(self) -> None:
        if not self.interval_s > 0.0:
            raise ValueError(f"the sample interval must be positive, got {self.interval_s} s")
        if not self.noise_std >= 0.0:
            raise ValueError(f"the noise must not be negative, got {self.noise_std}")
        if not (1 <= len(self.name) <= 10 and self.name.isascii()):
            raise ValueError(f"a sensor's name has 1 to 10 ASCII characters, got {self.name!r}")

    @property
    def next_time_s(self) -> float:
        """When the next reading is due, in simulated seconds."""
        return (self.taken + 1) * self.interval_s

    def read(self, position: Position, time_s: float) -> float:
        """Take the reading that is due, at a position and time."""
        self.taken += 1
        true = float(np.asarray(self.field.value(position.lat_deg, position.lon_deg, time_s)))
        value = true + self.noise_std * float(self.rng.standard_normal())
        for fault in self.faults:
            value = fault(time_s, value)
        return value
