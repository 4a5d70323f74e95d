"""The regular grid of latitudes and longitudes that maps are exported on, and which of its cells are water."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from autonomy.export.values import ExportError, Subject
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.wire import SurveyNotice

USUAL_CELLS = 200
"""Along the longer side, if no resolution is asked for."""

MOST_CELLS = 4_000_000
_EDGE_POINTS = 50
_SAME_SHARE = 0.02
"""Of its longer side: by how much a survey's bounds differ from those of its outline as it was told, at most."""


@dataclass(frozen=True, eq=False)
class MapGrid:
    """Cell centres on regular axes: `lat_deg` (rows,) from south to north, `lon_deg` (columns,) from west to east.

    `water` (rows, columns) says which cells belong to the survey's water, `points_m` (n, 2) is where these are.
    Longitudes go on past 180 where the survey lies across it. `masked` is False if nobody said where the land is.
    """

    lat_deg: FloatArray
    lon_deg: FloatArray
    water: NDArray[np.bool_]
    points_m: FloatArray
    resolution_m: float
    masked: bool

    def spread(self, values: FloatArray) -> "np.ma.MaskedArray[tuple[int, int], np.dtype[np.float64]]":
        """Values (n,) of the cells that are water as a map (rows, columns), the others masked."""
        filled = np.zeros(self.water.shape)
        filled[self.water] = values
        return np.ma.MaskedArray(filled, ~self.water)


def map_grid(subject: Subject, water: BaseGeometry | None, resolution_m: float | None) -> MapGrid:
    """The grid over a survey.

    Args:
        subject: where the survey is.
        water: the survey's water in local metres; None if that is not known.
        resolution_m: side of a cell; None: the longer side of the survey in `USUAL_CELLS` of them.

    Raises:
        ExportError: that would be too many cells, or none of them is water.
    """
    x_min, y_min, x_max, y_max = subject.bounds_m
    resolution_m = resolution_m or max(x_max - x_min, y_max - y_min) / USUAL_CELLS
    south, north, west, east = _outline(subject)
    # One degree here, in metres; of latitude and of longitude along the middle.
    middle_lat, middle_lon = (south + north) / 2.0, (west + east) / 2.0
    step = 1e-3
    corner, up, right = subject.frame.to_local(
        [middle_lat, middle_lat + step, middle_lat], [middle_lon, middle_lon, middle_lon + step]
    )
    lat = _axis(south, north, resolution_m * step / math.dist(corner, up))
    lon = _axis(west, east, resolution_m * step / math.dist(corner, right))
    if len(lat) * len(lon) > MOST_CELLS:
        raise ExportError(
            f"{resolution_m:g} m make {len(lat)} × {len(lon)} cells; at most {MOST_CELLS} are exported: "
            "--resolution wants more metres"
        )
    columns, rows = np.meshgrid(lon, lat)
    places = subject.frame.to_local(rows, columns)
    inside = _inside(water if water is not None else shapely.box(*subject.bounds_m), places)
    if not inside.any():
        raise ExportError(f"no cell of {resolution_m:g} m is water: --resolution wants fewer metres")
    return MapGrid(lat, lon, inside, places[inside], resolution_m, water is not None)


def told_water(notices: Sequence[SurveyNotice], subject: Subject) -> BaseGeometry | None:
    """A survey's water as it was told ashore, in local metres of its frame; None if that was not told.

    Of several notices the last counts that is of this survey: of its variable, and with its bounds.
    """
    x_min, y_min, x_max, y_max = subject.bounds_m
    slack_m = _SAME_SHARE * max(x_max - x_min, y_max - y_min)
    for notice in reversed(notices):
        area, land, keep_out = (
            _shape(rings, subject.frame) for rings in (notice.area, notice.land, notice.keep_out)
        )
        if notice.variable != subject.variable or area.is_empty:
            continue
        if np.abs(np.subtract(area.bounds, subject.bounds_m)).max() <= slack_m:
            return shapely.difference(area, shapely.union(land, keep_out))
    return None


def local_water(water: BaseGeometry | None, x_axis: FloatArray, y_axis: FloatArray) -> NDArray[np.bool_]:
    """Which cells (rows, columns) of a grid of local metres are water; all, if that is not known."""
    columns, rows = np.meshgrid(x_axis, y_axis)
    if water is None:
        return np.ones(rows.shape, dtype=bool)
    return _inside(water, np.stack([columns, rows], axis=-1))


def _shape(rings: tuple[tuple[tuple[float, float], ...], ...], frame: LocalFrame) -> BaseGeometry:
    """What lies in an odd number of rings."""
    shapes = [
        shapely.make_valid(shapely.Polygon(frame.to_local(*np.transpose(ring))))
        for ring in rings
        if len(ring) >= 3
    ]
    return reduce(shapely.symmetric_difference, shapes, shapely.Polygon())


def _outline(subject: Subject) -> tuple[float, float, float, float]:
    """South, north, west, east of the bounds, whose edges bend."""
    x_min, y_min, x_max, y_max = subject.bounds_m
    x, y = np.linspace(x_min, x_max, _EDGE_POINTS), np.linspace(y_min, y_max, _EDGE_POINTS)
    edges = [(x, np.full_like(x, y_min)), (x, np.full_like(x, y_max))]
    edges += [(np.full_like(y, x_min), y), (np.full_like(y, x_max), y)]
    lat, lon = np.transpose(subject.frame.to_geodetic(np.hstack(edges).T))
    # Continuous across the antimeridian.
    origin = subject.frame.origin_lon_deg
    lon = origin + (lon - origin + 180.0) % 360.0 - 180.0
    return float(lat.min()), float(lat.max()), float(lon.min()), float(lon.max())


def _axis(start: float, end: float, step: float) -> FloatArray:
    """Middles of cells of about `step` that together reach from `start` to `end`."""
    count = max(2, math.ceil((end - start) / step - 1e-9))
    middles = start + (np.arange(count, dtype=float) + 0.5) * ((end - start) / count)
    return np.asarray(middles, dtype=float)


def _inside(shape: BaseGeometry, places: FloatArray) -> NDArray[np.bool_]:
    shapely.prepare(shape)
    inside: NDArray[np.bool_] = shapely.intersects_xy(shape, places[..., 0], places[..., 1])
    return inside
