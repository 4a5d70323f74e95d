"""The setting of Ma, Liu & Sukhatme 2017 on any field: map, lattice, launches, thresholds, hyperparameters.

What the paper says in map cells is turned into metres here; everything else is `config/paper.yaml`, to the letter.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

import autonomy
from autonomy.config import Configuration, load
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.learning.kernel import Hyperparameters
from sim.experiment.paper_numbers import (
    MANUAL,
    MAP_COLUMNS,
    MAP_ROWS,
    NOISE_SHARE,
    PASSAGE_CELLS,
    RANDOM_SAMPLES,
    RHO0,
    STANDOFF_CELLS,
    Ablation,
)
from sim.experiment.waters import StillField, nearest_water, waters_of
from sim.field import FieldError, open_field
from sim.field_grid import Bounds
from sim.truth_map import TruthMap

PROFILE = Path(autonomy.__file__).parents[1] / "config" / "paper.yaml"

_SPOTS_ONLY_CENTRING = 20


@lru_cache(maxsize=2)
def paper_waters(
    field: str, variable: str | None = None, rows: int = MAP_ROWS, columns: int = MAP_COLUMNS
) -> TruthMap:
    """The field as it is at its first instant, held there, and its map.

    Raises:
        FieldError: the field can't be opened, or no survey can be made of it.
    """
    still = StillField(open_field(field, variable))
    standoff_m = STANDOFF_CELLS * min(cell_sides_m(still.bounds, rows, columns))
    return waters_of(still, rows, columns, standoff_m, min(PASSAGE_CELLS, max(rows, columns)))


def cell_sides_m(bounds: Bounds, rows: int, columns: int) -> tuple[float, float]:
    """How long a step of one column and of one row is in the middle of the map, metres."""
    lat_deg, lon_deg = bounds.centre
    frame = LocalFrame(lat_deg, lon_deg)
    step_lat = (bounds.north - bounds.south) / (rows - 1)
    step_lon = (bounds.east - bounds.west) / (columns - 1)
    east_m = 2.0 * frame.to_local(lat_deg, lon_deg + step_lon / 2.0)[0]
    north_m = 2.0 * frame.to_local(lat_deg + step_lat / 2.0, lon_deg)[1]
    return float(east_m), float(north_m)


def hyperparameters(waters: TruthMap, logarithms: Sequence[float]) -> Hyperparameters:
    """`MANUAL` or `LEARNED`, in metres."""
    noise, signal, east, north = map(math.exp, logarithms)
    sides_m = _sides_m(waters)
    return Hyperparameters(signal, noise, (east * sides_m[0], north * sides_m[1]))


def profile(
    waters: TruthMap, rho0: float = RHO0, seed: int = 0, ablations: Sequence[Ablation] = ()
) -> Configuration:
    """`config/paper.yaml` on this map: lengths are in its cells, and its area is the map's.

    Raises:
        FieldError: the file is not there.
    """
    if not PROFILE.is_file():
        raise FieldError(f"{PROFILE} is not there: the paper's experiment is run from the project's sources")
    by_hand, bounds = hyperparameters(waters, MANUAL), waters.field.bounds
    corners = [(lat, lon) for lat in (bounds.south, bounds.north) for lon in (bounds.west, bounds.east)]
    settings = {
        "seed": seed,
        "survey.area": [list(corners[k]) for k in (0, 1, 3, 2)],
        "survey.standoff_m": waters.survey.standoff_m,
        "survey.passage_cells": waters.survey.passage_cells,
        "sampling.spacing_m": math.sqrt(math.prod(_sides_m(waters))),
        "model.hyperparameters.lengthscales_m": list(by_hand.lengthscales_m),
        "exploration.rho0": rho0,
    }
    if "replaced" in ablations:
        settings["exploration.rho_rule"] = "replaced"
    if {"spots-only", "no-pilot"} <= set(ablations):
        # Fifty readings would be three paths before anything is known.
        settings["model.centring_samples"] = _SPOTS_ONLY_CENTRING
    if "uncentred" in ablations:
        settings["model.centring_samples"] = 0
    return load(PROFILE, {}, [f"{key}={value}" for key, value in settings.items()])


def random_readings(waters: TruthMap, seed: int) -> tuple[FloatArray, FloatArray]:
    """Readings at `RANDOM_SAMPLES` random places of the map's water, as noisy as the vessel's.

    Returns:
        The places, shape (n, 2), local metres, and the values, shape (n,).
    """
    rng, truth = np.random.default_rng(seed), waters.truth(0.0)
    rows, columns = np.nonzero(np.isfinite(truth))
    chosen = rng.choice(len(rows), RANDOM_SAMPLES, replace=False)
    rows, columns = rows[chosen], columns[chosen]
    values = truth[rows, columns] + NOISE_SHARE * np.nanstd(truth) * rng.standard_normal(RANDOM_SAMPLES)
    return np.column_stack([waters.x_axis_m[columns], waters.y_axis_m[rows]]), values


def launch_m(waters: TruthMap, row: int, column: int) -> tuple[FloatArray, float]:
    """Where a launch named by its row and column on the paper's map is on this one, local metres, and its shift.

    The share of the map's rows and columns counts, whatever their number here. The shift, metres, is to the nearest
    cell that a vessel can sail from.
    """
    bounds = waters.field.bounds
    lat_deg = bounds.south + row / (MAP_ROWS - 1) * (bounds.north - bounds.south)
    lon_deg = bounds.west + column / (MAP_COLUMNS - 1) * (bounds.east - bounds.west)
    wanted = waters.survey.frame.to_local(lat_deg, lon_deg)
    if waters.survey.is_navigable(wanted)[0]:
        return wanted, 0.0
    found = nearest_water(waters, wanted)
    return found, float(np.hypot(*(found - wanted)))


def _sides_m(waters: TruthMap) -> tuple[float, float]:
    rows, columns = len(waters.y_axis_m), len(waters.x_axis_m)
    return cell_sides_m(waters.field.bounds, rows, columns)
