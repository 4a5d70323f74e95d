"""What a demo needs before anything sails: the sea, its land as files, a configuration, and a place to start."""

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
import yaml

from autonomy.config import Configuration, load
from autonomy.planning.passage import passage_of
from autonomy.planning.survey import SurveyArea, SurveyError, read_survey
from sim.field import Field, FieldError, FieldInfo, open_field, shrunk
from sim.land import feature_collection, land_polygons, water_outline
from sim.truth_map import TruthMap

LARGEST_SIDE_M = 15_000.0
SAMPLES_PER_SIDE = 50
"""Readings are learnt no closer than the square root of the water's area divided by this."""

READINGS_PER_SAMPLE = 6
"""The probe reads this much more often than the model learns, so that the spacing is kept and not doubled."""

BUDGET_SIDES = 16.0
"""How far the vessel sails, in square roots of the water's area."""

NOISE_SHARE = 0.05
"""Standard deviation of the probe's noise, as a share of the field's."""

MAP_CELLS = 130
LARGEST_SPEED_MPS = 100.0
"""The simulated vessel goes no faster."""


@dataclass(frozen=True, eq=False)
class Scene(TruthMap):
    """A sea to be surveyed, and the map on which the belief is judged.

    Attributes:
        spacing_m: least distance of two samples.
        speed_mps: of the vessel.
        noise: standard deviation of a reading.
        start_deg: latitude, longitude where the vessel lies at first.
    """

    spacing_m: float
    speed_mps: float
    noise: float
    start_deg: tuple[float, float]


def open_sea(spec: str, variable: str | None) -> Field:
    """The demo's field, drawn together to 15 km if it is larger.

    Raises:
        FieldError: it can't be opened.
    """
    return shrunk(open_field(spec, variable), LARGEST_SIDE_M)


def write_files(field: Field, folder: Path, ports: dict[str, int]) -> tuple[Path, Configuration, SurveyArea]:
    """Write land, area and configuration into `folder`; returns the configuration's file, and what it says.

    Raises:
        FieldError: no survey can be made of this field.
    """
    for name, shape in (("land", land_polygons(field)), ("area", water_outline(field))):
        (folder / f"{name}.geojson").write_text(json.dumps(feature_collection(shape, name)), encoding="utf-8")
    settings = {
        "vehicle": {"name": "demo"},
        "mavlink": {"endpoint": f"udpin:127.0.0.1:{ports['vehicle']}", "acceptance_radius_m": 20.0},
        "sensor": _sensor(field.info),
        "survey": {"area": "area.geojson", "land": "land.geojson", "standoff_m": 100.0},
        # Short paths, so that two minutes hold several; none is cut short by the clock.
        "planning": {"spots": 15},
        "exploration": {"maximum_interval_s": None},
        "shore": {"connect": [f"tcp/127.0.0.1:{ports['shore']}"], "model_period_s": 1.0},
        "journal": {"directory": "journal"},
        # Every demo begins with nothing.
        "checkpoint": {"enabled": False},
    }
    file = folder / "demo.yaml"
    file.write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")
    try:
        survey = read_survey(load(file).survey)
    except SurveyError as error:
        raise FieldError(f"no survey can be made of this field: {error}") from error
    settings["sampling"] = {"spacing_m": math.sqrt(survey.area_m2) / SAMPLES_PER_SIDE}
    file.write_text(yaml.safe_dump(settings, sort_keys=False), encoding="utf-8")
    return file, load(file), survey


def _sensor(info: FieldInfo) -> dict[str, str]:
    """What the vehicle says that it measures. PSU stands for practical salinity, which has the units 1 in CF."""
    if info.units.lower() == "psu":
        return {"variable": "sea_water_practical_salinity", "units": "1"}
    return {"variable": info.variable, "units": info.units or "1"}


def make_scene(field: Field, survey: SurveyArea, spacing_m: float, sailing_s: float) -> Scene:
    """Choose map, start, speed and noise for a demo in which the vessel sails for `sailing_s` of its own time."""
    x_min, y_min, x_max, y_max = survey.bounds
    cell_m = survey.span_m / MAP_CELLS
    scene = Scene(
        field=field,
        survey=survey,
        x_axis_m=np.arange(x_min + cell_m / 2, x_max, cell_m),
        y_axis_m=np.arange(y_min + cell_m / 2, y_max, cell_m),
        spacing_m=spacing_m,
        speed_mps=BUDGET_SIDES * math.sqrt(survey.area_m2) / sailing_s,
        noise=0.0,
        start_deg=_launch(survey),
    )
    if scene.speed_mps > LARGEST_SPEED_MPS:
        raise FieldError(
            f"to sail the {BUDGET_SIDES * math.sqrt(survey.area_m2) / 1000.0:.0f} km that this sea takes in "
            f"{sailing_s:.0f} s of its own time, the vessel would need {scene.speed_mps:.0f} m/s: give it more seconds"
        )
    if not float(np.nanstd(scene.truth(0.0))) > 0.0:
        raise FieldError(f"{field.info.long_name} does not vary over the water: there is nothing to learn")
    return replace(scene, noise=NOISE_SHARE * float(np.nanstd(scene.truth(0.0))))


def _launch(survey: SurveyArea) -> tuple[float, float]:
    """A place near the shore from which most of the water can be reached."""
    passage = passage_of(survey)
    sites = survey.candidate_sites(40, 40)
    reach = np.array([passage.reachable(site, sites).sum() for site in sites[:: max(1, len(sites) // 40)]])
    hub = sites[:: max(1, len(sites) // 40)][int(np.argmax(reach))]
    sites = sites[passage.reachable(hub, sites)]
    shore_m = shapely.distance(survey.obstacles, shapely.points(sites))
    # A little off the shore, as one would after leaving a harbour; in the open sea there is no shore to leave.
    nearest = (
        sites[int(np.argmin(np.abs(shore_m - 3.0 * survey.standoff_m)))]
        if np.isfinite(shore_m).any()
        else hub
    )
    lat_deg, lon_deg = survey.frame.to_geodetic(nearest).tolist()
    return lat_deg, lon_deg
