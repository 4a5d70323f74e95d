"""What about a dry run is to be looked at before the boat leaves."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import shapely

from sim.rehearsal.outcome import Outcome

FEWEST_SITES = 0.5
"""Share of the lattice's sites over water below which the lattice is worth a look."""

WORST_MAP = 0.5
"""Share of the field's standard deviation: a map as wrong as this tells little."""

TOO_SURE = 1.5
"""How many times what the model expects the error may be."""

_COARSE = 3.0
_MANY_REFUSED = 0.05
_SHOWN = 8

Kind = Literal[
    "budget", "home", "land", "lattice", "map", "energy", "readings", "service", "field", "current"
]


@dataclass(frozen=True)
class Doubt:
    """Something to be looked at before the boat leaves."""

    kind: Kind
    text: str


def doubts_of(outcome: Outcome) -> list[Doubt]:
    """What a person should look at, the gravest first."""
    found = [
        *_about_the_end(outcome),
        *_about_the_budget(outcome),
        *_about_the_map(outcome),
        *_about_the_survey(outcome),
    ]
    return found + [Doubt("service", text) for text in outcome.sailed.warnings[:_SHOWN]]


def _about_the_end(outcome: Outcome) -> Iterator[Doubt]:
    sailed = outcome.sailed
    if sailed.is_aground:
        lat_deg, lon_deg = sailed.track_deg[-1]
        yield Doubt(
            "land",
            f"the boat touched land at {lat_deg:.5f}, {lon_deg:.5f}: survey.land and the field disagree, or "
            "survey.standoff_m is too small for the current and the corners that it cuts",
        )
    elif outcome.legs_over_land:
        yield Doubt(
            "land", f"{outcome.legs_over_land} legs of plans cross land of the field: look at survey.land"
        )
    if sailed.is_drained:
        yield Doubt("energy", f"the battery of {sailed.battery_wh:g} Wh was empty after {sailed.km:.1f} km")
    if outcome.configuration.budget.is_limited and not sailed.is_home:
        yield Doubt("home", f"the boat was not home after {sailed.hours:.1f} h")
    if outcome.configuration.authority.mode == "observe":
        yield Doubt("service", "authority.mode is observe: sailed as with missions, which it would not send")


def _about_the_budget(outcome: Outcome) -> Iterator[Doubt]:
    budget, sailed = outcome.configuration.budget, outcome.sailed
    for limit in outcome.limits:
        if limit.share > 1.0:
            yield Doubt("budget", f"the reserve was spent: {limit}")
    if not budget.is_limited:
        yield Doubt(
            "budget",
            f"no budget is set: the boat sails until somebody ends it; here after {sailed.hours:.1f} h",
        )
    if sailed.energy_wh is None:
        yield Doubt(
            "energy", "what a metre costs is not known: set budget.consumption_j_per_m, even as a guess"
        )
    fastest_mps = _fastest_current_mps(outcome)
    if fastest_mps >= 0.5 * budget.speed_mps:
        yield Doubt(
            "current",
            f"the current runs at up to {fastest_mps:.2g} m/s, the boat at {budget.speed_mps:g} m/s: ways against "
            "it take several times as long",
        )


def _fastest_current_mps(outcome: Outcome) -> float:
    tide = outcome.wishes.tide
    return math.hypot(*outcome.wishes.current_mps) + (0.0 if tide is None else abs(tide.speed_mps))


def _about_the_map(outcome: Outcome) -> Iterator[Doubt]:
    sailed, last = outcome.sailed, outcome.sailed.moments[-1]
    spacing_km = outcome.survey.area_m2 / 1e6 / max(sailed.km, 1e-3)
    if last.rmse > WORST_MAP * sailed.field_std:
        length = (
            "" if sailed.patch_m is None else f", and the field's length is {sailed.patch_m / 1e3:.2g} km"
        )
        needed_km = outcome.survey.area_m2 / 1e3 / (sailed.patch_m or 1e3 * spacing_km / 2.0)
        yield Doubt(
            "budget",
            f"{sailed.km:.1f} km are too few for {outcome.survey.area_m2 / 1e6:.3g} km² of water: tracks lie "
            f"{spacing_km:.2g} km apart{length}; {needed_km:.0f} km or a smaller area would make a map",
        )
    if not sailed.reestimates:
        yield Doubt(
            "map",
            f"{last.samples} readings were learnt and the model never re-estimated, so the map is that of a first "
            "guess: sail farther, or learn more readings (sampling.spacing_m)",
        )
    if last.rmse > TOO_SURE * last.expected:
        yield Doubt(
            "map",
            f"the map is {last.rmse / last.expected:.1f} times as wrong as the model expects: it is too sure "
            "of itself on a field like this one",
        )
    spacing_m = outcome.configuration.sampling.spacing_m
    if sailed.patch_m is not None and spacing_m > sailed.patch_m / _COARSE:
        yield Doubt(
            "readings",
            f"sampling.spacing_m: {spacing_m:g} is coarse for a field whose length is {sailed.patch_m:.0f} m",
        )
    yield from _about_readings(outcome)


def _about_readings(outcome: Outcome) -> Iterator[Doubt]:
    counts = outcome.sailed.health[-1].quality.get("aggregate", ()) if outcome.sailed.health else ()
    refused = sum(counts[2:4])
    if sum(counts) and refused > _MANY_REFUSED * sum(counts):
        yield Doubt(
            "readings",
            f"quality control holds {refused / sum(counts):.0%} of good readings for suspect or failed: "
            "look at sensor.minimum, sensor.maximum and the section quality",
        )


def _about_the_survey(outcome: Outcome) -> Iterator[Doubt]:
    nx, ny = outcome.configuration.planning.lattice
    sites = len(outcome.survey.candidate_sites(nx, ny))
    if sites < FEWEST_SITES * nx * ny:
        yield Doubt(
            "lattice",
            f"{nx * ny - sites} of the {nx} × {ny} sites of planning.lattice lie on land or too near to it: "
            "a finer lattice, or an area drawn along the shore, has more of them over water",
        )
    truth = outcome.sailed.truth
    missing = 1.0 - np.isfinite(truth.truth(0.0)).sum() / max(1, truth.is_water.sum())
    if missing > 0.0:
        yield Doubt(
            "field", f"the field knows nothing of {missing:.0%} of the survey's water, or calls it land"
        )
    parts = shapely.get_num_geometries(outcome.survey.navigable)
    if parts > 1:
        yield Doubt("land", f"the water that may be sailed is in {parts} parts that do not touch")
