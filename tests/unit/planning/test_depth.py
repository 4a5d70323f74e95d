"""Shallows out of ESRI ASCII grids."""

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from autonomy.config import SurveySection
from autonomy.planning.depth import shallow_water
from autonomy.planning.survey import SurveyError, read_survey

SQUARE = [(33.0, -119.0), (33.0, -118.9), (33.1, -118.9), (33.1, -119.0)]
AREA = (-119.0, 33.0, -118.9, 33.1)
CELL = 0.01


def text_of(heights, *, west=-119.02, south=32.98, head=None, nodata=-9999):
    head = head or f"xllcorner {west}\nyllcorner {south}\ncellsize {CELL}\nNODATA_value {nodata}\n"
    body = "\n".join(" ".join(f"{h:g}" for h in row) for row in heights)
    return f"ncols {heights.shape[1]}\nnrows {heights.shape[0]}\n{head}{body}\n"


@pytest.fixture
def write(tmp_path):
    def to_file(text, name="depth.asc"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return to_file


def heights(seed=0):
    return np.round(np.random.default_rng(seed).uniform(-20, 5, (14, 14)), 1)


@pytest.mark.parametrize("seed", range(3))
def test_exactly_the_cells_with_too_little_water_are_shallow(write, seed):
    z = heights(seed)
    z[3, 4] = -9999
    shape = shallow_water(write(text_of(z)), AREA, AREA, 7.5, "up")
    for row in range(14):
        for column in range(14):
            lon, lat = -119.02 + (column + 0.5) * CELL, 32.98 + (13.5 - row) * CELL
            expected = z[row, column] == -9999 or -z[row, column] < 7.5
            if AREA[0] < lon < AREA[2] and AREA[1] < lat < AREA[3]:
                assert shape.covers(shapely.Point(lon, lat)) == expected


def test_depths_count_downwards_when_told_so(write):
    z = heights()
    up = shallow_water(write(text_of(z)), AREA, AREA, 3.0, "up")
    down = shallow_water(write(text_of(-z), "d.asc"), AREA, AREA, 3.0, "down")
    assert up.equals(down)


def test_centres_corners_and_two_cell_sizes_say_the_same(write):
    z = heights()
    corner = shallow_water(write(text_of(z)), AREA, AREA, 3.0, "up")
    for head in (
        "XLLCENTER -119.015\nYLLCENTER 32.985\nCELLSIZE 0.01\n",
        "xllcorner -119.02\nyllcorner 32.98\ndx 0.01\ndy 0.01\n",
        "xllcorner 240.98\nyllcorner 32.98\ncellsize 0.01\n",
    ):
        other = shallow_water(write(text_of(z, head=head), "c.asc"), AREA, AREA, 3.0, "up")
        assert corner.symmetric_difference(other).intersection(box(*AREA)).area < 1e-9


def test_shallow_water_is_land_to_the_survey(write):
    z = np.full((14, 14), -50.0)
    z[:, :5] = -1.0
    survey = read_survey(SurveySection(area=SQUARE, depth=write(text_of(z)), standoff_m=200.0))
    west_of_it = survey.frame.to_local(33.05, -118.975)
    assert not survey.contains(*west_of_it)
    assert not survey.is_navigable(survey.frame.to_local(33.05, -118.9695))[0]
    assert survey.is_navigable(survey.frame.to_local(33.05, -118.967))[0]
    deep = read_survey(SurveySection(area=SQUARE, depth=write(text_of(z)), minimum_depth_m=1.0))
    assert deep.contains(*west_of_it)


def test_shallows_and_land_count_together(write):
    z = np.full((14, 14), -50.0)
    z[:, :5] = 1.0
    land = write(shapely.to_geojson(box(-118.92, 32.9, -118.9, 33.2)), "land.geojson")
    survey = read_survey(SurveySection(area=SQUARE, land=land, depth=write(text_of(z)), standoff_m=0.0))
    assert not survey.contains(*survey.frame.to_local(33.05, -118.98))
    assert not survey.contains(*survey.frame.to_local(33.05, -118.91))
    assert survey.contains(*survey.frame.to_local(33.05, -118.94))


def test_only_the_surroundings_are_kept(write):
    """A wide grid with garbage far north and south of the survey: lines there are not looked at."""
    z = np.full((14, 14), -50.0)
    text = text_of(z, south=32.98)
    lines = text.splitlines()
    lines[1] = "nrows 18"
    lines += ["what is this"] * 4
    lines[3] = "yllcorner 32.94"
    shape = shallow_water(write("\n".join(lines)), AREA, (-119.0, 33.0, -118.9, 33.1), 5.0, "up")
    assert shape.is_empty


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"CDF\x01", "without ncols, nrows and cellsize"),
        (b"\x89HDF\r\n", "is no text"),
        ("", "without ncols"),
        ("ncols 2\nnrows 2\nxllcorner 0\n1 2\n3 4\n", "cellsize"),
        ("ncols two\n", r"depth\.asc:1: two is no number for ncols"),
        ("ncols 1e7\nnrows 2\ncellsize 1\n", "at most 25000000 cells"),
        ("ncols nan\nnrows 2\ncellsize 1\n", "has nan columns"),
        ("ncols 2.5\nnrows 2\ncellsize 1\n", "whole numbers"),
        ("ncols 2\nnrows 2\ncellsize -1\n", "above 0"),
        ("ncols 2\nnrows 2\ncellsize 1\nxllcorner 0\n1 2\n3 4\n", "neither yllcorner nor yllcenter"),
        ("ncols 2\nnrows 2\ncellsize 1\nxllcorner nan\nyllcorner 0\n1 2\n3 4\n", "no degrees"),
        (
            "ncols 2\nnrows 2\ncellsize 50\nxllcorner 412000\nyllcorner 3700000\n1 2\n3 4\n",
            "no degrees .* gdalwarp",
        ),
        (text_of(heights(), west=-110), "covers longitudes -110 .* reaches from -119"),
        (text_of(heights(), south=33.05), "covers longitudes"),
        (text_of(heights()[:10]), "covers longitudes"),
        (text_of(heights()).replace("\n", "\r\n").rsplit("\r\n", 6)[0], "row 10 of values, .* has 0 of them"),
        (text_of(heights())[:-400], "of values, from the north"),
        (text_of(heights()).replace("-19", "a19"), "row . of values, .*a19"),
    ],
)
def test_mistakes_are_named(write, text, message):
    path = write(text)
    with pytest.raises(SurveyError, match=message) as caught:
        shallow_water(path, AREA, AREA, 3.0, "up")
    assert str(path) in str(caught.value)


def test_other_formats_are_refused_with_a_way_out(write):
    with pytest.raises(SurveyError, match="gdal_translate"):
        shallow_water(write(b"CDF\x01", "gebco.nc"), AREA, AREA, 3.0, "up")


def test_a_missing_file(tmp_path):
    with pytest.raises(SurveyError, match="cannot be read"):
        shallow_water(tmp_path / "none.asc", AREA, AREA, 3.0, "up")


def test_a_grid_too_fine_for_the_survey(write):
    head = "ncols 4000\nnrows 4000\nxllcorner -119\nyllcorner 33\ncellsize 0.000025\n1 2 3\n"
    with pytest.raises(SurveyError, match="average it"):
        shallow_water(write(head), AREA, AREA, 3.0, "up")
