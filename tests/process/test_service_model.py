"""What people ashore see is what the vehicle believes."""

import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import EAST, NORTH, SOUTH, VEHICLE, VESSEL, WEST, configure, operating
from processes import Processes, free_port, wait_until

from autonomy.learning.field_model import FieldModel
from autonomy.shore.subscriber import Subscriber
from autonomy.wire import ModelSnapshot
from sim.field import open_field

pytestmark = pytest.mark.process

SHARE_OF_SD = 0.005


def test_a_late_subscriber_sees_the_vehicles_own_map(tmp_path: Path) -> None:
    port, operator, shore_at = free_port(), free_port(), f"tcp/127.0.0.1:{free_port()}"
    config = configure(tmp_path, f"udpin:127.0.0.1:{port}", [shore_at])
    notes = tmp_path / "notes"
    seen: list[ModelSnapshot] = []
    with Processes() as processes:
        service = processes.start(
            str(Path(__file__).with_name("witness.py")), str(config), "0", "0", str(notes)
        )
        processes.vessel(
            "--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}", *VESSEL
        )
        with operating(f"tcp:127.0.0.1:{operator}"):
            service.wait_for("re-estimated", 60.0)
            with Subscriber(
                VEHICLE,
                listen=[shore_at],
                on_update=lambda update: (
                    seen.append(update.value) if isinstance(update.value, ModelSnapshot) else None
                ),
            ):
                wait_until(lambda: len(seen) >= 8, what="eight models")
                assert service.stop() == 0
    own = pickle.loads(notes.read_bytes())["models"]
    errors = [largest_error(snapshot, own[snapshot.sequence]) for snapshot in seen]
    print(
        f"{len(seen)} models of up to {max(len(each.model.basis) for each in seen)} basis vectors: mean within "
        f"{max(mean for mean, _ in errors):.1e}, standard deviation within {max(std for _, std in errors):.1e} "
        "of the field's standard deviation"
    )
    assert max(mean for mean, _ in errors) <= SHARE_OF_SD


def largest_error(ashore: ModelSnapshot, own: FieldModel) -> tuple[float, float]:
    """Largest differences of mean and standard deviation on the survey's map, as shares of the field's."""
    x_min, y_min, x_max, y_max = ashore.bounds_m
    axes = np.linspace(x_min, x_max, 120), np.linspace(y_min, y_max, 120)
    theirs, ours = ashore.model.predict_grid(*axes), own.predict_grid(*axes)
    truth = open_field("synthetic-patch", None).value(
        *np.meshgrid(np.linspace(SOUTH, NORTH, 120), np.linspace(WEST, EAST, 120)), ashore.model_time_s
    )
    differences = theirs.mean - ours.mean, np.sqrt(theirs.variance) - np.sqrt(ours.variance)
    mean, std = (float(np.abs(each).max() / np.std(truth)) for each in differences)
    return mean, std
