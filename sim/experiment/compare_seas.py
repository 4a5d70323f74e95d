"""The seas of a comparison: which fields by default, and what a voyage on one of them starts from."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from autonomy.geometry import FloatArray
from autonomy.planning.passage import passage_of
from autonomy.planning.survey import SurveyArea
from sim.experiment.waters import StillField, waters_of
from sim.field import Field, FieldError, MaskedField, open_field, shrunk
from sim.truth_map import TruthMap

SPEED_MPS = 1.5
READINGS_PER_SIDE = 50
"""Readings are taken every √(water area) divided by this, whoever sails."""

NOISE_SHARE = 0.02
"""Standard deviation of a reading's noise, as a share of the field's."""

LARGEST_SIDE_M = 15_000.0
STANDOFF_M = 100.0
MAP_CELLS = 80
_OFF_SHORE = 0.03
_TRIES = 2000


@dataclass(frozen=True)
class SeaChoice:
    """A field to compare on; plain values, so that a sweep's cell can name it.

    Attributes:
        name: for people.
        spec: a NetCDF file, or the word of a synthetic field.
        variable: of the file; None: as `open_field` chooses.
        moves: whether it is sailed while it changes; else it stands still at its first instant.
    """

    name: str
    spec: str
    variable: str | None = None
    moves: bool = False


SYNTHETIC = (
    SeaChoice("coast", "synthetic-patch:0"),
    SeaChoice("bight", "synthetic:1"),
    SeaChoice("coast, moving", "synthetic-moving:0", moves=True),
)
_REAL = (
    ("Texas shelf, salinity", "txla_roms_native_top10levels.nc", "salt", False),
    ("Texas shelf, temperature", "txla_roms_native_top10levels.nc", "temp", False),
    ("Nordic seas, salinity", "Nordic_subset.nc", "salt", False),
    ("Nordic seas, temperature", "Nordic_subset.nc", "temp", False),
    ("Point Conception, salinity", "ucla_roms_point_conception_joined_101x201.nc", "salt", False),
    ("Point Conception, temperature", "ucla_roms_point_conception_joined_101x201.nc", "temp", False),
    ("California bight, satellite", "scb_mur_sst_7dates_240x435.nc", "analysed_sst", False),
    ("California bight, moving", "scb_mur_sst_7dates_240x435.nc", "analysed_sst", True),
)


def real_seas(directory: Path) -> tuple[SeaChoice, ...]:
    """The fields of the data folder. FieldError names the files that it lacks."""
    lacking = sorted({file for _, file, _, _ in _REAL if not (directory / file).is_file()})
    if lacking:
        raise FieldError(f"{directory}: lacks {', '.join(lacking)}")
    return tuple(
        SeaChoice(name, str(directory / file), variable, moves) for name, file, variable, moves in _REAL
    )


class HastenedField(MaskedField):
    """A field whose record passes `factor` times as fast; its current is not hastened, and pushes nobody."""

    def __init__(self, inner: Field, factor: float) -> None:
        first_s, last_s = inner.times_s
        super().__init__(inner.info, inner.mask, (first_s / factor, last_s / factor))
        self._inner = inner
        self._factor = factor

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""
        return self._inner.value(lat_deg, lon_deg, time_s * self._factor)


@dataclass(frozen=True, eq=False)
class Sea:
    """A sea, ready to be sailed.

    Attributes:
        choice: which one.
        waters: field, survey, and the map on which beliefs are judged.
        side_m: √(water area): the unit of lengths.
        budget_m: what may be sailed.
        unit: the field's standard deviation over the water at its first instant: the unit of errors.
        shrunk: by how much its coordinates were drawn together; 1: not at all.
        hastened: how many times as fast as in its record the field changes; 1 if it has no end.
    """

    choice: SeaChoice
    waters: TruthMap
    side_m: float
    budget_m: float
    unit: float
    shrunk: float
    hastened: float = 1.0

    @property
    def noise(self) -> float:
        """Standard deviation of a reading's noise."""
        return NOISE_SHARE * self.unit

    @property
    def spacing_m(self) -> float:
        """Between readings."""
        return self.side_m / READINGS_PER_SIDE

    @property
    def points_m(self) -> FloatArray:
        """Middles of the map's water cells, (n, 2): where beliefs are judged."""
        rows, columns = np.nonzero(self.waters.is_water)
        return np.column_stack([self.waters.x_axis_m[columns], self.waters.y_axis_m[rows]])

    def truth(self, time_s: float) -> FloatArray:
        """The field at `points_m`, (n,)."""
        return np.asarray(self.waters.truth(time_s)[self.waters.is_water])

    def launch(self, number: int) -> FloatArray:
        """One of many places near the shore or, where there is no land, the edge; (2,). The same for the same number.

        Most of the water can be reached from it.
        """
        survey = self.waters.survey
        rng = np.random.default_rng([number, *self.choice.name.encode()])
        edge = (survey.navigable if survey.obstacles.is_empty else survey.obstacles).boundary
        sites = survey.candidate_sites(20, 20)
        reach_m = survey.standoff_m + _OFF_SHORE * self.side_m
        for _ in range(_TRIES):
            place, angle = (
                edge.interpolate(float(rng.random()), normalized=True),
                rng.uniform(0.0, 2.0 * np.pi),
            )
            start = np.array([place.x + reach_m * np.cos(angle), place.y + reach_m * np.sin(angle)])
            if survey.is_navigable(start)[0] and _reaches_most(survey, start, sites):
                return start
        raise FieldError(
            f"{self.choice.name}: found no launch near the shore from which most water is reached"
        )


def _reaches_most(survey: SurveyArea, start_m: FloatArray, sites_m: FloatArray) -> bool:
    return 2 * int(passage_of(survey).reachable(start_m, sites_m).sum()) >= len(sites_m)


@lru_cache(maxsize=2)
def open_sea(choice: SeaChoice, sides: float | None, budget_m: float | None) -> Sea:
    """A sea with a budget of `sides` × √(water area), or of `budget_m` metres.

    A field larger than 15 km is drawn together to that; a record that moves is hastened such that all of it passes
    while the budget is sailed.

    Raises:
        FieldError: the field can't be opened or surveyed, or does not vary.
    """
    original = open_field(choice.spec, choice.variable)
    field = shrunk(original, LARGEST_SIDE_M)
    if not choice.moves:
        field = StillField(field)
    width_m, height_m = field.bounds.size_m
    factor = max(original.bounds.size_m) / max(width_m, height_m)
    cells = MAP_CELLS / max(width_m, height_m)
    rows, columns = max(2, round(cells * height_m)), max(2, round(cells * width_m))
    waters = waters_of(field, rows, columns, standoff_m=STANDOFF_M)
    side_m = float(np.sqrt(waters.survey.area_m2))
    length_m = budget_m if sides is None else sides * side_m
    if length_m is None:
        raise ValueError("a sea needs a budget: sides or budget_m")
    hastened = 1.0
    if choice.moves:
        first_s, last_s = field.times_s
        if not last_s > first_s:
            raise FieldError(f"{choice.name}: its record has one instant only, so that nothing moves")
        if np.isfinite(last_s):
            hastened = (last_s - first_s) / (length_m / SPEED_MPS)
            waters = TruthMap(HastenedField(field, hastened), waters.survey, waters.x_axis_m, waters.y_axis_m)
    unit = float(np.nanstd(waters.truth(0.0)))
    if not unit > 0.0:
        raise FieldError(f"{choice.name}: does not vary over the water: there is nothing to learn")
    return Sea(choice, waters, side_m, length_m, unit, factor, hastened)
