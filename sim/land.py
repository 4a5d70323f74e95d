"""Land and outline of a field as polygons in degrees: what a vessel may know of the sea it sails.

The polygons are the field's own cells, so that a place is inside them exactly if the field calls it land.
"""

from typing import Any

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Polygon, mapping
from shapely.geometry.polygon import orient

from autonomy.geometry import LocalFrame
from sim.field import Field
from sim.field_grid import BoolArray, FloatArray, Grid

_STRAIGHT_DEG = 1e-9  # 0.1 mm: vertices that far out of line are dropped


def land_polygons(field: Field, simplify_m: float = 0.0) -> MultiPolygon:
    """All land cells of a field, joined.

    Args:
        field: the field.
        simplify_m: straighten the outline by at most this much, metres. The land is first widened by as much,
            so that the result still holds every land cell; it reaches at most twice this far over the water.

    Returns:
        Polygons in x longitude, y latitude, degrees; exteriors counter-clockwise, holes clockwise (RFC 7946);
        empty where there is no land.
    """
    land = _to_degrees(_cells(field.mask.land), field.mask.grid)
    if simplify_m > 0.0 and not land.is_empty:
        land = _simplified(land, LocalFrame(*_centre(field)), simplify_m)
    return _oriented(_as_multipolygon(land))


def water_outline(field: Field) -> Polygon:
    """The outline of the field's domain through its outermost grid points, land included; in degrees."""
    rows, columns = field.mask.grid.shape
    box = shapely.box(0.0, 0.0, columns - 1.0, rows - 1.0)
    outline = _to_degrees(box, field.mask.grid)
    return orient(outline, 1.0)


def feature_collection(polygons: MultiPolygon | Polygon, name: str, decimals: int = 7) -> dict[str, Any]:
    """A GeoJSON FeatureCollection (RFC 7946) with one named feature a polygon; empty when there is none."""
    parts = list(polygons.geoms) if isinstance(polygons, MultiPolygon) else [polygons]
    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": {"name": f"{name} {number}" if len(parts) > 1 else name},
                "geometry": _rounded(mapping(part), decimals),
            }
            for number, part in enumerate(parts, start=1)
        ],
    }


def _cells(land: BoolArray) -> Any:
    """The union of land cells in index space, x column, y row; runs of a row first, which makes it quick."""
    boxes = []
    for row, cells in enumerate(land):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], cells.astype(np.int8), [0]])))
        for first, end in edges.reshape(-1, 2):
            boxes.append(shapely.box(first - 0.5, row - 0.5, end - 0.5, row + 0.5))
    return shapely.union_all(boxes)


def _to_degrees(shape: Any, grid: Grid) -> Any:
    """A shape of index space on the globe: along rows and columns the map is straight for half a cell."""
    if shape.is_empty:
        return shape
    shift = 360.0 if grid.bounds.west < -180.0 else 0.0

    def positions(points: FloatArray) -> FloatArray:
        lat, lon = grid.positions(points[:, 1], points[:, 0])
        return np.stack([lon + shift, lat], axis=-1)

    mapped = shapely.transform(shapely.segmentize(shape, 0.5), positions)
    return shapely.simplify(mapped, _STRAIGHT_DEG)


def _simplified(land: Any, frame: LocalFrame, tolerance_m: float) -> Any:
    def to_local(points: FloatArray) -> FloatArray:
        return frame.to_local(points[:, 1], points[:, 0])

    def to_degrees(points: FloatArray) -> FloatArray:
        degrees = frame.to_geodetic(points)[:, ::-1]
        west_of = degrees[:, :1] < frame.origin_lon_deg - 180.0
        return np.where([[True, False]], degrees + 360.0 * west_of, degrees)

    # A chord lies within the tolerance of what it replaces, and that lies a little farther out than the land.
    widened = shapely.buffer(shapely.transform(land, to_local), 1.05 * tolerance_m, quad_segs=4)
    return shapely.transform(shapely.simplify(widened, 0.9 * tolerance_m), to_degrees)


def _centre(field: Field) -> tuple[float, float]:
    lat, lon = field.bounds.centre
    return lat, lon + 360.0 if field.bounds.west < -180.0 else lon


def _as_multipolygon(shape: Any) -> MultiPolygon:
    parts = [part for part in shapely.get_parts(shape) if isinstance(part, Polygon) and not part.is_empty]
    return MultiPolygon(parts)


def _oriented(polygons: MultiPolygon) -> MultiPolygon:
    return MultiPolygon([orient(part, 1.0) for part in polygons.geoms])


def _rounded(geometry: Any, decimals: int) -> dict[str, Any]:
    rings = [[[round(x, decimals), round(y, decimals)] for x, y in ring] for ring in geometry["coordinates"]]
    return {"type": geometry["type"], "coordinates": rings}
