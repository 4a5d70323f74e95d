"""The survey area: where the sea is, where the vessel may go, and where it may sample."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, pi, radians
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry import Polygon
from shapely.geometry.base import BaseGeometry

from autonomy.config import SurveySection
from autonomy.geometry import FloatArray, LocalFrame
from autonomy.planning.depth import shallow_water
from autonomy.planning.errors import SurveyError
from autonomy.planning.pinches import pinches
from autonomy.planning.polygon_files import Role, read_polygons

__all__ = ["SurveyArea", "SurveyError", "read_survey"]

Box = tuple[float, float, float, float]
"""x minimum, y minimum, x maximum, y maximum."""

ROUND_OFF_M = 1e-3
"""Distance by which a leg may leave navigable water before it counts as leaving it.

Points that lie on an edge by construction end up micrometres on either side of it; no chart is good to a
millimetre.
"""

_EDGE_DEG = 0.02
"""Edges are straight in longitude and latitude; in pieces this long they bend by less than 0.1 m."""

_WIDEST_DEG = 20.0
"""A wider area is a mistake: flat metres do not reach that far."""

_ARC_SEGMENTS = 8
"""Straight pieces per quarter circle of the stand-off around a corner."""


@dataclass(frozen=True, eq=False)
class SurveyArea:
    """One survey in local metres. Make it with `SurveyArea.from_geometry` or `read_survey`.

    Attributes:
        frame: local metres to and from degrees.
        ground: the area within keep-in, land and all; its bounds are the map's.
        obstacles: land and keep-out, without stand-off.
        water: ground without obstacles: where readings belong to the survey.
        navigable: water at least `standoff_m` from every obstacle: where the vessel is sent. It may have
            several parts that are not connected.
        standoff_m: distance kept from land and keep-out; the area's own edge needs none.
        passage_cells: cells along the longer side of the raster on which ways over water are found.
        land: what makes up the obstacles, for charts; None if nothing was said.
        keep_out: the same.
        keep_in: what narrows the ground, for charts; None if nothing was said.
    """

    frame: LocalFrame
    ground: BaseGeometry
    obstacles: BaseGeometry
    water: BaseGeometry
    navigable: BaseGeometry
    standoff_m: float
    passage_cells: int
    land: BaseGeometry | None = None
    keep_out: BaseGeometry | None = None
    keep_in: BaseGeometry | None = None

    @classmethod
    def from_geometry(
        cls,
        frame: LocalFrame,
        area: BaseGeometry,
        land: BaseGeometry | None = None,
        keep_in: BaseGeometry | None = None,
        keep_out: BaseGeometry | None = None,
        standoff_m: float = 0.0,
        passage_cells: int = 200,
    ) -> "SurveyArea":
        """A survey from polygons in local metres of `frame`.

        Raises:
            SurveyError: a geometry is empty, invalid or no polygon, or no navigable water is left.
        """
        if not standoff_m >= 0.0:
            raise SurveyError(f"the stand-off must be zero or more metres, not {standoff_m}")
        _require_polygon("the survey area", area)
        ground = area
        if keep_in is not None:
            _require_polygon("keep-in", keep_in)
            ground = polygonal(area.intersection(keep_in))
            if ground.is_empty:
                raise SurveyError(
                    "keep-in and the survey area do not overlap; is the longitude first in both?"
                )
        closed = [
            (name, shape) for name, shape in (("land", land), ("keep-out", keep_out)) if shape is not None
        ]
        for name, shape in closed:
            _require_polygon(name, shape, may_be_empty=True)
        obstacles = shapely.union_all([shape for _, shape in closed]) if closed else Polygon()
        water = polygonal(ground.difference(obstacles))
        if water.is_empty:
            raise SurveyError("no water is left: land, shallows and keep-out cover the whole survey area")
        navigable = polygonal(water.difference(_grown(obstacles, standoff_m)))
        if navigable.is_empty:
            raise SurveyError(
                f"no navigable water is left {standoff_m:g} m away from land and keep-out; "
                "a smaller stand-off or a larger area is needed"
            )
        return cls(
            frame, ground, obstacles, water, navigable, standoff_m, passage_cells, land, keep_out, keep_in
        )

    def closed_off(self, closed: BaseGeometry, given_up: BaseGeometry, margin_m: float) -> "SurveyArea":
        """The same survey with less water to sail on; maps and readings keep all of it.

        Args:
            closed: where the vessel must not be, kept clear of by `margin_m`, also on the way into the area.
            given_up: where it shall not be sent; it may get out of there.
            margin_m: distance kept from `closed`.

        Raises:
            SurveyError: no navigable water is left.
        """
        # Degenerate regions are points and lines, and overlays of mixed collections fail.
        navigable = self.navigable.difference(polygonal(_grown(closed, margin_m)))
        navigable = polygonal(navigable.difference(polygonal(given_up)))
        if navigable.is_empty:
            raise SurveyError(f"no navigable water is left {margin_m:g} m inside the fence")
        return replace(
            self, navigable=navigable, obstacles=polygonal(self.obstacles.union(polygonal(closed)))
        )

    @cached_property
    def bounds(self) -> Box:
        """(x min, y min, x max, y max) of the ground, in metres: the extent of maps and lattices."""
        x_min, y_min, x_max, y_max = self.ground.bounds
        return float(x_min), float(y_min), float(x_max), float(y_max)

    @property
    def span_m(self) -> float:
        """The longer side of the bounds."""
        x_min, y_min, x_max, y_max = self.bounds
        return max(x_max - x_min, y_max - y_min)

    @cached_property
    def area_m2(self) -> float:
        """Area of the water, the stand-off included."""
        return float(self.water.area)

    def contains(self, x: float, y: float) -> bool:
        """Whether a point lies in the survey's water (the stand-off belongs to it: readings there count)."""
        shapely.prepare(self.water)
        return bool(shapely.intersects_xy(self.water, x, y))

    def is_navigable(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Which points, shape (n, 2), lie where the vessel may be sent, to within `ROUND_OFF_M`; shape (n,)."""
        points = np.asarray(points_m, dtype=float).reshape(-1, 2)
        shapely.prepare(self._tolerant)
        inside: NDArray[np.bool_] = shapely.intersects_xy(self._tolerant, points[:, 0], points[:, 1])
        return inside

    def leg_is_clear(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Whether the straight leg from a to b stays in navigable water, to within `ROUND_OFF_M`."""
        return bool(self.legs_are_clear(a, b)[0])

    def legs_are_clear(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.bool_]:
        """`leg_is_clear` for many legs: starts and ends (n, 2), or one of them (2,); shape (n,)."""
        pairs = _legs(starts, ends)
        shapely.prepare(self._tolerant)
        still = np.all(pairs[:, 0] == pairs[:, 1], axis=1)
        clear: NDArray[np.bool_] = np.empty(len(pairs), dtype=bool)
        clear[still] = shapely.covers(self._tolerant, shapely.points(pairs[still, 0]))
        clear[~still] = shapely.covers(self._tolerant, shapely.linestrings(pairs[~still]))
        return clear

    @cached_property
    def _tolerant(self) -> BaseGeometry:
        grown = self.navigable.buffer(ROUND_OFF_M, join_style="mitre")
        # Round-off must not open what is closed: where two rocks touch, water grown on either side would meet.
        points = shapely.multipoints(pinches(self.navigable, 2 * ROUND_OFF_M))
        return grown if points.is_empty else grown.difference(points.buffer(10 * ROUND_OFF_M))

    def approach_is_clear(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Whether a vessel at `a`, outside navigable water, may sail straight into it at `b`.

        Such a vessel lies in the stand-off or beyond the area's edge. Its way in must be free of land and
        keep-out themselves; the stand-off cannot be asked of it.
        """
        return bool(self.approaches_are_clear(a, b)[0])

    def approaches_are_clear(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.bool_]:
        """`approach_is_clear` for many legs: starts and ends (n, 2), or one of them (2,); shape (n,)."""
        pairs = _legs(starts, ends)
        shapely.prepare(self.obstacles)
        free = ~shapely.intersects(self.obstacles, shapely.linestrings(pairs))
        inside: NDArray[np.bool_] = free & self.is_navigable(pairs[:, 1])
        return inside

    def candidate_sites(self, nx: int, ny: int) -> FloatArray:
        """Centres of an nx × ny lattice over the bounds that lie in navigable water.

        Ponds smaller than four cells of the passage raster hold no site: nothing could be reached in them.

        Returns:
            Array of shape (N, 2), west to east within south to north; N may be 0.
        """
        x_min, y_min, x_max, y_max = self.bounds
        x = x_min + (np.arange(nx) + 0.5) * ((x_max - x_min) / nx)
        y = y_min + (np.arange(ny) + 0.5) * ((y_max - y_min) / ny)
        sites = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        smallest_m2 = 4.0 * (self.span_m / self.passage_cells) ** 2
        parts = shapely.get_parts(self.navigable)
        basins = shapely.multipolygons(parts[shapely.area(parts) >= smallest_m2])
        shapely.prepare(basins)
        inside: FloatArray = sites[shapely.contains_xy(basins, sites[:, 0], sites[:, 1])]
        return inside


def read_survey(section: SurveySection) -> SurveyArea:
    """The survey of a configuration: its area, the files of keep-in, keep-out and land, and its depths.

    Water shallower than `survey.minimum_depth_m` counts as land.

    The frame's origin is the middle of the area's bounds.

    Raises:
        SurveyError: a file is missing or wrong, or no navigable water is left.
    """
    area = (
        read_polygons(section.area, "area") if isinstance(section.area, Path) else _from_corners(section.area)
    )
    west, south, east, north = area.bounds
    if east - west > _WIDEST_DEG:
        raise SurveyError(
            f"the survey area spans {east - west:.0f} degrees of longitude, more than {_WIDEST_DEG:g}; "
            "across the date line write longitudes of 0 to 360 degrees"
        )
    frame = LocalFrame((south + north) / 2, (west + east) / 2)
    window = _window(area.bounds, section.standoff_m)
    land = _closed(frame, section.land, "land", area, window)
    if section.depth is not None:
        shallow = shallow_water(
            section.depth, area.bounds, window, section.minimum_depth_m, section.depth_positive
        )
        shallow = _local(frame, shallow, window)
        land = shallow if land is None else shapely.union(land, shallow)
    keep_in = section.keep_in and _local(frame, read_polygons(section.keep_in, "keep_in"), window)
    return SurveyArea.from_geometry(
        frame,
        _local(frame, area, window),
        land=land,
        keep_in=keep_in,
        keep_out=_closed(frame, section.keep_out, "keep_out", area, window),
        standoff_m=section.standoff_m,
        passage_cells=section.passage_cells,
    )


def _from_corners(corners: Sequence[tuple[float, float]]) -> Polygon:
    return Polygon([(lon, lat) for lat, lon in corners])


def _window(
    bounds: tuple[float, float, float, float], standoff_m: float
) -> tuple[float, float, float, float]:
    """What is read of the world's coasts: the area's surroundings, for the stand-off and the way in."""
    west, south, east, north = bounds
    metres_per_degree = 111e3 * max(0.05, cos(radians(max(abs(south), abs(north)))))
    margin = max(east - west, north - south) / 2 + 2 * standoff_m / metres_per_degree + _EDGE_DEG
    return west - margin, max(-90.0, south - margin), east + margin, min(90.0, north + margin)


def _closed(
    frame: LocalFrame, path: Path | None, role: Role, area: BaseGeometry, window: Box
) -> BaseGeometry | None:
    """Land or keep-out in local metres, near the area."""
    if path is None:
        return None
    shape = read_polygons(path, role)
    if not shape.intersects(shapely.box(*window)):
        swapped = shapely.transform(shape, lambda positions: positions[:, ::-1])
        if swapped.intersects(area):
            raise SurveyError(
                f"{path}: lies on the survey area only if its coordinates are read as latitude, longitude; "
                "GeoJSON and KML have the longitude first, a plan the latitude"
            )
    return _local(frame, shape, window)


def _local(frame: LocalFrame, degrees: BaseGeometry, window: Box) -> BaseGeometry:
    """A polygon in degrees as one in local metres, cut to the window."""
    cut = polygonal(degrees.intersection(shapely.box(*window)))
    dense = shapely.segmentize(cut, _EDGE_DEG)
    metres = shapely.transform(dense, lambda positions: frame.to_local(positions[:, 1], positions[:, 0]))
    # Projecting a valid polygon moves its vertices by round-off, which can make touching rings cross.
    return metres if metres.is_valid else polygonal(shapely.make_valid(metres))


def _require_polygon(name: str, shape: BaseGeometry, *, may_be_empty: bool = False) -> None:
    if shape.geom_type not in ("Polygon", "MultiPolygon"):
        raise SurveyError(f"{name} must be a polygon or a multipolygon, not a {shape.geom_type}")
    if not shape.is_valid:
        raise SurveyError(f"{name} is not a valid polygon: {shapely.is_valid_reason(shape)} (local metres)")
    if not may_be_empty and shape.area == 0.0:
        raise SurveyError(f"{name} is empty")


def polygonal(shape: BaseGeometry) -> BaseGeometry:
    """The polygons of the result of an overlay: where edges merely touch, it holds lines and points too."""
    if shape.geom_type in ("Polygon", "MultiPolygon"):
        return shape
    parts = shapely.get_parts(shape)
    polygons = [part for part in parts if part.geom_type in ("Polygon", "MultiPolygon")]
    return shapely.union_all(polygons) if polygons else Polygon()


def _grown(shape: BaseGeometry, distance_m: float) -> BaseGeometry:
    """A shape and everything nearer to it than the distance."""
    if distance_m == 0.0 or shape.is_empty:
        return shape
    # The arcs' straight pieces cut inside the circle: make them touch it from outside.
    return shape.buffer(distance_m / cos(pi / (4 * _ARC_SEGMENTS)), quad_segs=_ARC_SEGMENTS)


def _legs(starts: ArrayLike, ends: ArrayLike) -> FloatArray:
    """Legs of shape (n, 2, 2)."""
    a, b = np.broadcast_arrays(
        np.asarray(starts, dtype=float).reshape(-1, 2), np.asarray(ends, dtype=float).reshape(-1, 2)
    )
    return np.stack([a, b], axis=1)
