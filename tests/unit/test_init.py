"""`autonomy init`: a first configuration from flags, or from a conversation."""

import json
import re

import pytest
from shapely.geometry import box, mapping

from autonomy.cli import main
from autonomy.commands.starter import _SHOWN, starter_text
from autonomy.config import Configuration, load
from autonomy.config.reference import keys

AREA, ROCK = box(-118.98, 33.02, -118.92, 33.08), box(-118.96, 33.04, -118.955, 33.045)
FLAGS = {
    "--link": "serial:/dev/ttyAMA0:921600",
    "--sensor": "TEMP sea_water_temperature degree_Celsius",
    "--survey": "area.geojson",
    "--land": "coast/rocks.geojson",
    "--router": "tcp/shore.example.org:7447",
}


def feature(role, shape):
    return {"type": "Feature", "properties": {"role": role}, "geometry": mapping(shape)}


@pytest.fixture(autouse=True)
def desk(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "area.geojson").write_text(json.dumps(mapping(AREA)))
    (tmp_path / "coast").mkdir()
    (tmp_path / "coast" / "rocks.geojson").write_text(json.dumps(mapping(ROCK)))
    roles = {"type": "FeatureCollection", "features": [feature("area", AREA), feature("land", ROCK)]}
    (tmp_path / "survey.geojson").write_text(json.dumps(roles))
    return tmp_path


def words(**changed):
    flags = FLAGS | {f"--{name}": value for name, value in changed.items()}
    return [word for flag, value in flags.items() if value is not None for word in (flag, value)]


def init(*more, **changed):
    return main(["init", "boat.yaml", *words(**changed), *more])


class TestFlags:
    def test_every_answer_is_in_force(self, desk, capsys):
        assert init("--name", "otter") == 0
        made = load("boat.yaml", {})
        assert made.vehicle.name == "otter"
        assert made.mavlink.endpoint == FLAGS["--link"]
        assert (made.sensor.message_name, made.sensor.variable, made.sensor.units) == tuple(
            FLAGS["--sensor"].split()
        )
        assert (made.survey.area, made.survey.land) == (
            desk / "area.geojson",
            desk / "coast" / "rocks.geojson",
        )
        assert made.shore.connect == [FLAGS["--router"]]
        assert "autonomy preflight --config boat.yaml" in capsys.readouterr().out
        assert main(["check-config", "boat.yaml"]) == 0

    def test_files_are_named_relative_to_the_configuration(self, desk):
        (desk / "etc").mkdir()
        assert main(["init", "etc/boat.yaml", *words()]) == 0
        assert 'land: "../coast/rocks.geojson"' in (desk / "etc" / "boat.yaml").read_text()
        assert load("etc/boat.yaml", {}).survey.area == desk / "etc" / ".." / "area.geojson"

    def test_roles_of_an_imported_survey_are_taken(self, desk):
        assert init(survey="survey.geojson", land=None) == 0
        made = load("boat.yaml", {})
        assert made.survey.land == made.survey.area == desk / "survey.geojson"
        assert made.survey.keep_out is None

    def test_nothing_may_be_said_of_land_and_router(self, capsys):
        assert init(land="none", router="none") == 0
        made = load("boat.yaml", {})
        assert (made.survey.land, made.shore.connect) == (None, [])
        assert "no polygons of land are given" in capsys.readouterr().err

    def test_all_the_rest_is_the_defaults(self, desk):
        """Also with every commented key let in."""
        assert init() == 0
        text = (desk / "boat.yaml").read_text()
        names = {name.split(".")[-1] for name in _SHOWN} | {"signing", "tls"}
        every = re.sub(rf"^( *)# ((?:{'|'.join(names)}):(?: |$))", r"\1\2", text, flags=re.MULTILINE)
        assert every.count("\n") == text.count("\n")
        assert every.count("# ") < text.count("# ") - 20
        (desk / "every.yaml").write_text(every)
        assert load("every.yaml", {}) == load("boat.yaml", {})

    def test_it_says_what_every_key_means(self):
        values = {("survey", "area"): "a.geojson"}
        text = " ".join(starter_text("boat.yaml", values).replace("#", " ").split())
        for key in keys(Configuration):
            if ".".join(key.path) in _SHOWN:
                assert key.meaning[1:] in text


class TestMistakes:
    def test_nobody_to_ask(self, desk, capsys):
        assert init(sensor=None, router=None) == 2
        assert "nobody can be asked here: give --sensor, --router" in capsys.readouterr().err
        assert not (desk / "boat.yaml").exists()

    def test_a_file_that_is_there_stays(self, desk, capsys):
        (desk / "boat.yaml").write_text("mine")
        assert init() == 73
        assert "is there already" in capsys.readouterr().err
        assert (desk / "boat.yaml").read_text() == "mine"

    @pytest.mark.parametrize(
        ("flag", "value", "said"),
        [
            ("link", "/dev/ttyAMA0", "--link: '/dev/ttyAMA0': not an endpoint"),
            ("link", "udpin:0.0.0.0:99999", "the port must be from 1 to 65535"),
            ("sensor", "SALT", "--sensor: three words are needed, NAME VARIABLE UNITS, not 1"),
            ("sensor", "SALINITYPROBE salinity 1", "1 to 10 printable ASCII characters"),
            ("survey", "nowhere.geojson", "--survey: nowhere.geojson: cannot be read: No such file"),
            ("land", "nowhere.kml", "--land: nowhere.kml: cannot be read"),
            ("router", "shore:7447", "--router: ['shore:7447']"),
            ("name", "my boat", "1 to 32 letters, digits, - and _"),
        ],
    )
    def test_a_wrong_flag_is_named(self, desk, capsys, flag, value, said):
        assert init(**{flag: value}) == 2
        assert said in capsys.readouterr().err
        assert not (desk / "boat.yaml").exists()

    def test_what_the_service_would_refuse_is_not_written(self, desk, capsys):
        (desk / "flood.geojson").write_text(json.dumps(mapping(AREA.buffer(0.1))))
        assert init(land="flood.geojson") == 78
        assert "boat.yaml" in (err := capsys.readouterr().err)
        assert "no water is left" in err
        assert ".part" not in err
        assert sorted(each.name for each in desk.iterdir()) == [
            "area.geojson", "coast", "flood.geojson", "survey.geojson",
        ]  # fmt: skip

    def test_a_drawing_by_names_is_to_be_imported_first(self, desk, capsys):
        ring = "<LinearRing><coordinates>{}</coordinates></LinearRing>"
        polygons = "".join(
            f"<Placemark><name>{name}</name><Polygon><outerBoundaryIs>"
            f"{ring.format(' '.join(f'{x},{y}' for x, y in shape.exterior.coords))}"
            "</outerBoundaryIs></Polygon></Placemark>"
            for name, shape in (("area", AREA), ("land: rock", ROCK))
        )
        (desk / "bay.kml").write_text(f"<kml>{polygons}</kml>")
        assert init(survey="bay.kml") == 2
        assert "autonomy survey import bay.kml --out survey.geojson" in capsys.readouterr().err


class TestConversation:
    @pytest.fixture
    def typed(self, monkeypatch):
        def types(*answers):
            left, asked = list(answers), []

            def answer(prompt):
                asked.append(prompt)
                if not left:
                    raise EOFError
                return left.pop(0)

            monkeypatch.setattr("builtins.input", answer)
            monkeypatch.setattr("sys.stdin.isatty", lambda: True)
            return asked

        return types

    def test_five_questions_mistakes_asked_again(self, typed, capsys):
        asked = typed("", "x", "", "area.geojson", "coast/rocks.geojson", "")
        assert main(["init", "boat.yaml"]) == 0
        made = load("boat.yaml", {})
        assert made.mavlink.endpoint == "udpin:0.0.0.0:14551"
        assert made.sensor.message_name == "SALT"
        assert made.survey.land is not None
        assert len(asked) == 6
        assert "three words are needed" in capsys.readouterr().err

    def test_flags_are_not_asked_for(self, typed):
        asked = typed("none")
        assert init(router=None) == 0
        assert len(asked) == 1

    def test_land_that_the_survey_has_is_not_asked_for(self, typed):
        asked = typed("", "", "survey.geojson", "")
        assert main(["init", "boat.yaml"]) == 0
        assert load("boat.yaml", {}).survey.land is not None
        assert not any("land" in prompt for prompt in asked)

    def test_whoever_leaves_has_nothing_written(self, desk, typed, capsys):
        typed("")
        assert main(["init", "boat.yaml"]) == 2
        assert "nothing is written" in capsys.readouterr().err
        assert not (desk / "boat.yaml").exists()
