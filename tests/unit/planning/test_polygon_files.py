"""Plans of QGroundControl, KML and KMZ of Google Earth: what is read of them, and what is said of mistakes."""

import io
import json
import zipfile

import numpy as np
import pytest
import shapely
from pyproj import Geod
from shapely.geometry import box

from autonomy.config import SurveySection
from autonomy.planning.polygon_files import read_polygons
from autonomy.planning.survey import SurveyError, read_survey

# As QGroundControl 4.4 writes it, shortened.
PLAN = {
    "fileType": "Plan",
    "geoFence": {
        "circles": [
            {"circle": {"center": [33.06, -118.95], "radius": 1000.0}, "inclusion": False, "version": 1},
            {"circle": {"center": [33.05, -118.95], "radius": 9000.0}, "inclusion": True, "version": 1},
        ],
        "polygons": [
            {
                "inclusion": True,
                "polygon": [[33.0, -119.0], [33.1, -119.0], [33.1, -118.9], [33.0, -118.9]],
                "version": 1,
            },
            {
                "inclusion": False,
                "polygon": [[33.0, -119.0], [33.02, -119.0], [33.02, -118.98]],
                "version": 1,
            },
        ],
        "version": 2,
    },
    "groundStation": "QGroundControl",
    "mission": {
        "firmwareType": 3,
        "items": [
            {"type": "SimpleItem", "command": 16, "params": [0, 0, 0, None, 33.01, -118.99, 0]},
            {
                "type": "ComplexItem",
                "complexItemType": "survey",
                "angle": 40,
                "polygon": [[33.02, -118.98], [33.08, -118.98], [33.08, -118.92], [33.02, -118.92]],
                "version": 5,
            },
            {"type": "ComplexItem", "complexItemType": "CorridorScan", "polyline": [[33.0, -118.0]]},
        ],
        "plannedHomePosition": [33.0, -119.0, 0],
    },
    "rallyPoints": {"points": [], "version": 2},
    "version": 1,
}

# As Google Earth Pro 7.3 writes it, shortened: styles, folders, altitude tags, two holes.
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"
     xmlns:kml="http://www.opengis.net/kml/2.2" xmlns:atom="http://www.w3.org/2005/Atom">
<Document><name>coast.kml</name>
  <Style id="s"><PolyStyle><color>7f0000ff</color></PolyStyle></Style>
  <Folder><name>land &amp; rocks</name>
    <Placemark><name>pin</name><Point><coordinates>-118.95,33.05,0</coordinates></Point></Placemark>
    <Placemark><name>mainland</name><styleUrl>#s</styleUrl>
      <Polygon><extrude>1</extrude><tessellate>1</tessellate><altitudeMode>relativeToGround</altitudeMode>
        <outerBoundaryIs><LinearRing><coordinates>
          -119,33,10.5 -118.9,33,10.5
          -118.9,33.1,10.5 -119,33.1,10.5 -119,33,10.5
        </coordinates></LinearRing></outerBoundaryIs>
        <innerBoundaryIs><LinearRing><coordinates>-118.98,33.02 -118.96,33.02 -118.96,33.04 -118.98,33.02
        </coordinates></LinearRing></innerBoundaryIs>
        <innerBoundaryIs><LinearRing><coordinates>-118.94,33.06 -118.92,33.06 -118.92,33.08 -118.94,33.06
        </coordinates></LinearRing></innerBoundaryIs>
      </Polygon></Placemark>
    <Placemark><visibility>0</visibility><MultiGeometry>
      <Polygon><outerBoundaryIs><LinearRing><coordinates>
        -118.8,33,0 -118.79,33,0 -118.79,33.01,0 -118.8,33,0</coordinates></LinearRing></outerBoundaryIs></Polygon>
      <MultiGeometry><Polygon><outerBoundaryIs><LinearRing><coordinates>
        -118.7,33,0 -118.69,33,0 -118.69,33.01,0 -118.7,33,0</coordinates></LinearRing></outerBoundaryIs></Polygon>
      </MultiGeometry></MultiGeometry></Placemark>
  </Folder>
</Document></kml>"""

RING = "<LinearRing><coordinates>0,0 1,0 1,1 0,0</coordinates></LinearRing>"
POLYGON = f"<Polygon><outerBoundaryIs>{RING}</outerBoundaryIs></Polygon>"
SQUARE = [(33.0, -119.0), (33.0, -118.9), (33.1, -118.9), (33.1, -119.0)]


def kmz(members, **options):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, **options) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


@pytest.fixture
def write(tmp_path):
    def to_file(name, content):
        path = tmp_path / name
        if isinstance(content, dict):
            content = json.dumps(content)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return to_file


def changed(*steps, to):
    plan = json.loads(json.dumps(PLAN))
    place = plan
    for step in steps[:-1]:
        place = place[step]
    place[steps[-1]] = to
    return plan


class TestPlan:
    def test_the_area_is_the_survey_patterns(self, write):
        shape = read_polygons(write("bay.plan", PLAN), "area")
        assert shape.equals(box(-118.98, 33.02, -118.92, 33.08))

    def test_without_a_pattern_the_area_is_what_all_inclusion_zones_share(self, write):
        shape = read_polygons(write("bay.plan", changed("mission", "items", to=[])), "area")
        assert shape.equals(read_polygons(write("fence.plan", PLAN), "keep_in"))

    def test_keep_in_lies_inside_every_inclusion_zone(self, write):
        """Circles against the ellipsoid's own distances, which the reader does not use."""
        shape = read_polygons(write("bay.plan", PLAN), "keep_in")
        corners = shapely.get_coordinates(shape)
        assert np.all(box(-119, 33, -118.9, 33.1).buffer(1e-9).covers(shapely.points(corners)))
        distance = Geod(ellps="WGS84").inv(
            corners[:, 0],
            corners[:, 1],
            np.full(len(corners), -118.95),
            np.full(len(corners), 33.05),
        )[2]
        assert distance.max() <= 9000.0 + 1e-3

    def test_keep_out_covers_every_exclusion_zone(self, write):
        shape = read_polygons(write("bay.plan", PLAN), "keep_out")
        bearing = np.linspace(0, 360, 500)
        lon, lat, _ = Geod(ellps="WGS84").fwd(
            np.full(500, -118.95), np.full(500, 33.06), bearing, np.full(500, 999.9)
        )
        assert np.all(shape.covers(shapely.points(lon, lat)))
        assert shape.covers(box(-118.999, 33.001, -118.9989, 33.0011)) is False
        assert shape.covers(shapely.Point(-118.99, 33.015))
        assert shape.equals(read_polygons(write("again.plan", PLAN), "land"))

    def test_a_plan_is_known_by_its_content(self, write):
        assert read_polygons(write("bay.json", PLAN), "area").equals(
            read_polygons(write("bay.plan", PLAN), "area")
        )

    def test_a_whole_survey_from_one_plan(self, write):
        path = write("bay.plan", PLAN)
        survey = read_survey(SurveySection(area=path, keep_in=path, keep_out=path, standoff_m=0.0))
        assert not survey.contains(*survey.frame.to_local(33.06, -118.95))
        assert survey.contains(*survey.frame.to_local(33.03, -118.95))

    def test_a_circle_at_the_date_line_stays_in_one_piece(self, write):
        circle = {"circle": {"center": [-17.0, 179.99], "radius": 5000.0}, "inclusion": True}
        plan = {"fileType": "Plan", "geoFence": {"circles": [circle]}}
        west, _, east, _ = read_polygons(write("a.plan", plan), "keep_in").bounds
        assert east - west == pytest.approx(0.094, abs=0.002)
        assert east > 180.0

    @pytest.mark.parametrize(
        ("plan", "role", "message"),
        [
            (changed("fileType", to="Mission"), "area", "no QGroundControl plan"),
            (changed("geoFence", to=[]), "keep_in", '"geoFence" is not an object'),
            (changed("geoFence", to=None), "keep_in", "has no inclusion zone"),
            (changed("geoFence", to={}), "keep_out", "has no exclusion zone"),
            ({"fileType": "Plan"}, "area", "neither a survey pattern nor an inclusion fence"),
            (changed("geoFence", "circles", to=3), "keep_in", "geoFence.circles is not a list"),
            (changed("geoFence", "circles", 1, "inclusion", to=1), "keep_in", r"circles\[1\]: .*inclusion"),
            (
                changed("geoFence", "circles", 1, "circle", "radius", to=-5),
                "keep_in",
                r"circles\[1\]: its radius is -5",
            ),
            (
                changed("geoFence", "circles", 1, "circle", "center", to=[90.0, 0.0]),
                "keep_in",
                "too near the pole",
            ),
            (
                changed("geoFence", "circles", 1, "circle", "center", to=[-33.0, 19.0]),
                "keep_in",
                "no area in common",
            ),
            (
                changed("geoFence", "polygons", 0, "polygon", 2, to=[-118.9, 33.1]),
                "keep_in",
                r"polygons\[0\], corner 2: .*latitude first",
            ),
            (
                changed("geoFence", "polygons", 0, "polygon", to=[[0, 0], [0, 1]]),
                "keep_in",
                "at least three",
            ),
            (
                changed("mission", "items", 1, "polygon", to=[[0, 0], [1, 1], [0, 1], [1, 0]]),
                "area",
                r"items\[1\] \(survey\): is not a valid polygon",
            ),
            (
                changed("mission", "items", 1, "polygon", 0, to=[10**400, 0]),
                "area",
                "corner 0: .* is not a position",
            ),
        ],
    )
    def test_mistakes_are_named(self, write, plan, role, message):
        path = write("bay.plan", plan)
        with pytest.raises(SurveyError, match=message) as caught:
            read_polygons(path, role)
        assert str(path) in str(caught.value)


class TestKml:
    def test_what_google_earth_writes(self, write):
        shape = read_polygons(write("coast.kml", KML), "land")
        islets = [shapely.Polygon([(x, 33), (x + 0.01, 33), (x + 0.01, 33.01)]) for x in (-118.8, -118.7)]
        mainland = box(-119, 33, -118.9, 33.1)
        for x, y in ((-118.98, 33.02), (-118.94, 33.06)):
            mainland -= shapely.Polygon([(x, y), (x + 0.02, y), (x + 0.02, y + 0.02)])
        assert shape.symmetric_difference(shapely.union_all([mainland, *islets])).area < 1e-12

    @pytest.mark.parametrize("name", ["coast.kml", "coast.dat"])
    @pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
    def test_encodings_and_names(self, write, name, encoding):
        text = KML.replace('encoding="UTF-8"', 'encoding="UTF-16"') if encoding == "utf-16" else KML
        assert read_polygons(write(name, text.encode(encoding)), "land").area > 0.009

    @pytest.mark.parametrize("declaration", ["", ' xmlns="http://earth.google.com/kml/2.1"'])
    def test_any_namespace_or_none(self, write, declaration):
        text = f"<kml{declaration}><Placemark>{POLYGON}</Placemark></kml>"
        assert read_polygons(write("a.kml", text), "land").area == pytest.approx(0.5)

    def test_prefixes(self, write):
        text = f"<kml><Placemark>{POLYGON}</Placemark></kml>".replace("<", "<k:").replace("<k:/", "</k:")
        assert read_polygons(write("a.kml", text), "land").area == pytest.approx(0.5)

    def test_all_holes_in_one_boundary(self, write):
        holes = "".join(
            f"<LinearRing><coordinates>{x},.1 {x + 0.1},.1 {x + 0.1},.2 {x},.1</coordinates></LinearRing>"
            for x in (0.5, 0.7)
        )
        inside = f"</outerBoundaryIs><innerBoundaryIs>{holes}</innerBoundaryIs>"
        text = f"<kml>{POLYGON.replace('</outerBoundaryIs>', inside)}</kml>"
        assert read_polygons(write("a.kml", text), "land").area == pytest.approx(0.49)

    def test_an_archive(self, write):
        members = {"files/other.kml": "<kml/>", "doc.kml": KML, "files/icon.png": b"\x89PNG"}
        plain = read_polygons(write("coast.kml", KML), "land")
        assert read_polygons(write("coast.kmz", kmz(members)), "land").equals(plain)
        assert read_polygons(write("coast.bin", kmz({"a.KML": KML})), "land").equals(plain)

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("<kml>", r"a\.kml:1:6: is not well-formed KML: no element found"),
            ("<gpx/>", "outermost element is gpx"),
            ("<kml/>", "has no polygon in it; "),
            ("<kml><NetworkLink/></kml>", "holds a NetworkLink, which is not followed"),
            ("<!DOCTYPE kml><kml/>", "1: has a DOCTYPE"),
            ("<kml>\n<LineString/></kml>", "2: the LineString has 0 coordinates"),
            ("<kml><Track/></kml>", "holds a Track; a closed Polygon"),
            ("<kml>" * 60, "more than 50 deep"),
            ("<kml><Polygon/></kml>", "has 0 outerBoundaryIs"),
            (
                f"<kml>{POLYGON}<Polygon><outerBoundaryIs>{RING}{RING}</outerBoundaryIs></Polygon></kml>",
                "2 LinearRings",
            ),
            (f"<kml>{POLYGON.replace(RING, '<LinearRing/>')}</kml>", "0 coordinates elements"),
            (f"<kml>{POLYGON.replace('1,1', '1;1')}</kml>", r"position 2: '1;1' is not longitude,latitude"),
            (f"<kml>{POLYGON.replace('1,1', '1, 1')}</kml>", "position 2: '1,' is not"),
            (f"<kml>{POLYGON.replace('1,1', '1,nan')}</kml>", "nan is no latitude"),
            (f"<kml>{POLYGON.replace('1,1', '33,-118')}</kml>", "-118 is no latitude; KML has the longitude"),
            (f"<kml>{POLYGON.replace('1,1 0,0', '1,1 0,1')}</kml>", "is not closed"),
            (f"<kml>{POLYGON.replace(' 1,1', '')}</kml>", "at least four"),
            (f"<kml>{POLYGON.replace('0,0 1,0 1,1', '0,0 1,1 1,0 0,1')}</kml>", "cross"),
            ('<?xml version="1.0" encoding="klingon"?><kml/>', "unknown encoding"),
            ('<?xml version="1.0" encoding="UTF-7"?><kml/>', "unknown encoding"),
        ],
    )
    def test_mistakes_are_named(self, write, text, message):
        path = write("a.kml", text)
        with pytest.raises(SurveyError, match=message) as caught:
            read_polygons(path, "land")
        assert str(path) in str(caught.value)

    def test_swelling_entities_are_not_read(self, write):
        laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
        text = f'<!DOCTYPE k [<!ENTITY l0 "ha">{laughs}]><kml>&l9;</kml>'
        with pytest.raises(SurveyError, match="DOCTYPE"):
            read_polygons(write("a.kml", text), "land")
        with pytest.raises(SurveyError, match="undefined entity"):
            read_polygons(write("b.kml", "<kml>&file;</kml>"), "land")

    def test_an_archive_that_swells_is_given_up(self, write):
        archive = kmz({"doc.kml": b"<kml>" + b" " * 33_000_000})
        assert len(archive) < 100_000
        with pytest.raises(SurveyError, match="larger than 32 MB unpacked"):
            read_polygons(write("a.kmz", archive), "land")

    @pytest.mark.parametrize("data", [b"", b"PK\x03\x04", kmz({"a.txt": "x"}), kmz({"doc.kml": KML})[:-30]])
    def test_broken_archives(self, write, data):
        with pytest.raises(SurveyError, match="archive"):
            read_polygons(write("a.kmz", data), "land")


class TestAnyFile:
    @pytest.mark.parametrize(
        ("name", "content", "message"),
        [
            ("land.shp", b"\x00\x00\x27\x0a", "is a shapefile; GeoJSON, a QGroundControl .plan, KML or KMZ"),
            ("land.bin", b"\xff\x00", "is not UTF-8 text"),
            ("land.json", "[" * 100_000, "nested too deeply|has no|is not JSON"),
            ("land.json", "[" * 2_000_001, "more than 2000000 positions"),
            ("land.json", '{"type": ' + "9" * 5000 + "}", "number that cannot be read"),
            ("land.plan", "{}", '"fileType": "Plan" is missing'),
        ],
    )
    def test_mistakes_are_named(self, write, name, content, message):
        with pytest.raises(SurveyError, match=message):
            read_polygons(write(name, content), "land")

    def test_too_large(self, tmp_path):
        path = tmp_path / "world.geojson"
        with path.open("wb") as file:
            file.truncate(32_000_001)
        with pytest.raises(SurveyError, match="larger than 32 MB"):
            read_polygons(path, "land")

    def test_a_byte_order_mark_is_no_mistake(self, write):
        text = json.dumps(shapely.geometry.mapping(box(0, 0, 1, 1)))
        assert read_polygons(write("a.geojson", b"\xef\xbb\xbf" + text.encode()), "land").area == 1.0

    def test_the_same_water_whatever_the_format(self, write):
        corners = [[lat, lon] for lat, lon in SQUARE]
        ring = " ".join(f"{lon},{lat},0" for lat, lon in [*SQUARE, SQUARE[0]])
        text = f"<kml>{POLYGON.replace('0,0 1,0 1,1 0,0', ring)}</kml>"
        item = {"complexItemType": "survey", "polygon": corners}
        files = [
            write("a.kml", text),
            write("a.kmz", kmz({"doc.kml": text})),
            write("a.plan", {"fileType": "Plan", "mission": {"items": [item]}}),
            write("a.geojson", json.dumps(shapely.geometry.mapping(box(-119.0, 33.0, -118.9, 33.1)))),
        ]
        surveys = [read_survey(SurveySection(area=area)) for area in (*files, SQUARE)]
        for survey in surveys[:-1]:
            assert survey.frame == surveys[-1].frame
            assert survey.navigable.symmetric_difference(surveys[-1].navigable).area < 1e-3
