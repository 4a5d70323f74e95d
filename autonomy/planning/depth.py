"""Shallow water out of a depth grid, as polygons: ESRI ASCII grids, to which every GIS exports.

The format: https://desktop.arcgis.com/en/arcmap/latest/manage-data/raster-and-images/esri-ascii-raster-format.htm;
GEBCO and EMODnet deliver it. A cell is too shallow if its value says so or if it has none: nobody knows its depth.
"""

from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal, TextIO

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from autonomy.geometry import FloatArray
from autonomy.planning.errors import SurveyError
from autonomy.planning.rings import shown

Box = tuple[float, float, float, float]
"""West, south, east, north in degrees."""

_MOST_CELLS = 25_000_000
"""In a file; only the surroundings of the survey are kept."""

_MOST_KEPT = 1_000_000
_LONGEST_LINE = 2_000_000
_SLACK = 1e-6
"""Of a cell: by so much a survey may reach over the grid's edge, whose numbers are rounded."""

_HOW = "gdal_translate -of AAIGrid FILE depth.asc makes one"


@dataclass(frozen=True)
class _Header:
    """The head of an ESRI ASCII grid; west and south are the outer edges, degrees; cells are (dx, dy)."""

    columns: int
    rows: int
    west: float
    south: float
    dx: float
    dy: float
    nodata: float

    @property
    def east(self) -> float:
        return self.west + self.columns * self.dx

    @property
    def north(self) -> float:
        return self.south + self.rows * self.dy


def shallow_water(
    path: Path, area: Box, window: Box, minimum_depth_m: float, positive: Literal["up", "down"]
) -> BaseGeometry:
    """The cells of a depth grid with less water than that, or of unknown depth, joined.

    Args:
        path: an ESRI ASCII grid (.asc) in degrees on WGS84.
        area: must be covered by the grid.
        window: cells that do not touch it are left out.
        minimum_depth_m: cells with at least this depth are not shallow.
        positive: "up" for heights, negative below the water; "down" for depths.

    Returns:
        A valid multipolygon in degrees, x longitude, y latitude; empty where all water is deep.

    Raises:
        SurveyError: the file cannot be read, is no such grid, or does not cover the area.
    """
    if path.suffix.lower() != ".asc":
        raise SurveyError(f"{path}: is no ESRI ASCII grid (.asc), the one format for depths; {_HOW}")
    try:
        with path.open(encoding="ascii") as file:
            header = _header(path, file)
            shift = _shift(path, header, area)
            west, south, east, north = window
            kept = _kept(path, header, (west - shift, south, east - shift, north))
            values = _values(path, header, file, kept)
    except OSError as error:
        raise SurveyError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise SurveyError(f"{path}: is no text, so no ESRI ASCII grid; {_HOW}") from error
    depth = -values if positive == "up" else values
    # Comparisons with NaN are false: what has no value is shallow.
    shallow = ~(depth >= minimum_depth_m)
    return shapely.transform(_joined(header, kept, shallow), lambda xy: xy + np.array([shift, 0.0]))


def _header(path: Path, file: TextIO) -> _Header:
    """The key–value lines at the top; leaves the file at the first row of values."""
    said: dict[str, float] = {}
    where = file.tell()
    for number in range(1, 20):
        words = file.readline(_LONGEST_LINE).split()
        if len(words) != 2 or not words[0][0].isalpha() or words[0].lower() == "nan":
            break
        try:
            said[words[0].lower()] = float(words[1])
        except ValueError:
            raise SurveyError(
                f"{path}:{number}: {shown(words[1])} is no number for {shown(words[0])}"
            ) from None
        where = file.tell()
    file.seek(where)
    dx, dy = said.get("dx", said.get("cellsize")), said.get("dy", said.get("cellsize"))
    columns, rows = said.get("ncols"), said.get("nrows")
    if columns is None or rows is None or dx is None or dy is None:
        raise SurveyError(
            f"{path}: begins without ncols, nrows and cellsize, so it is no ESRI ASCII grid; {_HOW}"
        )
    if not (1 <= columns <= 1e6 and 1 <= rows <= 1e6 and columns * rows <= _MOST_CELLS):
        raise SurveyError(
            f"{path}: has {columns:g} columns and {rows:g} rows; at most {_MOST_CELLS} cells are read: cut it"
        )
    if columns % 1.0 or rows % 1.0 or not (0.0 < dx < 90.0 and 0.0 < dy < 90.0):
        raise SurveyError(f"{path}: ncols and nrows must be whole numbers, cellsize degrees above 0")
    west, south = _edge(path, said, "x", dx), _edge(path, said, "y", dy)
    header = _Header(int(columns), int(rows), west, south, dx, dy, said.get("nodata_value", np.nan))
    if west < -361.0 or header.east > 721.0 or south < -91.0 or header.north > 91.0 or np.isnan(west + south):
        raise SurveyError(
            f"{path}: reaches from {west:g}, {south:g} to {header.east:g}, {header.north:g}, which are no degrees "
            "of longitude and latitude; gdalwarp -t_srs EPSG:4326 converts it"
        )
    return header


def _edge(path: Path, said: dict[str, float], axis: str, cell: float) -> float:
    corner, centre = said.get(f"{axis}llcorner"), said.get(f"{axis}llcenter")
    if corner is not None:
        return corner
    if centre is None:
        raise SurveyError(f"{path}: says neither {axis}llcorner nor {axis}llcenter")
    return centre - cell / 2


def _shift(path: Path, header: _Header, area: Box) -> float:
    """Turns of 360 degrees between the grid's longitudes and the survey's."""
    west, south, east, north = area
    x, y = _SLACK * header.dx, _SLACK * header.dy
    if header.south <= south + y and north - y <= header.north:
        for shift in (0.0, 360.0, -360.0):
            if header.west + shift <= west + x and east - x <= header.east + shift:
                return shift
    raise SurveyError(
        f"{path}: covers longitudes {header.west:g} to {header.east:g} and latitudes {header.south:g} to "
        f"{header.north:g}, but the survey area reaches from {west:g} to {east:g} and from {south:g} to {north:g}"
    )


def _kept(path: Path, header: _Header, window: Box) -> tuple[slice, slice]:
    """Columns from the west and rows from the north that touch the window."""
    west, south, east, north = window
    first, last = np.floor((np.array([west, east]) - header.west) / header.dx).astype(int)
    top, bottom = np.floor((header.north - np.array([north, south])) / header.dy).astype(int)
    columns = slice(max(0, int(first)), min(header.columns, int(last) + 1))
    rows = slice(max(0, int(top)), min(header.rows, int(bottom) + 1))
    count = (columns.stop - columns.start) * (rows.stop - rows.start)
    if count > _MOST_KEPT:
        raise SurveyError(
            f"{path}: has {count} cells about the survey area, more than {_MOST_KEPT}; average it to coarser ones"
        )
    return columns, rows


def _values(path: Path, header: _Header, file: TextIO, kept: tuple[slice, slice]) -> FloatArray:
    """Values of the kept cells, rows from the north; NaN where there is none. Lines are read one by one."""
    columns, rows = kept
    values = np.empty((rows.stop - rows.start, columns.stop - columns.start))
    for row in range(rows.stop):
        line = file.readline(_LONGEST_LINE)
        if row < rows.start:
            continue
        words = line.split()
        if len(words) != header.columns:
            raise SurveyError(
                f"{path}: row {row + 1} of values, from the north, has {len(words)} of them, not {header.columns}"
            )
        try:
            values[row - rows.start] = [float(word) for word in islice(words, columns.start, columns.stop)]
        except ValueError as error:
            raise SurveyError(f"{path}: row {row + 1} of values, from the north: {shown(error)}") from None
    values[(values == header.nodata) | ~np.isfinite(values)] = np.nan
    return values


def _joined(header: _Header, kept: tuple[slice, slice], shallow: NDArray[np.bool_]) -> BaseGeometry:
    """The union of cells: runs along a row first, which makes it quick."""
    columns, rows = kept
    padded = np.zeros((len(shallow), shallow.shape[1] + 2), dtype=np.int8)
    padded[:, 1:-1] = shallow
    row, edge = np.nonzero(np.diff(padded, axis=1))
    if not len(row):
        return MultiPolygon()
    x = header.west + (columns.start + edge) * header.dx
    y = header.north - (rows.start + row) * header.dy
    return shapely.union_all(shapely.box(x[::2], y[::2] - header.dy, x[1::2], y[::2]))
