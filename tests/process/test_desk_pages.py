"""The pages after the bench: what they tell people to type at the desk is typed, with files of the names on the page.

What needs a boat on a serial port is not; the dry runs are long, and wait for HALOCLINE_FIRST_DAY.
"""

import json
import os
import re
import shlex
from pathlib import Path

import pytest
import shapely

from autonomy.cli import main as autonomy
from sim.cli import main as sim

pytestmark = pytest.mark.process
DOCS = Path(__file__).parents[2] / "docs"
DRAWN = DOCS.parent / "tests" / "unit" / "drawn"
FENCE = re.compile(r"^```\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PROGRAMS = {"autonomy": autonomy, "sim": sim}
BOAT = """
mavlink: {endpoint: "serial:/dev/ttyAMA0:921600"}
survey:
  area: [[33.726, -118.675], [33.726, -118.665], [33.734, -118.665], [33.734, -118.675]]
  passage_cells: 40
sampling: {spacing_m: 40}
budget: {distance_m: 3000, energy_wh: 900, consumption_j_per_m: 100, speed_mps: 2.0, home: [33.730, -118.670]}
"""


def typed(page: str, begins: str) -> list[str]:
    """The commands of a page that begin so."""
    lines = [line for body in FENCE.findall((DOCS / page).read_text()) for line in body.splitlines()]
    return [line for line in lines if line.startswith(begins)]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the pages name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "boat1.yaml").write_text(BOAT)
    (tmp_path / "harbour.plan").write_bytes((DRAWN / "qgc-survey-and-fence.plan").read_bytes())
    (tmp_path / "coast.kml").write_bytes((DRAWN / "earth-web.kml").read_bytes())
    (tmp_path / "polygon.kml").write_bytes((DRAWN / "earth-web.kml").read_bytes())
    shore = shapely.box(9.85, 54.47, 9.91, 54.48)
    (tmp_path / "osm-coast.geojson").write_text(json.dumps(shapely.geometry.mapping(shore)))
    return tmp_path


def run(line: str) -> int:
    program, *words = shlex.split(line)
    return PROGRAMS[program](words)


def test_what_was_drawn_is_imported(desk: Path) -> None:
    lines = [line for line in typed("draw.md", "autonomy survey import") if "--from-vehicle" not in line]
    assert len(lines) > 1
    for line in lines:
        assert run(line) == 0
        (desk / "survey.geojson").unlink()


def test_the_first_plan(desk: Path) -> None:
    (line,) = typed("sea.md", "autonomy plan")
    assert run(line) == 0
    assert json.loads((desk / "plan.geojson").read_text())["features"]


@pytest.mark.skipif("HALOCLINE_FIRST_DAY" not in os.environ, reason="HALOCLINE_FIRST_DAY is not set")
@pytest.mark.parametrize("page", ["harbour.md", "sea.md", "simulator.md"])
def test_dry_runs(desk: Path, page: str) -> None:
    (line,) = typed(page, "sim dry-run")
    assert run(line) == 0
    told = json.loads((desk / "dry-run" / "dry-run.json").read_text())
    assert told["home"]
