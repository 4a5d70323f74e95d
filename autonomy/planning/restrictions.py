"""What narrows a survey's water while it is under way: the autopilot's fence, and water given up after a stall."""

from dataclasses import dataclass
from functools import lru_cache

import shapely
from shapely.geometry import Point, Polygon
from shapely.geometry.base import BaseGeometry

from autonomy.planning.survey import SurveyArea, polygonal

_HORIZON_M = 300e3
"""Outside an inclusion everything is closed, as far as any survey's way in can be."""

_ARC_SEGMENTS = 16


@dataclass(frozen=True)
class Region:
    """A polygon, or a disc about a point, in local metres.

    Attributes:
        corners_m: x, y of the polygon's corners, or of the disc's centre alone.
        radius_m: the disc's; None for a polygon.
    """

    corners_m: tuple[tuple[float, float], ...]
    radius_m: float | None = None

    @property
    def shape(self) -> BaseGeometry:
        """As a geometry; the arcs' straight pieces lie within the circle."""
        if self.radius_m is not None:
            return Point(self.corners_m[0]).buffer(self.radius_m, quad_segs=_ARC_SEGMENTS)
        polygon = Polygon(self.corners_m)
        return polygon if polygon.is_valid else shapely.make_valid(polygon)


@dataclass(frozen=True)
class Restrictions:
    """What narrows the water; equal ones are one.

    Attributes:
        inside: the vessel stays in one region of each of these groups.
        outside: and out of all of these.
        margin_m: distance kept from both.
        given_up: the vessel is not sent there.
    """

    inside: tuple[tuple[Region, ...], ...] = ()
    outside: tuple[Region, ...] = ()
    margin_m: float = 0.0
    given_up: tuple[Region, ...] = ()


UNRESTRICTED = Restrictions()


@lru_cache(maxsize=4)
def restricted(survey: SurveyArea, restrictions: Restrictions) -> SurveyArea:
    """The survey with what the restrictions leave of its water; the same object for the same restrictions.

    Raises:
        SurveyError: no navigable water is left.
    """
    if not (restrictions.inside or restrictions.outside or restrictions.given_up):
        return survey
    horizon = shapely.box(-_HORIZON_M, -_HORIZON_M, _HORIZON_M, _HORIZON_M)
    closed = [horizon.difference(polygonal(_union(group))) for group in restrictions.inside]
    closed += [region.shape for region in restrictions.outside]
    return survey.closed_off(
        shapely.union_all(closed) if closed else Polygon(),
        _union(restrictions.given_up),
        restrictions.margin_m,
    )


def _union(regions: tuple[Region, ...]) -> BaseGeometry:
    return shapely.union_all([region.shape for region in regions]) if regions else Polygon()
