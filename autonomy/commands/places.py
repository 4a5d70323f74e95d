"""Places as people type them on a command line, and where a boat begins if they do not."""

import argparse

import numpy as np

from autonomy.config import Configuration
from autonomy.geometry import FloatArray
from autonomy.planning.survey import SurveyArea


def place(text: str) -> tuple[float, float]:
    """Latitude and longitude in degrees; raises ArgumentTypeError."""
    try:
        lat_deg, lon_deg = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be LATITUDE,LONGITUDE in degrees (got {text!r})") from None
    if not (-90.0 <= lat_deg <= 90.0 and -180.0 <= lon_deg <= 360.0):
        raise argparse.ArgumentTypeError(f"no such place: latitude {lat_deg:g}, longitude {lon_deg:g}")
    return lat_deg, lon_deg


def launch_m(
    configuration: Configuration, survey: SurveyArea, given: tuple[float, float] | None
) -> FloatArray:
    """Where a vessel begins, shape (2,), local metres: where it is told, at home, or in the south-west of the water."""
    told = configuration.budget.home if given is None else given
    if told is not None:
        return survey.frame.to_local(*told)
    sites = survey.candidate_sites(50, 50)
    if not len(sites):
        sites = np.array([survey.navigable.representative_point().coords[0]])
    nearest: FloatArray = sites[int(np.argmin(np.hypot(*(sites - survey.bounds[:2]).T)))]
    return nearest
