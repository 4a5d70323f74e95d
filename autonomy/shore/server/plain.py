"""What goes to the page, as plain lists and maps: the shapes of docs/page.md."""

import json
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from autonomy.learning.calibration import CalibrationFigures
from autonomy.learning.snapshot_parts import component_map
from autonomy.shore.server.maps import bounds_deg, frame_of
from autonomy.wire import HealthNotice, ModelSnapshot, ObservationNotice, PlanNotice, SurveyNotice

Plain = dict[str, Any]


def dumps(value: Any) -> str:
    """JSON, which has neither NaN nor infinity: they become null."""
    try:
        return json.dumps(value, allow_nan=False, separators=(",", ":"))
    except ValueError:
        return json.dumps(known(value), allow_nan=False, separators=(",", ":"))


def known(value: Any) -> Any:
    """The same value with None for every number that is not finite."""
    match value:
        case float():
            return value if math.isfinite(value) else None
        case dict():
            return {name: known(each) for name, each in value.items()}
        case list() | tuple():
            return [known(each) for each in value]
        case _:
            return value


def model(value: ModelSnapshot, stamp_s: float) -> Plain:
    """What a snapshot says of the field and of itself; `stamp_s` is the slider's stop that it belongs to."""
    kernel = value.kernel
    return {
        "sequence": value.sequence,
        "utc_s": value.utc_s,
        "stamp_s": stamp_s,
        "model_time_s": value.model_time_s,
        "samples": value.samples,
        "rho": value.rho,
        "kernel": [component_map(component) for component in kernel.components],
        "noise_sd": math.sqrt(kernel.noise_variance),
        "transform": value.model.transform.name,
        "basis": np.round(frame_of(value).to_geodetic(value.model.basis), 7).tolist(),
        "calibration": figures(value.calibration),
        "ahead": figures(value.ahead),
        "replans": value.replans,
        "survey": value.survey,
        "capacity": value.capacity,
        "rho0": value.rho0,
        "configuration_hash": value.configuration_hash,
        "precision": value.precision,
        "stated_error": value.stated_error,
        "software_version": value.software_version,
        "variable": value.variable,
        "units": value.units,
    }


def figures(value: CalibrationFigures) -> Plain:
    """How readings agreed with what had been said of them."""
    return asdict(value)


def plan(value: PlanNotice, stamp_s: float) -> Plain:
    """A plan, and when it was made or, if it doesn't say so, came."""
    return {**asdict(value), "utc_s": stamp_s}


def health(value: HealthNotice, stamp_s: float) -> Plain:
    """A health notice, and when it came."""
    return {**asdict(value), "utc_s": stamp_s}


def observations(values: Iterable[ObservationNotice]) -> list[list[float]]:
    """Rows of the vehicle's time, latitude, longitude, value, flag."""
    return [[one.model_time_s, one.lat_deg, one.lon_deg, one.value, one.flag] for one in values]


def survey(value: SurveyNotice) -> Plain:
    """What is surveyed, and where."""
    south, west, north, east = value.bounds_deg
    return {**asdict(value), "bounds": {"south": south, "west": west, "north": north, "east": east}}


def survey_of_model(value: ModelSnapshot) -> Plain:
    """The same, as far as a model knows it."""
    return {
        "name": value.survey,
        "variable": value.variable,
        "long_name": value.variable.replace("_", " "),
        "units": value.units,
        "rho0": value.rho0,
        "capacity": value.capacity,
        **dict.fromkeys(("area", "land", "keep_in", "keep_out", "fence"), ()),
        "bounds": bounds(value),
    }


def bounds(value: ModelSnapshot) -> Plain:
    """The smallest rectangle of degrees around a model's rectangle of local metres."""
    return dict(zip(("south", "west", "north", "east"), bounds_deg(value), strict=True))
