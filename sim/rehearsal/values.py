"""What is asked of a dry run, and what comes of it."""

from dataclasses import dataclass

import numpy as np

from autonomy.geometry import FloatArray
from autonomy.wire import HealthNotice, PlanNotice
from sim.currents import TidalCurrent
from sim.truth_map import TruthMap


class DryRunError(RuntimeError):
    """Nothing could be sailed; the text says why, for a person."""


@dataclass(frozen=True, eq=False)
class Wishes:
    """What the configuration does not say.

    Attributes:
        spec: of the field, as `open_field` has it; None: one is made up for the survey.
        variable: of a NetCDF file.
        patch_m: length of the made-up field's kernel; None: the configuration's, or a quarter of the survey's side.
        noise: standard deviation of a reading; None: a twentieth of the field's.
        seed: of field, noise and battery.
        start_m: shape (2,), where the boat lies, local metres.
        hours: the run ends after so many; None: with the budget, or without one when the boat has sailed
            `BUDGET_SIDES`.
        current_mps: of the water, to the east and to the north.
        tide: on top of that.
        battery_wh: capacity; None: `budget.energy_wh`.
        consumption_j_per_m: what a metre really costs in still water; None: what the configuration guesses.
        battery_noise: standard deviation of the power drawn, relative to it.
    """

    start_m: FloatArray
    spec: str | None = None
    variable: str | None = None
    patch_m: float | None = None
    noise: float | None = None
    seed: int = 0
    hours: float | None = None
    current_mps: tuple[float, float] = (0.0, 0.0)
    tide: TidalCurrent | None = None
    battery_wh: float | None = None
    consumption_j_per_m: float | None = None
    battery_noise: float = 0.1


@dataclass(frozen=True)
class Moment:
    """How the map was after so many samples, metres and seconds; errors in the sensor's units.

    `expected` is what the model itself expects of its map, the root of its mean variance over the water.
    """

    samples: int
    km: float
    hours: float
    rmse: float
    expected: float


@dataclass(frozen=True, eq=False)
class Sailed:
    """All that came of it.

    Attributes:
        truth: the sea.
        patch_m: length of the field's kernel, if it was made up.
        noise: standard deviation of a reading.
        reading_s: between two readings.
        is_home: whether the survey has ended at home.
        is_aground: whether the boat touched land.
        is_drained: whether the battery was empty.
        km, hours, energy_wh: from the start on, by the truth; energy is None where nobody says what a metre costs.
        battery_wh: its capacity.
        phases_s: model time of each, in the order in which they came.
        health: what was told ashore of the boat, about once a sample.
        plans: in order.
        moments: in order, the last at the end.
        mean, deviation: of the map at the end, shape (ny, nx), NaN where there is no water.
        basis_m: shape (m, 2).
        reestimates: how often the hyperparameters were estimated anew.
        warnings: the core's own, once each.
    """

    truth: TruthMap
    patch_m: float | None
    noise: float
    reading_s: float
    is_home: bool
    is_aground: bool
    is_drained: bool
    km: float
    hours: float
    energy_wh: float | None
    battery_wh: float
    phases_s: dict[str, float]
    health: tuple[HealthNotice, ...]
    plans: tuple[PlanNotice, ...]
    moments: tuple[Moment, ...]
    field_std: float
    mean: FloatArray
    deviation: FloatArray
    basis_m: FloatArray
    reestimates: int
    warnings: tuple[str, ...]

    @property
    def track_deg(self) -> FloatArray:
        """Latitude and longitude of the boat, shape (k, 2)."""
        places = [(each.lat_deg, each.lon_deg) for each in self.health if each.lat_deg is not None]
        return np.asarray(places, dtype=float).reshape(-1, 2)
