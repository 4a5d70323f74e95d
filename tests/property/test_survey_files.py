"""Whatever is in a file of polygons or depths, reading it ends in polygons or in a message that names the file.

Random bytes, and good files with bytes and whole pieces changed. Memory is measured where a small file could ask for
much of it.
"""

import io
import json
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from shapely.geometry import box, mapping

from autonomy.planning.depth import shallow_water
from autonomy.planning.polygon_files import Role, read_polygons
from autonomy.planning.survey import SurveyError

SIGNS: tuple[Literal["up", "down"], ...] = ("up", "down")
ROLES: tuple[Role, ...] = ("area", "keep_in", "keep_out", "land")
AREA = (-119.0, 33.0, -118.9, 33.1)

_RING = "-119,33,0 -118.9,33,0 -118.9,33.1,0 -119,33,0"
KML = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>'
    "<MultiGeometry><Polygon><altitudeMode>absolute</altitudeMode><outerBoundaryIs><LinearRing><coordinates>"
    f"{_RING}</coordinates></LinearRing></outerBoundaryIs></Polygon></MultiGeometry></Placemark></Document></kml>"
).encode()
GEOJSON = json.dumps(
    {
        "type": "FeatureCollection",
        "features": [
            {"type": "Feature", "id": 7, "properties": {"name": "n"}, "geometry": mapping(box(0, 0, 1, 1))}
        ],
    }
).encode()
PLAN = json.dumps(
    {
        "fileType": "Plan",
        "geoFence": {
            "circles": [{"circle": {"center": [33.0, -119.0], "radius": 500.0}, "inclusion": False}],
            "polygons": [{"inclusion": True, "polygon": [[33.0, -119.0], [33.1, -119.0], [33.1, -118.9]]}],
        },
        "mission": {
            "items": [
                {"complexItemType": "survey", "polygon": [[33.0, -119.0], [33.1, -119.0], [33.1, -118.9]]}
            ]
        },
    }
).encode()
GRID = (
    "ncols 4\nnrows 4\nxllcorner -119.05\nyllcorner 32.95\ncellsize 0.05\nNODATA_value -9999\n"
    + "\n".join(" ".join(f"{v:.1f}" for v in row) for row in np.linspace(-9, 3, 16).reshape(4, 4))
).encode()


def archive(document: bytes, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as file:
        file.writestr("doc.kml", document)
    return buffer.getvalue()


GOOD = {"kml": KML, "geojson": GEOJSON, "plan": PLAN, "asc": GRID, "kmz": archive(KML)}
PIECES = (
    *(
        b"<",
        b">",
        b"&amp;",
        b"&x;",
        b"<!DOCTYPE a>",
        b"<Polygon>",
        b"</coordinates>",
        b"<![CDATA[",
        b"\xff",
        b"\x00",
    ),
    *(
        b"[",
        b"]",
        b"{",
        b"}",
        b",",
        b'"',
        b"null",
        b"NaN",
        b"1e999",
        b"-1",
        b"9" * 30,
        b"true",
        b"\\ud800",
        b"nan",
    ),
    *(b"ncols", b"1e400", b"\r", b"PK\x05\x06"),
)


@st.composite
def damaged(draw: st.DrawFn, good: bytes) -> bytes:
    """A good file in which a few stretches were cut out, doubled, or replaced by bytes or telling pieces."""
    data = good
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 30)))
        piece = draw(st.sampled_from(PIECES) | st.binary(max_size=6) | st.just(data[start:end] * 2))
        data = data[:start] + piece + data[end:]
    return data


def anything(kind: str) -> st.SearchStrategy[bytes]:
    changed = damaged(GOOD[kind])
    if kind == "kmz":
        stored = damaged(KML).map(lambda document: archive(document, zipfile.ZIP_STORED))
        return changed | stored | st.binary(max_size=300).map(archive)
    return changed | st.binary(max_size=300)


def outcome(read: Callable[[], shapely.Geometry], path: Path) -> str:
    """`polygons` or the message; everything else that can happen is a failure."""
    try:
        shape = read()
    except SurveyError as error:
        said = str(error)
    else:
        return _sound(shape)
    assert str(path) in said
    assert len(said) < 1000
    said.encode()
    return said


def _sound(shape: shapely.Geometry) -> str:
    assert shape.geom_type in ("Polygon", "MultiPolygon") or shape.is_empty
    assert shape.is_valid
    assert np.isfinite(shapely.get_coordinates(shape)).all()
    return "polygons"


QUICK = settings(deadline=2000, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.mark.parametrize("kind", ["kml", "kmz", "geojson", "plan"])
def test_files_of_polygons(kind: str, tmp_path: Path) -> None:
    @QUICK
    @given(anything(kind), st.sampled_from(ROLES), st.sampled_from([kind, "dat"]))
    @example(GOOD[kind], "area", kind)
    def check(data: bytes, role: Role, suffix: str) -> None:
        path = tmp_path / f"file.{suffix}"
        path.write_bytes(data)
        outcome(lambda: read_polygons(path, role), path)

    check()


@QUICK
@given(anything("asc"), st.sampled_from(SIGNS))
def test_grids_of_depths(tmp_path: Path, data: bytes, positive: Literal["up", "down"]) -> None:
    path = tmp_path / "depth.asc"
    path.write_bytes(data)
    outcome(lambda: shallow_water(path, AREA, AREA, 3.0, positive), path)


KEYS = (
    *(
        "type",
        "features",
        "geometry",
        "coordinates",
        "id",
        "crs",
        "fileType",
        "geoFence",
        "polygons",
        "circles",
    ),
    *("circle", "center", "radius", "inclusion", "polygon", "mission", "items", "complexItemType"),
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just(10**400),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(KEYS),
            inner
            | st.sampled_from(["Feature", "FeatureCollection", "Polygon", "MultiPolygon", "Plan", "survey"]),
            max_size=5,
        )
    ),
    max_leaves=20,
)


@QUICK
@given(
    JSON, st.sampled_from(ROLES), st.sampled_from([{}, {"fileType": "Plan"}, {"type": "FeatureCollection"}])
)
def test_json_of_any_shape(tmp_path: Path, content: object, role: Role, head: dict[str, str]) -> None:
    path = tmp_path / "file.json"
    path.write_text(json.dumps({**content, **head} if isinstance(content, dict) else content))
    outcome(lambda: read_polygons(path, role), path)


GREEDY: dict[str, Callable[[], bytes]] = {
    "deep.json": lambda: b"[" * 1_900_000,
    "deep.kml": lambda: b"<kml>" + b"<a>" * 1_000_000,
    "many.kml": lambda: b"<kml><Polygon>" + b"<a/>" * 250_000,
    "bomb.kmz": lambda: archive(b"<kml>" + b" " * 100_000_000),
    "wide.asc": lambda: (
        b"ncols 1000000\nnrows 25\ncellsize 1e-7\nxllcorner -119\nyllcorner 33\n" + b"1 " * 5_000_000
    ),
}


@pytest.mark.parametrize("name", GREEDY)
def test_no_file_asks_for_much_memory(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(GREEDY[name]())
    read = (
        (lambda: shallow_water(path, AREA, AREA, 3.0, "up"))
        if name.endswith("asc")
        else (lambda: read_polygons(path, "land"))
    )
    tracemalloc.start()
    try:
        assert outcome(read, path) != "polygons"
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # Documents are 32 MB at most, and what is kept of them less than ten times that.
    assert peak < 250e6
