"""Survey areas from polygons and from GeoJSON files."""

import json
import pickle
from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapely.geometry import box, mapping

from autonomy.config import SurveySection
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea, SurveyError, read_survey

FRAME = LocalFrame(33.0, -119.0)
SQUARE = [(33.0, -119.0), (33.0, -118.9), (33.1, -118.9), (33.1, -119.0)]
"""Corners as the configuration has them: latitude, longitude."""


def area(**given):
    return SurveyArea.from_geometry(FRAME, box(0, 0, 1000, 800), **given)


class TestGeometry:
    def test_open_water(self):
        survey = area()
        assert survey.bounds == (0.0, 0.0, 1000.0, 800.0)
        assert survey.span_m == 1000.0
        assert survey.area_m2 == pytest.approx(800_000.0)
        assert survey.contains(500, 400)
        assert survey.contains(0, 0)
        assert not survey.contains(-1, 400)

    def test_land_keep_out_and_the_outside_of_keep_in_are_no_water(self):
        survey = area(land=box(0, 0, 200, 200), keep_out=box(400, 400, 500, 500), keep_in=box(0, 0, 800, 800))
        assert survey.bounds == (0.0, 0.0, 800.0, 800.0)
        assert survey.area_m2 == pytest.approx(800 * 800 - 200 * 200 - 100 * 100)
        for x, y in [(100, 100), (450, 450), (900, 400)]:
            assert not survey.contains(x, y)
        assert survey.contains(300, 300)

    def test_the_stand_off_keeps_the_vessel_from_land_and_keep_out_but_not_from_the_areas_edge(self):
        survey = area(land=box(0, 0, 200, 800), keep_out=box(600, 0, 700, 100), standoff_m=50.0)
        assert survey.navigable.distance(box(0, 0, 200, 800)) == pytest.approx(50.0, rel=0.01)
        assert survey.navigable.distance(box(600, 0, 700, 100)) >= 50.0 - 1e-9
        assert survey.navigable.bounds[2:] == (1000.0, 800.0)
        assert survey.contains(210, 400)
        assert not survey.is_navigable([[210, 400]])[0]

    def test_a_point_on_an_edge_is_navigable_whatever_its_last_digits(self):
        """The ends of a line clipped to the water lie on either side of an edge that is neither east nor north."""
        survey = area(land=shapely.Point(500, 400).buffer(150.0), standoff_m=40.0)
        edge = survey.navigable.interiors[0]
        ends = shapely.get_coordinates(edge.interpolate(np.linspace(0.0, 1.0, 97), normalized=True))
        assert not shapely.covers(survey.navigable, shapely.points(ends)).all()
        assert survey.is_navigable(ends).all()
        assert survey.legs_are_clear(ends, ends).all()
        centre = np.array([500.0, 400.0])
        assert not survey.is_navigable(ends + (centre - ends) * 1e-4).any()

    def test_land_beyond_the_area_keeps_its_distance_too(self):
        survey = area(land=box(-100, 0, -10, 800), standoff_m=50.0)
        assert survey.navigable.bounds[0] >= 40.0

    def test_legs(self):
        survey = area(land=box(400, 300, 600, 500))
        assert survey.leg_is_clear((100, 100), (900, 100))
        assert not survey.leg_is_clear((100, 400), (900, 400))
        assert not survey.leg_is_clear((100, 100), (100, 900))
        assert not survey.leg_is_clear((450, 400), (460, 400))
        assert survey.leg_is_clear((100, 100), (100, 100))
        assert not survey.leg_is_clear((500, 400), (500, 400))

    def test_a_leg_across_a_spit_of_a_metre_is_not_clear(self):
        assert not area(land=box(500, 0, 501, 790)).leg_is_clear((100, 400), (900, 410))

    def test_a_leg_along_a_shore_is_clear_despite_round_off(self):
        tilted = shapely.affinity.rotate(box(0, 0, 1000, 800), 33.3, origin=(0, 0))
        survey = SurveyArea.from_geometry(FRAME, tilted)
        corners = shapely.get_coordinates(tilted)
        for a, b in pairwise(corners):
            third = a + (b - a) / 3
            assert survey.leg_is_clear(third, a + (b - a) * 0.7)
            outward = (third - np.array(tilted.centroid.coords[0])) * 1e-3
            assert not survey.leg_is_clear(third, third + outward)

    def test_a_vessel_in_the_stand_off_or_outside_may_come_in_but_not_over_land(self):
        survey = area(land=box(0, 0, 200, 800), standoff_m=50.0)
        assert survey.approach_is_clear((210, 400), (260, 400))
        assert survey.approach_is_clear((500, -30), (500, 20))
        assert not survey.approach_is_clear((-50, 400), (260, 400))
        assert not survey.approach_is_clear((210, 400), (230, 400))

    def test_candidate_sites_are_cell_centres_over_water(self):
        sites = area(land=box(0, 0, 500, 800)).candidate_sites(4, 2)
        assert sites.tolist() == [[625, 200], [875, 200], [625, 600], [875, 600]]

    def test_a_pond_holds_no_site_but_a_second_basin_does(self):
        land = box(0, 0, 600, 800) - box(100, 100, 106, 106) - box(200, 300, 400, 500)
        survey = area(land=land, passage_cells=100)
        sites = survey.candidate_sites(500, 400)
        inside = sites[sites[:, 0] < 600]
        assert len(inside) == 100 * 100
        assert np.all((inside > [200, 300]) & (inside < [400, 500]))

    def test_no_site_in_a_lattice_that_misses_the_water(self):
        assert area(land=box(0, 0, 900, 800)).candidate_sites(2, 2).shape == (0, 2)

    def test_pickling_keeps_everything(self):
        survey = area(land=box(400, 300, 600, 500), standoff_m=20.0, passage_cells=77)
        survey.leg_is_clear((0, 0), (1, 1))
        again = pickle.loads(pickle.dumps(survey))
        assert again.navigable.equals(survey.navigable)
        assert (again.bounds, again.passage_cells, again.frame) == (survey.bounds, 77, survey.frame)
        assert not again.leg_is_clear((100, 400), (900, 400))

    @pytest.mark.parametrize(
        ("given", "message"),
        [
            ({"land": box(-1, -1, 1001, 801)}, "land, shallows and keep-out cover"),
            ({"land": box(450, 0, 550, 800), "standoff_m": 500.0}, "no navigable water"),
            ({"keep_in": box(2000, 0, 3000, 100)}, "do not overlap"),
            ({"keep_in": shapely.Polygon()}, "keep-in is empty"),
            ({"land": shapely.LineString([(0, 0), (1, 1)])}, "LineString"),
            ({"land": shapely.Polygon([(0, 0), (100, 100), (100, 0), (0, 100)])}, "not a valid polygon"),
            ({"standoff_m": -1.0}, "stand-off"),
            ({"standoff_m": float("nan")}, "stand-off"),
        ],
    )
    def test_nonsense_is_refused(self, given, message):
        with pytest.raises(SurveyError, match=message):
            area(**given)


class TestReading:
    @pytest.fixture
    def write(self, tmp_path):
        def to_file(content, name="land.geojson"):
            path = tmp_path / name
            path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
            return path

        return to_file

    def test_corners_of_the_configuration(self):
        survey = read_survey(SurveySection(area=SQUARE, standoff_m=0.0))
        assert survey.frame == LocalFrame(33.05, -118.95)
        assert survey.contains(0.0, 0.0)
        # Area of a latitude-longitude rectangle on the ellipsoid: 9334.6 m × 11091.4 m at its middle.
        assert survey.area_m2 == pytest.approx(9334.6 * 11091.4, rel=2e-3)

    @pytest.mark.parametrize("wrap", ["geometry", "feature", "collection"])
    def test_forms_of_a_file(self, write, wrap):
        geometry = mapping(box(-119.0, 33.0, -118.95, 33.1))
        feature = {"type": "Feature", "properties": None, "geometry": geometry}
        content = {
            "geometry": geometry,
            "feature": feature,
            "collection": {"type": "FeatureCollection", "features": [feature, feature]},
        }[wrap]
        survey = read_survey(SurveySection(area=SQUARE, land=write(content), standoff_m=0.0))
        whole = read_survey(SurveySection(area=SQUARE, standoff_m=0.0))
        assert survey.area_m2 == pytest.approx(whole.area_m2 / 2, rel=1e-5)
        assert not survey.contains(-100.0, 0.0)
        assert survey.contains(100.0, 0.0)

    def test_multipolygons_holes_and_altitudes(self, write):
        with_hole = box(-119.0, 33.0, -118.9, 33.05) - box(-118.97, 33.02, -118.93, 33.03)
        content = mapping(
            shapely.force_3d(shapely.MultiPolygon([with_hole, box(-118.92, 33.08, -118.9, 33.1)]), 7.0)
        )
        survey = read_survey(SurveySection(area=SQUARE, land=write(content), standoff_m=0.0))
        x, y = survey.frame.to_local(33.025, -118.95)
        assert survey.contains(x, y)
        x, y = survey.frame.to_local(33.09, -118.91)
        assert not survey.contains(x, y)

    def test_the_area_from_a_file_equals_its_corners(self, write):
        path = write(mapping(box(-119.0, 33.0, -118.9, 33.1)), "area.geojson")
        a = read_survey(SurveySection(area=path))
        b = read_survey(SurveySection(area=SQUARE))
        assert a.frame == b.frame
        assert a.navigable.symmetric_difference(b.navigable).area < 1e-3

    def test_no_land_is_an_answer_but_no_area_is_not(self, write):
        nothing = write({"type": "FeatureCollection", "features": []})
        assert read_survey(SurveySection(area=SQUARE, land=nothing)).contains(0, 0)
        with pytest.raises(SurveyError, match="has no polygon"):
            read_survey(SurveySection(area=nothing))

    def test_a_coast_of_the_whole_world_is_cut_to_the_survey(self, write):
        world = box(-180, -90, 180, 90) - box(-125, 31, -118.95, 36)
        survey = read_survey(SurveySection(area=SQUARE, land=write(mapping(world)), standoff_m=0.0))
        assert survey.obstacles.bounds[2] < 50_000
        assert survey.contains(-100, 0)
        assert not survey.contains(100, 0)

    def test_edges_follow_the_parallel_as_in_the_file(self, write):
        wide = [(33.0, -121.0), (33.0, -117.0), (34.0, -117.0), (34.0, -121.0)]
        survey = read_survey(SurveySection(area=wide, standoff_m=0.0))
        just_inside = survey.frame.to_local(33.0 + 1e-5, -119.0)
        assert survey.contains(*just_inside)
        assert not survey.contains(*survey.frame.to_local(33.0 - 1e-5, -119.0))

    def test_a_survey_across_the_date_line(self, write):
        corners = [(-17.0, 179.9), (-17.0, 180.1), (-16.9, 180.1), (-16.9, 179.9)]
        survey = read_survey(SurveySection(area=corners))
        assert survey.span_m == pytest.approx(21_300, rel=0.01)
        with pytest.raises(SurveyError, match="0 to 360"):
            read_survey(SurveySection(area=write(mapping(box(-179.9, -17.0, 179.9, -16.9)))))

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            ("{", r"land\.geojson:1:2: is not JSON"),
            ("[1, 2]", "not GeoJSON"),
            ({"type": "Point", "coordinates": [1, 2]}, "is Point; a Polygon"),
            ({"type": "FeatureCollection"}, 'no list "features"'),
            ({"type": "FeatureCollection", "features": [3]}, r"features\[0\] is not an object"),
            (
                {"type": "Feature", "id": "pier", "geometry": None},
                r"the feature \(pier\): its geometry is missing",
            ),
            ({"type": "Polygon", "coordinates": []}, "list of rings"),
            ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [0, 0]]]}, "ring 0: needs at least four"),
            ({"type": "Polygon", "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1]]]}, "not closed"),
            ({"type": "Polygon", "coordinates": [[[0, "a"], [1, 0], [1, 1], [0, 0]]]}, "position 0"),
            (
                {"type": "Polygon", "coordinates": [[[33, -118], [33, -119], [34, -119], [33, -118]]]},
                "no latitude",
            ),
            ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]]}, "cross"),
            ({"type": "Polygon", "crs": {"name": "EPSG:32611"}, "coordinates": []}, "EPSG:4326"),
        ],
    )
    def test_mistakes_in_files_are_named(self, write, content, message):
        path = write(content)
        with pytest.raises(SurveyError, match=message) as caught:
            read_survey(SurveySection(area=SQUARE, land=path))
        assert str(path) in str(caught.value)

    def test_the_mistaken_feature_is_named(self, write):
        good = {"type": "Feature", "properties": {"name": "mainland"}, "geometry": mapping(box(0, 0, 1, 1))}
        bad = {"type": "Feature", "properties": {"name": "islet"}, "geometry": {"type": "LineString"}}
        with pytest.raises(SurveyError, match=r"features\[1\] \(islet\): its geometry is LineString"):
            read_survey(
                SurveySection(area=SQUARE, land=write({"type": "FeatureCollection", "features": [good, bad]}))
            )

    def test_swapped_coordinates_that_are_still_on_earth_are_noticed(self, write):
        oslo = [(59.8, 10.5), (59.8, 10.7), (59.9, 10.7), (59.9, 10.5)]
        swapped = mapping(box(59.8, 10.5, 59.85, 10.6))
        with pytest.raises(SurveyError, match="longitude first"):
            read_survey(SurveySection(area=oslo, land=write(swapped)))

    def test_missing_file(self, tmp_path):
        with pytest.raises(SurveyError, match="cannot be read"):
            read_survey(SurveySection(area=SQUARE, land=tmp_path / "none.geojson"))
