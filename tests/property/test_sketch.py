"""Whatever people draw, importing it ends in a survey's file that reads back, or in a message."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from shapely.geometry import box, mapping

from autonomy.commands.sketch import sketch
from autonomy.config import SurveySection
from autonomy.planning.geojson import ROLES
from autonomy.planning.survey import SurveyError, read_survey

NAMES = ("", "area", "Land", "keep-out: wreck", "KEEP IN", "island", "42", "Ünnamed", "survey")
coordinates = st.integers(0, 12).map(lambda k: k / 100.0)


@st.composite
def squares(draw: st.DrawFn) -> dict[str, object]:
    """One feature: a square somewhere, with a name, a role, or neither."""
    west, south = draw(coordinates), draw(coordinates)
    properties: dict[str, object] = {}
    if draw(st.booleans()):
        properties["name"] = draw(st.sampled_from(NAMES))
    if draw(st.booleans()):
        properties["role"] = draw(st.sampled_from([*ROLES, "shore", None]))
    side = draw(st.sampled_from([0.01, 0.03, 0.08]))
    shape = box(west, south, west + side, south + side)
    return {"type": "Feature", "properties": properties, "geometry": mapping(shape)}


@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(files=st.lists(st.lists(squares(), min_size=1, max_size=4), min_size=1, max_size=3))
def test_a_drawing_is_imported_or_refused(tmp_path: Path, files: list[list[dict[str, object]]]) -> None:
    paths = []
    for number, features in enumerate(files):
        paths.append(tmp_path / f"{number}.geojson")
        paths[-1].write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    try:
        drawn = sketch([(None, path) for path in paths])
    except SurveyError:
        return
    out = tmp_path / "out.geojson"
    out.write_text(json.dumps(drawn.geojson(), allow_nan=False))
    again = sketch([(None, out)])
    assert again.roles == drawn.roles
    assert "area" in drawn.roles
    for role in drawn.roles:
        assert again.shape(role).symmetric_difference(drawn.shape(role)).area < 1e-12
    expected = drawn.shape("area") - drawn.shape("keep_out") - drawn.shape("land")
    if "keep_in" in drawn.roles:
        expected &= drawn.shape("keep_in")
    section = SurveySection.model_validate({"standoff_m": 0.0, **dict.fromkeys(drawn.roles, out)})
    if expected.area == 0.0:
        with pytest.raises(SurveyError, match="no water is left"):
            read_survey(section)
        return
    survey = read_survey(section)
    centre = expected.representative_point()
    assert survey.contains(*survey.frame.to_local(centre.y, centre.x))
