"""Polygons of KML and KMZ files, as Google Earth writes them.

Taken are all Polygons, alone or in a MultiGeometry, in whatever folder, shown or hidden, and paths that end where they
began; altitudes and styles are not looked at. Placemarks that are points are notes and are passed over. Other lines are
refused, since whoever drew one may have meant the shore, and so are links to what is elsewhere, which may be land.
The standard: OGC 12-007r2, KML 2.3.

What a file can cost is bounded: by its size, by number and depth of its elements, and because document types, which
could define entities that swell, are refused.
"""

import io
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from shapely.geometry.base import BaseGeometry

from autonomy.planning.errors import SurveyError
from autonomy.planning.rings import Drawn, Position, area_of, check_closed, position, shown

LARGEST_BYTES = 32_000_000
"""Of a document, unpacked."""

_DEEPEST = 50
_MOST_ELEMENTS = 200_000
_MOST_MEMBERS = 10_000
_ORDER = "KML has the longitude first, then the latitude, then the altitude, without spaces"
_PATHS = frozenset({"LineString", "LinearRing"})
"""Taken for polygons without holes where they are closed."""

_TRACKS = frozenset({"Track", "MultiTrack"})
_NAMED = frozenset({"Placemark", "Folder"})
"""Whose names tell what a polygon is; that of the document is only the file's."""


@dataclass(slots=True)
class _Element:
    """What is kept of an element: name without prefix, line, text of the ones that matter, what is inside."""

    name: str
    line: int
    text: list[str] = field(default_factory=list)
    inside: "list[_Element]" = field(default_factory=list)

    def all(self, name: str) -> "list[_Element]":
        return [element for element in self.inside if element.name == name]


def kml_drawn(path: Path, data: bytes) -> list[Drawn]:
    """The polygons of a KML document.

    Returns:
        At least one, with the names of its placemark and folders.

    Raises:
        SurveyError: it is no KML, holds no polygon or one that is not valid, a line that is not closed, or a link.
    """
    reader = _Reader(path)
    reader.read(data)
    if not reader.polygons:
        raise SurveyError(f"{path}: has no polygon in it; at least one Polygon is needed")
    return [
        Drawn(
            f"{path}:{element.line}",
            _polygon(path, element),
            tuple("".join(each.text).strip() for each in within),
        )
        for element, within in reader.polygons
    ]


def kmz_document(path: Path, data: bytes) -> bytes:
    """The KML document in a KMZ archive: doc.kml, or else the first .kml in it, as Google Earth does.

    Raises:
        SurveyError: it is no archive, holds no document, or a too large or damaged one.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()[:_MOST_MEMBERS]
            documents = [m for m in members if m.filename.lower().endswith(".kml")]
            documents.sort(key=lambda m: m.filename != "doc.kml")
            if not documents:
                raise SurveyError(f"{path}: is an archive without a .kml document in it")
            with archive.open(documents[0]) as document:
                content = document.read(LARGEST_BYTES + 1)
    except (
        zipfile.BadZipFile,
        zlib.error,
        NotImplementedError,
        RuntimeError,
        EOFError,
        ValueError,
        OSError,
    ) as error:
        if isinstance(error, SurveyError):
            raise
        raise SurveyError(
            f"{path}: is not a readable KMZ archive: {shown(error)}; save it again, or as KML"
        ) from error
    if len(content) > LARGEST_BYTES:
        raise SurveyError(
            f"{path}: its document is larger than {LARGEST_BYTES / 1e6:g} MB unpacked; leave out the rest"
        )
    return content


class _Reader:
    """Feeds a document through expat, keeping polygons only."""

    def __init__(self, path: Path) -> None:
        self.polygons: list[tuple[_Element, list[_Element]]] = []
        """Each with the placemark and the folders round it, the innermost first."""
        self._path = path
        self._open: list[_Element] = []
        self._elements = 0
        self._polygon_depth: int | None = None
        self._parser = parser = expat.ParserCreate()
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text

    def read(self, data: bytes) -> None:
        try:
            self._parser.Parse(data, True)
        except expat.ExpatError as error:
            raise SurveyError(
                f"{self._path}:{error.lineno}:{error.offset + 1}: is not well-formed KML: "
                f"{expat.ErrorString(error.code)}"
            ) from error
        except SurveyError:
            raise
        except (LookupError, ValueError) as error:  # no such encoding, or one that the parser can't work with
            raise SurveyError(
                f"{self._path}: is in an unknown encoding: {shown(error)}; UTF-8 is needed"
            ) from error

    def _doctype(self, *_: object) -> None:
        raise self._mistake("has a DOCTYPE; KML needs none, and what it could define is not read")

    def _start(self, tag: str, _: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        if not self._open and name != "kml":
            raise self._mistake(f"is XML but not KML: its outermost element is {shown(tag)}, not kml")
        if len(self._open) >= _DEEPEST:
            raise self._mistake(f"has elements more than {_DEEPEST} deep")
        self._elements += 1
        if self._elements > _MOST_ELEMENTS:
            raise self._mistake(
                f"has more than {_MOST_ELEMENTS} elements; leave out what is not near the survey"
            )
        within = self._polygon_depth is not None
        if name in _TRACKS:
            raise self._mistake(f"holds a {name}; a closed Polygon is needed")
        if name == "NetworkLink":
            raise self._mistake(
                "holds a NetworkLink, which is not followed: in Google Earth save what it shows as a file of its own"
            )
        element = _Element(name, self._parser.CurrentLineNumber)
        if within:
            self._open[-1].inside.append(element)
        elif name == "Polygon" or name in _PATHS:
            self._polygon_depth = len(self._open)
            named = [each for each in reversed(self._open) if each.name in _NAMED]
            self.polygons.append((element, named))
        self._open.append(element)

    def _end(self, _: str) -> None:
        self._open.pop()
        if self._polygon_depth == len(self._open):
            self._polygon_depth = None

    def _text(self, text: str) -> None:
        if self._open and self._open[-1].name == "coordinates":
            self._open[-1].text.append(text)
        elif len(self._open) > 1 and self._open[-1].name == "name" and self._open[-2].name in _NAMED:
            self._open[-2].text.append(text)

    def _mistake(self, what: str) -> SurveyError:
        return SurveyError(f"{self._path}:{self._parser.CurrentLineNumber}: {what}")


def _polygon(path: Path, polygon: _Element) -> BaseGeometry:
    where = f"{path}:{polygon.line}"
    if polygon.name in _PATHS:
        return area_of([[_ring(path, polygon)]], where)
    outer, inner = polygon.all("outerBoundaryIs"), polygon.all("innerBoundaryIs")
    if len(outer) != 1:
        raise SurveyError(f"{where}: the Polygon has {len(outer)} outerBoundaryIs; exactly one is needed")
    # Google Earth writes one innerBoundaryIs for every hole, others all holes into one.
    rings = [_ring(path, ring) for boundary in (*outer, *inner) for ring in _linear_rings(path, boundary)]
    return area_of([rings], where)


def _linear_rings(path: Path, boundary: _Element) -> list[_Element]:
    rings = boundary.all("LinearRing")
    if not rings or (boundary.name == "outerBoundaryIs" and len(rings) > 1):
        raise SurveyError(
            f"{path}:{boundary.line}: {boundary.name} has {len(rings)} LinearRings; one is needed"
        )
    return rings


def _ring(path: Path, ring: _Element) -> list[Position]:
    where = f"{path}:{ring.line}"
    texts = ring.all("coordinates")
    if len(texts) != 1:
        raise SurveyError(f"{where}: the {ring.name} has {len(texts)} coordinates elements; one is needed")
    tuples = "".join(texts[0].text).split()
    positions = [_position(text, f"{where}, position {index}") for index, text in enumerate(tuples)]
    if ring.name == "LineString" and (len(positions) < 4 or positions[0] != positions[-1]):
        raise SurveyError(f"{where}: holds a path (LineString) that is not closed; a Polygon is needed")
    check_closed(positions, where)
    return positions


def _position(text: str, where: str) -> Position:
    try:
        numbers = [float(part) for part in text.split(",", 3)]
    except ValueError:
        numbers = []
    if len(numbers) not in (2, 3):
        raise SurveyError(f"{where}: {shown(text)!r} is not longitude,latitude[,altitude] without spaces")
    return position(numbers[0], numbers[1], where, text, _ORDER)
