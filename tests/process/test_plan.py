"""`autonomy plan` with a model that `autonomy shore watch --save` keeps, each in a process of its own."""

import json
import sys
from pathlib import Path

import pytest
import shapely

sys.path.insert(0, str(Path(__file__).parent))
from processes import Processes
from shore_helpers import free_endpoint, health_notice, learnt_model, model_snapshot, publisher

from autonomy.effects import Topic
from autonomy.learning import snapshot

pytestmark = pytest.mark.process

# About the origin that `model_snapshot` tells: 34.4 north, 120.5 west.
CONFIGURATION = """
survey:
  area: [[34.35, -120.56], [34.35, -120.44], [34.45, -120.44], [34.45, -120.56]]
  passage_cells: 40
planning: {lattice: [7, 7], spots: 6}
budget: {consumption_j_per_m: 50.0}
"""


def test_what_was_saved_ashore_is_planned_with_at_the_desk(tmp_path: Path) -> None:
    model, _ = learnt_model()
    endpoint, saved, out = free_endpoint(), tmp_path / "model.snapshot", tmp_path / "plan.geojson"
    config = tmp_path / "boat.yaml"
    config.write_text(CONFIGURATION)
    with Processes() as processes:
        words = ("shore", "watch", "boat1", "--listen", endpoint, "--save", str(saved), "--count", "2")
        watching = processes.start("-m", "autonomy", *words)
        with publisher(endpoint) as boat:
            boat.publish(Topic.HEALTH, health_notice())
            boat.publish(Topic.MODEL, model_snapshot(model, 0))
            watching.wait_for("t=1000", count=1)
            boat.publish(Topic.MODEL, model_snapshot(model, 1))
            assert watching.wait() == 0
        assert len(snapshot.decode(saved.read_bytes())) == len(model)
        picture = tmp_path / "plan.png"
        words = ("--model", str(saved), "--out", str(out), "--picture", str(picture), "--budget-km", "25")
        planning = processes.start("-m", "autonomy", "plan", "--config", str(config), *words)
        assert planning.wait() == 0, planning.said
        assert "with a model of 400 readings, of boat1" in planning.said
    route, *spots = json.loads(out.read_text())["features"]
    line = shapely.geometry.shape(route["geometry"])
    assert line.is_valid
    assert shapely.box(-120.56, 34.35, -120.44, 34.45).buffer(1e-3).contains(line)
    assert line.coords[0] == line.coords[-1]
    told = route["properties"]
    assert 15.0 < told["length_km"] <= 25.0
    assert told["energy_wh"] == pytest.approx(told["length_km"] * 1e3 * 50.0 / 3600.0, abs=0.1)
    assert told["expected_rmse"] < told["rmse_before"]
    assert len(spots) == told["spots"]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_without_the_extra_a_picture_is_refused_with_the_remedy(tmp_path: Path) -> None:
    config = tmp_path / "boat.yaml"
    config.write_text(CONFIGURATION)
    hidden = "import sys; sys.modules['matplotlib'] = None; from autonomy.cli import main; sys.exit(main())"
    words = (
        "--config",
        str(config),
        "--out",
        str(tmp_path / "plan.geojson"),
        "--picture",
        str(tmp_path / "plan.png"),
    )
    with Processes() as processes:
        planning = processes.start("-c", hidden, "plan", *words)
        assert planning.wait() == 2
        assert "autonomy plan: --picture needs matplotlib: pip install 'halocline[shore]'" in planning.said
