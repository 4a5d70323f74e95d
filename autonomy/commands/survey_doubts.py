"""What a survey that was drawn comes to, and what about it is seldom meant."""

import numpy as np
import shapely
from shapely.geometry import Point
from shapely.geometry.base import BaseGeometry

from autonomy.commands.sketch import Sketch
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea

_SMALL_KM2 = 0.001
_LARGE_KM2 = 100_000.0
_STAIRS_SHARE = 0.95
"""Share of a shore's length that runs exactly along meridians and parallels: no shore does, cells of a mask do."""

_FEWEST_STAIRS = 12
_KEPT_SHARE = 0.99
_SAME_DEG = 1e-9


def told_of(drawn: Sketch, survey: SurveyArea) -> list[str]:
    """Its size and extent, and which drawing it is made of."""
    west, south, east, north = drawn.shape("area").bounds
    x_min, y_min, x_max, y_max = survey.bounds
    lines = [
        f"area     {survey.ground.area / 1e6:.4g} km², {(x_max - x_min) / 1e3:.3g} km from west to east, "
        f"{(y_max - y_min) / 1e3:.3g} km from south to north",
        f"extent   latitude {south:.5f} to {north:.5f}, longitude {west:.5f} to {east:.5f}",
        f"water    {survey.area_m2 / 1e6:.4g} km², of which {survey.navigable.area / 1e6:.4g} km² may be sailed with "
        f"survey.standoff_m: {survey.standoff_m:g}",
    ]
    for part in drawn.parts:
        name = next(filter(None, part.names), "")
        called = f' "{name}"' if name and name not in part.where else ""
        size_m2 = _metres(part.shape, survey.frame).area
        lines.append(f"{part.role:9}{size_m2 / 1e6:.4g} km² from {part.where}{called}")
    return lines


def doubts_of(drawn: Sketch, survey: SurveyArea, start: tuple[float, float] | None) -> list[str]:
    """Warnings, in words; `start` is latitude and longitude of the launch, if it is known."""
    found = list(drawn.notes)
    km2 = survey.ground.area / 1e6
    if not _SMALL_KM2 <= km2 <= _LARGE_KM2:
        found.append(f"a survey area of {km2:.3g} km² is unusual: are the coordinates right?")
    kept = survey.ground.area / _metres(drawn.shape("area"), survey.frame).area
    if kept < _KEPT_SHARE:
        found.append(f"keep-in leaves {kept:.0%} of the area: is the fence the one that is meant?")
    found += _about_land(drawn, survey)
    parts = shapely.get_num_geometries(survey.navigable)
    if parts > 1:
        found.append(
            f"the water that may be sailed is in {parts} parts that do not touch: one of them is surveyed"
        )
    return found + ([] if start is None else _about_start(survey, start))


def stair_m(land: BaseGeometry, frame: LocalFrame) -> float | None:
    """Size of the cells that polygons of land were made of, in metres; None if they look drawn.

    Args:
        land: in degrees.
        frame: near it.
    """
    rings = [ring for part in shapely.get_parts(land) for ring in shapely.get_rings(part)]
    ends = [shapely.get_coordinates(ring) for ring in rings]
    if sum(len(each) - 1 for each in ends) < _FEWEST_STAIRS:
        return None
    steps_deg = np.concatenate([np.abs(np.diff(each, axis=0)) for each in ends])
    metres = [frame.to_local(each[:, 1], each[:, 0]) for each in ends]
    lengths_m = np.concatenate([np.hypot(*np.diff(each, axis=0).T) for each in metres])
    along = steps_deg.min(axis=1) < _SAME_DEG
    if lengths_m[along].sum() < _STAIRS_SHARE * lengths_m.sum():
        return None
    return float(np.quantile(lengths_m[along], 0.1))


def _about_land(drawn: Sketch, survey: SurveyArea) -> list[str]:
    if "land" not in drawn.roles:
        return ["no land is drawn: all of the area counts as water"]
    land = drawn.shape("land")
    near = land.intersection(drawn.shape("area").buffer(0.1))
    if not _metres(land, survey.frame).intersects(survey.ground):
        return ["the land does not touch the area: all of it counts as water"]
    cell_m = stair_m(near, survey.frame)
    if cell_m is None or cell_m <= survey.standoff_m:
        return []
    return [
        f"the land is made of cells of about {cell_m:.0f} m, so the shore may be off by as much, and islands be "
        f"missing: set survey.standoff_m to {1.5 * cell_m:.0f} or more ({survey.standoff_m:g} now), "
        "or take the shore from a chart"
    ]


def _about_start(survey: SurveyArea, start: tuple[float, float]) -> list[str]:
    here = survey.frame.to_local(*start)
    if survey.is_navigable(here)[0]:
        return []
    point = Point(here)
    away_m = point.distance(survey.navigable)
    if point.intersects(survey.obstacles):
        where = "on land or in keep-out"
    elif survey.contains(*map(float, here)):
        where = "nearer to land or keep-out than survey.standoff_m"
    else:
        where = "outside the survey area"
    return [f"the start lies {where}, {away_m:.0f} m from the water that may be sailed"]


def _metres(shape: BaseGeometry, frame: LocalFrame) -> BaseGeometry:
    return shapely.transform(shape, lambda degrees: frame.to_local(degrees[:, 1], degrees[:, 0]))
