"""Files by the conventions of QGroundControl and Google Earth, with everything that these write beside polygons.

They are in `drawn/`, written for this test after the form of the real ones. What must come of them is given here as
boxes, made by nothing that reads files.
"""

import io
import json
import zipfile
from pathlib import Path

import pytest
import shapely
from pyproj import Geod
from shapely.geometry import Point, box

from autonomy.cli import main

DRAWN = Path(__file__).parent / "drawn"
AREA = box(9.86, 54.455, 9.90, 54.475)
FENCE = box(9.84, 54.45, 9.895, 54.48)
NETS = box(9.866, 54.458, 9.868, 54.460)
FARM = box(9.868, 54.466, 9.872, 54.468)
LAND = box(9.85, 54.473, 9.91, 54.48) | box(9.85, 54.45, 9.91, 54.457)
ISLET = box(9.88, 54.46, 9.884, 54.464)
NAMES = sorted(path.name for path in DRAWN.iterdir())


@pytest.fixture
def imported(tmp_path, capsys):
    """The shapes of a survey made of files, by role; or, if it was refused, what was said."""

    def run(*files, start="54.47,9.865"):
        out = tmp_path / "survey.geojson"
        code = main(
            ["survey", "import", *map(str, files), "--out", str(out), "--standoff-m", "0", f"--start={start}"]
        )
        told = capsys.readouterr()
        if code:
            assert not out.exists()
            return told.err
        shapes: dict[str, shapely.Geometry] = {}
        for feature in json.loads(out.read_text())["features"]:
            role = feature["properties"]["role"]
            shape = shapely.from_geojson(json.dumps(feature["geometry"]))
            shapes[role] = shapes.get(role, shapely.Polygon()) | shape
        return shapes

    return run


def equal(shape, expected):
    return shape.symmetric_difference(expected).area < 1e-12


class TestQGroundControl:
    def test_pattern_zones_circle_and_rally_points(self, imported):
        found = imported(DRAWN / "qgc-survey-and-fence.plan")
        assert set(found) == {"area", "keep_in", "keep_out"}
        assert equal(found["area"], AREA)
        assert equal(found["keep_in"], FENCE)
        nets, circle = sorted(shapely.get_parts(found["keep_out"]), key=lambda part: part.area)
        assert equal(nets, NETS)
        around = Geod(ellps="WGS84").geometry_length
        reach_m = [around(shapely.LineString([(9.873, 54.463), corner])) for corner in circle.exterior.coords]
        assert 150.5 <= min(reach_m) <= max(reach_m) < 151.5

    def test_without_a_pattern_the_inside_of_the_fence(self, imported):
        found = imported(DRAWN / "qgc-fence-only.plan")
        assert equal(found["area"], FENCE)
        assert found["keep_out"].covers(NETS)

    def test_a_fence_of_version_1(self, imported):
        """One polygon, which the vehicle must not leave: it is not passed over because its name is another one."""
        found = imported(DRAWN / "qgc-2017.plan")
        assert set(found) == {"area", "keep_in"}
        assert equal(found["area"], AREA)
        assert equal(found["keep_in"], FENCE)

    def test_other_patterns_have_no_area(self, imported):
        said = imported(DRAWN / "qgc-corridor.plan")
        assert "neither a survey pattern nor a fence (only CorridorScan, which has no survey area)" in said

    def test_the_order_of_keys_and_unknown_ones_do_not_matter(self, imported, tmp_path):
        content = json.loads((DRAWN / "qgc-survey-and-fence.plan").read_text())
        content = {"comment": {"polygon": [[0, 0]]}, **dict(reversed(content.items()))}
        (tmp_path / "b.plan").write_text("﻿" + json.dumps(content), encoding="utf-8")
        assert equal(imported(tmp_path / "b.plan")["area"], AREA)

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            ('"fileType": "Plan"', '"fileType": "Mission"', '"fileType": "Plan" is missing'),
            (
                '"version": 2\n    },\n    "groundStation"',
                '"version": 3\n    },\n    "groundStation"',
                "version 3; 1 and 2",
            ),
            ('"radius": 150.5', '"radius": -150.5', "its radius is -150.5"),
            ('"inclusion": true', '"inclusion": "yes"', '"inclusion": true or false'),
            ("54.475", "154.475", "154.475 is no latitude; a plan has the latitude first"),
            ('"polygon": [', '"polygone": [', '"polygon" must be a list of at least three'),
            ('    "version": 1\n}', '    "version": 1,\n}', "is not JSON"),
        ],
    )
    def test_what_is_wrong_is_said(self, imported, tmp_path, old, new, said):
        text = (DRAWN / "qgc-survey-and-fence.plan").read_text()
        assert old in text
        (tmp_path / "b.plan").write_text(text.replace(old, new))
        assert said in imported(tmp_path / "b.plan")


class TestGoogleEarth:
    def test_folders_documents_holes_and_closed_paths(self, imported):
        found = imported(DRAWN / "earth-pro.kml")
        assert set(found) == {"area", "keep_out", "land"}
        assert equal(found["area"], AREA - ISLET)
        assert equal(found["land"], LAND)
        assert equal(found["keep_out"], FARM)

    def test_cascading_styles_and_a_position_a_line(self, imported):
        found = imported(DRAWN / "earth-web.kml")
        assert equal(found["area"], AREA)
        assert equal(found["keep_out"], FARM)

    def test_a_kmz_with_pictures(self, imported, tmp_path):
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("files/ylw-pushpin.png", b"\x89PNG\r\n\x1a\n")
            archive.writestr("doc.kml", (DRAWN / "earth-pro.kml").read_bytes())
        (tmp_path / "bay.kmz").write_bytes(buffer.getvalue())
        assert equal(imported(tmp_path / "bay.kmz")["land"], LAND)

    @pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
    @pytest.mark.parametrize("newline", ["\n", "\r\n"])
    def test_encodings(self, imported, tmp_path, encoding, newline):
        text = (DRAWN / "earth-pro.kml").read_text("utf-8")
        text = text.replace('"UTF-8"', '"UTF-16"') if encoding == "utf-16" else text
        (tmp_path / "b.kml").write_bytes(text.replace("\n", newline).encode(encoding))
        assert equal(imported(tmp_path / "b.kml")["area"], AREA - ISLET)

    @pytest.mark.parametrize(
        ("old", "new", "said"),
        [
            (
                "9.868,54.468,0 9.868,54.466,0",
                "9.868,54.468,0",
                "holds a path (LineString) that is not closed",
            ),
            ("9.86,54.475,0 9.86,54.455,0", "9.86,54.475,0", "is not closed"),
            ("9.90,54.455,0", "9.90;54.455;0", "'9.90;54.455;0' is not longitude,latitude"),
            ("9.90,54.455,0", "9.90, 54.455, 0", "without spaces"),
            ("<name>Survey area, June</name>", "<name>June</name>", "(June): what is it?"),
            ("</Document>\n</kml>", "</kml>", "is not well-formed KML: mismatched tag"),
            (
                "<Folder>\n\t\t<name>Bay",
                "<NetworkLink><name>coast</name><Link><href>coast.kml</href></Link></NetworkLink>\n<Folder>\n\t\t<name>Bay",
                "b.kml:32: holds a NetworkLink, which is not followed",
            ),
        ],
    )
    def test_what_is_wrong_is_said(self, imported, tmp_path, old, new, said):
        text = (DRAWN / "earth-pro.kml").read_text("utf-8")
        assert old in text
        (tmp_path / "b.kml").write_text(text.replace(old, new), encoding="utf-8")
        assert said in imported(tmp_path / "b.kml")


def test_together_they_are_one_survey(imported):
    """Fence and nets from the one, land from the other: the area of either is the same water here."""
    found = imported(DRAWN / "qgc-survey-and-fence.plan", DRAWN / "earth-web.kml")
    assert equal(found["area"], AREA)
    assert found["keep_out"].covers(NETS | FARM)
    assert Point(9.87, 54.467).within(found["keep_out"])
