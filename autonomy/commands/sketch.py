"""From what people draw, in whatever files, to the one file of a survey: what is area, keep-in, keep-out and land.

What a polygon is follows, in this order, from: the person who names the file (ROLE=FILE), the drawing itself (a plan's
fence, a feature's `role`), its name or that of its folder ("Keep out: wreck", a folder "Land"). A file of polygons that
say nothing is the area, if it is the only such file and its polygons do not lie in one another; anything else would be
a guess, and a wrong one puts the boat ashore.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry import MultiPolygon, Polygon, mapping
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient

from autonomy.mavlink.fence import Zone
from autonomy.planning.errors import SurveyError
from autonomy.planning.geojson import ROLES
from autonomy.planning.polygon_files import Role, read_drawn, read_polygons
from autonomy.planning.qgc_plan import plan_drawn
from autonomy.planning.rings import Drawn, shown

_WORDS: dict[str, tuple[str, ...]] = {
    "area": ("area", "survey"),
    "keep_in": ("keep in", "inclusion", "stay in"),
    "keep_out": ("keep out", "exclusion", "no go", "forbidden", "danger"),
    "land": ("land", "island", "islands", "coast", "shore", "rock", "rocks", "reef"),
}
"""How the name of a drawing begins, in small letters, what is no letter or digit left out."""

_SAID = ", ".join(f'"{words[0]}"' for words in _WORDS.values())


@dataclass(frozen=True)
class Sketch:
    """A survey as it was drawn.

    Attributes:
        parts: every drawing with its role.
        notes: what was concluded, for a person.
    """

    parts: tuple[Drawn, ...]
    notes: tuple[str, ...] = ()

    def shape(self, role: str) -> BaseGeometry:
        """What the drawings of a role come to, in degrees: all of them; for keep-in what they have in common."""
        shapes = [each.shape for each in self.parts if each.role == role]
        if role == "keep_in" and shapes:
            return shapely.intersection_all(shapes)
        return shapely.union_all(shapes) if shapes else Polygon()

    @property
    def roles(self) -> tuple[str, ...]:
        """Those that are drawn, in the order of `ROLES`."""
        return tuple(role for role in ROLES if any(each.role == role for each in self.parts))

    def geojson(self) -> dict[str, Any]:
        """As GeoJSON (RFC 7946), one feature for area and keep-in, one for each other drawing."""
        features = [
            _feature(self.shape(role), role, None) for role in ("area", "keep_in") if role in self.roles
        ]
        others = [each for each in self.parts if each.role in ("keep_out", "land")]
        features += [_feature(each.shape, each.role, next(iter(each.names), None)) for each in others]
        return {"type": "FeatureCollection", "features": features}


def sketch(files: Sequence[tuple[Role | None, Path]], fence: Sequence[Drawn] = ()) -> Sketch:
    """What some files and the vehicle's own fence come to.

    Args:
        files: each with its role, or None where the file itself is to say it.
        fence: see `fence_drawn`.

    Raises:
        SurveyError: a file can't be used, its role can't be told, there is no area, or zones have nothing in common.
    """
    parts, silent = list(fence), dict[Path, list[Drawn]]()
    for role, path in files:
        if role is not None:
            parts.append(Drawn(str(path), read_polygons(path, role), role=role))
            continue
        drawn = [_named(each) for each in read_drawn(path)]
        if any(each.role for each in drawn):
            _check_all_told(drawn)
            parts += drawn
        else:
            silent[path] = drawn
    _check_one_area(silent)
    parts += [replace(each, role="area") for drawn in silent.values() for each in drawn]
    notes: list[str] = []
    if not any(each.role == "area" for each in parts):
        parts, notes = _area_from_fence(parts)
    found = Sketch(tuple(each for each in parts if not each.shape.is_empty), tuple(notes))
    if "keep_in" in found.roles:
        _check_keep_in(found)
    return found


def fence_drawn(
    inclusions: Iterable[Sequence[Zone]], exclusions: Iterable[Zone], where: str = "the vehicle's fence"
) -> list[Drawn]:
    """The zones of an autopilot's fence; the vehicle must be inside one of each group of inclusions.

    Raises:
        SurveyError: a zone is no polygon.
    """
    drawn = []
    for group in inclusions:
        shapes = [_zone(zone, where).shape for zone in group]
        drawn.append(Drawn(f"{where}, {_told(group)}", shapely.union_all(shapes), role="keep_in"))
    drawn += [replace(_zone(zone, where), where=f"{where}, {_told([zone])}") for zone in exclusions]
    return drawn


def _told(zones: Sequence[Zone]) -> str:
    kind = "inclusion" if zones[0].is_inclusion else "exclusion"
    sizes = [
        f"a circle of {zone.radius_m:g} m"
        if zone.radius_m is not None
        else f"{len(zone.corners_deg)} corners"
        for zone in zones
    ]
    return f"{kind}: {' or '.join(sizes)}"


def _zone(zone: Zone, where: str) -> Drawn:
    """By way of a plan, which has the same zones."""
    corners = [list(corner) for corner in zone.corners_deg]
    entry: dict[str, Any] = {"inclusion": zone.is_inclusion, "polygon": corners}
    kind = "polygons"
    if zone.radius_m is not None:
        entry, kind = {**entry, "circle": {"center": corners[0], "radius": zone.radius_m}}, "circles"
    return plan_drawn(Path(where), {"fileType": "Plan", "geoFence": {kind: [entry]}})[0]


def roles_by_name(drawn: Iterable[Drawn]) -> set[str]:
    """What some drawings say that they are, by themselves or by their names."""
    return {role for each in drawn if (role := _named(each).role) is not None}


def _named(drawn: Drawn) -> Drawn:
    """The drawing with the role that its name, or else that of a folder round it, begins with."""
    if drawn.role is not None:
        return drawn
    roles = filter(None, map(_role_of, drawn.names))
    return replace(drawn, role=next(roles, None))


def _role_of(name: str) -> str | None:
    words = re.sub(r"[\W_]+", " ", name.lower()).strip() + " "
    return next(
        (role for role, starts in _WORDS.items() for start in starts if words.startswith(f"{start} ")), None
    )


def _check_all_told(drawn: Sequence[Drawn]) -> None:
    """What has no role among others that have one may be anything."""
    silent = next((each for each in drawn if each.role is None), None)
    if silent is not None:
        raise SurveyError(
            f"{_called(silent)}: what is it? Others in this file say so: let its name begin with {_SAID}"
        )


def _check_one_area(silent: Mapping[Path, Sequence[Drawn]]) -> None:
    if len(silent) > 1:
        wanted = " ".join(f"ROLE={file}" for file in silent)
        raise SurveyError(
            f"none of these files says what its polygons are: write {wanted}, ROLE one of {', '.join(ROLES)}"
        )
    for first, second in _pairs([each for drawn in silent.values() for each in drawn]):
        if first.shape.intersection(second.shape).area > 0.0:
            raise SurveyError(
                f"{_called(first)} and {_called(second)} overlap, and neither says what it is: "
                f"let their names begin with {_SAID}"
            )


def _pairs(drawn: Sequence[Drawn]) -> Iterator[tuple[Drawn, Drawn]]:
    tree = shapely.STRtree([each.shape for each in drawn])
    for k, each in enumerate(drawn):
        yield from ((each, drawn[other]) for other in tree.query(each.shape) if other > k)


def _check_keep_in(found: Sketch) -> None:
    keep_in = found.shape("keep_in")
    wheres = "; ".join(each.where for each in found.parts if each.role == "keep_in")
    if keep_in.area == 0.0:
        raise SurveyError(
            f"these have no area in common, and a vessel must stay inside all of them: {wheres}"
        )
    if keep_in.intersection(found.shape("area")).area == 0.0:
        raise SurveyError(f"keep-in and the survey area do not overlap: {wheres}")


def _called(drawn: Drawn) -> str:
    name = next(filter(None, drawn.names), "")
    return f"{drawn.where} ({shown(name)})" if name and shown(name) not in drawn.where else drawn.where


def _area_from_fence(parts: list[Drawn]) -> tuple[list[Drawn], list[str]]:
    """Without an area it is what the vessel must not leave, if there is such a thing."""
    inside = [each for each in parts if each.role == "keep_in"]
    if not inside:
        raise SurveyError(
            "nothing of this is a survey area: draw a survey pattern or an inclusion fence in a plan, "
            'let the name of a polygon begin with "area", or write area=FILE'
        )
    area = shapely.intersection_all([each.shape for each in inside])
    where = ", ".join(dict.fromkeys(each.where for each in inside))
    note = "no survey area is drawn: all that lies inside the fence (keep_in) is taken for it"
    return [Drawn(where, area, role="area"), *parts], [note]


def _feature(shape: BaseGeometry, role: str | None, name: str | None) -> dict[str, Any]:
    polygons = [orient(part) for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    geometry = polygons[0] if len(polygons) == 1 else MultiPolygon(polygons)
    properties = {"role": role} if not name else {"role": role, "name": name}
    return {"type": "Feature", "properties": properties, "geometry": mapping(geometry)}
