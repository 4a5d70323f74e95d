"""`autonomy survey import`: plans, KML and GeoJSON as people draw them, and the fence of a vehicle."""

import io
import json
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pyproj import Geod
from shapely.geometry import box

from autonomy.cli import main
from autonomy.commands.sketch import fence_drawn, sketch
from autonomy.commands.survey_doubts import stair_m
from autonomy.config import load
from autonomy.geometry import LocalFrame
from autonomy.mavlink.fence import Zone
from autonomy.planning.polygon_files import read_polygons
from autonomy.planning.survey import SurveyError, read_survey
from sim.autopilot import Autopilot, Options
from sim.autopilot.missions import MissionItem
from sim.vessel import Position, Vessel

sys.path.insert(0, str(Path(__file__).parent / "preflight"))
from quay import served

AREA = box(-118.98, 33.02, -118.92, 33.08)
WEST, SOUTH, EAST, NORTH = AREA.bounds


def ring(shape):
    return " ".join(f"{x:.8f},{y:.8f},0" for x, y in shape.exterior.coords)


def placemark(name, shape):
    """As Google Earth Pro 7.3 writes a polygon."""
    return (
        f"<Placemark><name>{name}</name><styleUrl>#m</styleUrl><Polygon><tessellate>1</tessellate><outerBoundaryIs>"
        f"<LinearRing><coordinates>\n{ring(shape)} \n</coordinates></LinearRing></outerBoundaryIs></Polygon>"
        "</Placemark>"
    )


def kml(*inside):
    return (
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">'
        f"<Document><name>land.kml</name>{''.join(inside)}</Document></kml>"
    )


def corners(shape):
    return [[lat, lon] for lon, lat in shape.exterior.coords[:-1]]


def plan(pattern=AREA, inside=None, outside=()):
    zones = [{"inclusion": True, "polygon": corners(each), "version": 1} for each in inside or ()]
    zones += [{"inclusion": False, "polygon": corners(each), "version": 1} for each in outside]
    items = (
        []
        if pattern is None
        else [{"type": "ComplexItem", "complexItemType": "survey", "polygon": corners(pattern), "version": 5}]
    )
    return {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": zones, "version": 2},
        "groundStation": "QGroundControl",
        "mission": {"items": items, "plannedHomePosition": [33.0, -119.0, 0]},
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }


ISLAND = box(-118.96, 33.04, -118.955, 33.045)
WRECK = box(-118.94, 33.06, -118.935, 33.065)
PERMIT = box(-119.0, 33.0, -118.93, 33.1)


@pytest.fixture
def desk(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def write(**files):
        for name, content in files.items():
            data = json.dumps(content) if isinstance(content, dict) else content
            path = tmp_path / name.replace("_", ".")
            path.write_bytes(data if isinstance(data, bytes) else data.encode())

    return write


def imported(*words):
    return main(["survey", "import", *words, "--out", "survey.geojson"])


def read():
    return json.loads(Path("survey.geojson").read_text())["features"]


class TestFiles:
    def test_a_plan_with_its_fence(self, desk, capsys):
        desk(bay_plan=plan(inside=[PERMIT], outside=[WRECK]))
        assert imported("bay.plan") == 0
        out, err = capsys.readouterr()
        assert [each["properties"]["role"] for each in read()] == ["area", "keep_in", "keep_out"]
        assert "no land is drawn" in err
        assert "mission.items[0] (survey)" in out
        assert out.endswith(
            'survey:\n  area: "survey.geojson"\n  keep_in: "survey.geojson"\n  keep_out: "survey.geojson"\n'
        )

    def test_the_printed_section_is_the_survey(self, desk, capsys, tmp_path):
        """What the service reads by way of it is what was drawn: area within the permit, without wreck and island."""
        desk(
            bay_plan=plan(inside=[PERMIT], outside=[WRECK]),
            coast_kml=kml("<Folder><name>Land</name>", placemark("Santa Rosa", ISLAND), "</Folder>"),
        )
        assert imported("bay.plan", "coast.kml") == 0
        section = capsys.readouterr().out.partition("survey:\n")[2]
        (tmp_path / "boat.yaml").write_text(f"survey:\n{section}  standoff_m: 0\n")
        survey = read_survey(load("boat.yaml", {}).survey)
        expected = (AREA & PERMIT) - WRECK - ISLAND
        on_earth_m2 = abs(Geod(ellps="WGS84").geometry_area_perimeter(expected)[0])
        assert survey.area_m2 == pytest.approx(on_earth_m2, rel=2e-3)
        assert not survey.contains(*survey.frame.to_local(33.0425, -118.9575))
        assert not survey.contains(*survey.frame.to_local(33.0625, -118.9375))
        assert main(["check-config", "boat.yaml"]) == 0

    def test_one_google_earth_file_by_its_names(self, desk):
        inside = [
            placemark("Survey area 2026", AREA),
            "<Folder><name>Keep-out</name>",
            placemark("wreck", WRECK),
            "</Folder>",
            placemark("Island: do not touch", ISLAND),
            placemark("KEEP_IN (permit)", PERMIT),
        ]
        buffer = io.BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            archive.writestr("doc.kml", kml(*inside))
        desk(bay_kmz=buffer.getvalue())
        assert imported("bay.kmz") == 0
        found = {
            each["properties"]["role"]: shapely.from_geojson(json.dumps(each["geometry"])) for each in read()
        }
        for role, shape in {"area": AREA, "keep_in": PERMIT, "keep_out": WRECK, "land": ISLAND}.items():
            assert found[role].symmetric_difference(shape).area < 1e-12
        assert [each["properties"].get("name") for each in read()][2:] == ["wreck", "Island: do not touch"]

    def test_roles_on_the_command_line_go_before_names(self, desk):
        desk(a_kml=kml(placemark("land of plenty", AREA)), b_geojson=shapely.geometry.mapping(ISLAND))
        assert imported("area=a.kml", "land=b.geojson") == 0
        assert [each["properties"]["role"] for each in read()] == ["area", "land"]

    def test_a_single_silent_file_is_the_area(self, desk):
        desk(a_kml=kml(placemark("Untitled Polygon", AREA)))
        assert imported("a.kml") == 0
        assert read_polygons(Path("survey.geojson"), "area").equals(AREA)

    def test_what_was_imported_is_imported_again(self, desk):
        desk(bay_plan=plan(inside=[PERMIT], outside=[WRECK]))
        assert imported("bay.plan") == 0
        first = read()
        assert main(["survey", "import", "survey.geojson", "--out", "again.geojson"]) == 0
        assert json.loads(Path("again.geojson").read_text())["features"] == first

    def test_keep_in_of_two_files_is_what_both_allow(self, desk):
        desk(
            a_plan=plan(inside=[PERMIT]), b_plan=plan(pattern=None, inside=[box(-118.97, 33.0, -118.9, 33.1)])
        )
        assert imported("a.plan", "b.plan") == 0
        keep_in = read_polygons(Path("survey.geojson"), "keep_in")
        assert keep_in.bounds == (-118.97, 33.0, -118.93, 33.1)

    def test_outer_rings_run_counterclockwise(self, desk):
        """RFC 7946, section 3.1.6."""
        desk(a_kml=kml(placemark("area", shapely.geometry.polygon.orient(AREA, -1.0))))
        assert imported("a.kml") == 0
        assert shapely.LinearRing(read()[0]["geometry"]["coordinates"][0]).is_ccw


BOW_TIE = shapely.Polygon([(-118.98, 33.02), (-118.92, 33.08), (-118.92, 33.02), (-118.98, 33.08)])


class TestMistakes:
    @pytest.mark.parametrize(
        ("files", "words", "said"),
        [
            ({"a_kml": kml(placemark("area", BOW_TIE))}, ["a.kml"], "Self-intersection"),
            ({"a_plan": plan(pattern=BOW_TIE)}, ["a.plan"], "rings must not cross themselves"),
            (
                {"a_kml": kml(placemark("one", AREA), placemark("two", ISLAND))},
                ["a.kml"],
                "overlap, and neither says what it is",
            ),
            (
                {"a_kml": kml(placemark("area", AREA), placemark("two", ISLAND))},
                ["a.kml"],
                "(two): what is it?",
            ),
            (
                {"a_kml": kml(placemark("one", AREA)), "b_kml": kml(placemark("two", ISLAND))},
                ["a.kml", "b.kml"],
                "write ROLE=a.kml ROLE=b.kml",
            ),
            ({"a_kml": kml(placemark("land", ISLAND))}, ["a.kml"], "nothing of this is a survey area"),
            ({"a_plan": {**plan(pattern=None)}}, ["a.plan"], "neither a survey pattern nor a fence"),
            (
                {"a_plan": plan(inside=[box(0, 0, 1, 1)])},
                ["a.plan"],
                "keep-in and the survey area do not overlap",
            ),
            (
                {"a_plan": plan(inside=[PERMIT, box(0, 0, 1, 1)])},
                ["a.plan"],
                "no area in common, and a vessel must stay inside all of them",
            ),
            (
                {"a_kml": kml(placemark("area", AREA), placemark("land", AREA.buffer(0.01)))},
                ["a.kml"],
                "no water is left",
            ),
            ({}, ["nowhere.kml"], "cannot be read"),
            ({"a_gpx": "<gpx/>"}, ["a.gpx"], "is GPX"),
            ({"a_kml": "<kml><Document>"}, ["a.kml"], "a.kml:1:"),
        ],
    )
    def test_what_is_wrong_is_said_and_nothing_is_written(self, desk, capsys, tmp_path, files, words, said):
        desk(**files)
        assert imported(*words) == 65
        err = capsys.readouterr().err
        assert said in err
        assert not (tmp_path / "survey.geojson").exists()

    def test_a_file_that_is_there_stays(self, desk, capsys):
        desk(a_kml=kml(placemark("area", AREA)), survey_geojson="mine")
        assert imported("a.kml") == 73
        assert "--replace" in capsys.readouterr().err
        assert Path("survey.geojson").read_text() == "mine"
        assert imported("a.kml", "--replace") == 0

    def test_usage(self, desk, capsys):
        assert imported() == 2
        with pytest.raises(SystemExit):
            imported("shore=a.kml")
        assert "'shore' is no role; one of area, keep_in, keep_out, land" in capsys.readouterr().err

    def test_a_role_that_one_feature_lacks(self, tmp_path):
        features = [
            {"type": "Feature", "properties": properties, "geometry": shapely.geometry.mapping(shape)}
            for properties, shape in (({"role": "area"}, AREA), ({"role": "keepout"}, WRECK))
        ]
        file = tmp_path / "a.geojson"
        file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        with pytest.raises(SurveyError, match=r'features\[1\]: has no "role"'):
            read_polygons(file, "area")
        features[1]["properties"] = {"role": "land"}
        file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        assert read_polygons(file, "land").equals(WRECK)
        with pytest.raises(SurveyError, match="no polygon in it has the role keep_out; there is area, land"):
            read_polygons(file, "keep_out")


class TestDoubts:
    @pytest.mark.parametrize(
        ("start", "said"),
        [
            ("33.03,-118.97", ""),
            ("33.0425,-118.9575", "on land or in keep-out"),
            ("33.0455,-118.9575", "nearer to land or keep-out"),
            ("33.01,-118.97", "outside the survey area"),
        ],
    )
    def test_the_start(self, desk, capsys, start, said):
        desk(a_kml=kml(placemark("area", AREA), placemark("land", ISLAND)))
        assert imported("a.kml", f"--start={start}") == 0
        err = capsys.readouterr().err
        assert said in err if said else err == ""

    def test_a_shore_of_kilometre_cells(self, desk, capsys):
        cells = [box(-118.95 + 0.01 * k, 33.05, -118.94 + 0.01 * k, 33.06 + 0.01 * (k % 3)) for k in range(9)]
        shore = shapely.union_all(cells)
        desk(area_kml=kml(placemark("area", AREA)), land_geojson=shapely.geometry.mapping(shore))
        assert imported("area.kml", "land=land.geojson") == 0
        assert "cells of about 9" in capsys.readouterr().err

    @pytest.mark.parametrize("seed", range(4))
    def test_drawn_shores_are_no_cells(self, seed):
        rng = np.random.default_rng(seed)
        angle = np.linspace(0.0, 2 * np.pi, 60, endpoint=False)
        radius = 0.02 * (1 + 0.3 * rng.random(60))
        shore = shapely.Polygon(
            np.column_stack([radius * np.cos(angle) - 118.95, radius * np.sin(angle) + 33.05])
        )
        assert stair_m(shore, LocalFrame(33.05, -118.95)) is None
        assert stair_m(AREA, LocalFrame(33.05, -118.95)) is None

    def test_a_permit_that_cuts_the_area(self, desk, capsys):
        """Five sixths of the degrees of longitude that the area has lie west of the permit's eastern edge."""
        desk(bay_plan=plan(inside=[PERMIT]))
        assert imported("bay.plan") == 0
        assert "keep-in leaves 83% of the area" in capsys.readouterr().err

    def test_water_in_two_parts(self, desk, capsys):
        wall = box(-118.951, 33.0, -118.949, 33.1)
        desk(a_kml=kml(placemark("area", AREA), placemark("land", wall)))
        assert imported("a.kml") == 0
        assert "in 2 parts that do not touch" in capsys.readouterr().err


CIRCLE = Zone(True, ((33.05, -118.95),), 3000.0)
POLYGON = Zone(True, ((33.02, -118.98), (33.02, -118.92), (33.08, -118.92), (33.08, -118.98)))


class TestFence:
    def test_all_groups_hold_any_zone_of_a_group(self):
        both = sketch([], fence_drawn([(CIRCLE,), (POLYGON,)], []))
        either = sketch([], fence_drawn([(CIRCLE, POLYGON)], []))
        assert both.shape("area").area < AREA.area < either.shape("area").area
        assert both.shape("area").equals(both.shape("keep_in"))
        assert "all that lies inside the fence" in both.notes[0]

    def test_from_a_vehicle(self, desk, capsys):
        """Over a real socket, by the mission protocol."""
        autopilot = Autopilot(Vessel(Position(33.03, -118.97)), None, Options())
        inside, outside = [
            [fence_vertex(lat, lon, command) for lat, lon in corners(shape)]
            for shape, command in (
                (AREA, mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION),
                (WRECK, mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION),
            )
        ]
        autopilot.store.fence[:] = [*inside, *outside]
        autopilot.parameters.set("FENCE_TYPE", 4)
        with served(autopilot) as port:
            assert imported("--from-vehicle", f"udpout:127.0.0.1:{port}") == 0
        found = sketch([(None, Path("survey.geojson"))])
        assert found.shape("area").symmetric_difference(AREA).area < 1e-10
        assert found.shape("keep_out").symmetric_difference(WRECK).area < 1e-10
        assert "fence, exclusion: 4 corners" in capsys.readouterr().out


def fence_vertex(lat, lon, command):
    place = MissionItem.at(Position(lat, lon))
    return MissionItem(place.frame, command, (4.0, 0.0, 0.0, 0.0), place.x, place.y, 0.0)
