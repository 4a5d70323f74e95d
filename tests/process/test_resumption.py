"""`autonomy run` killed again and again in a survey: it goes on by itself, with everything that it had learnt.

HALOCLINE_KILLS says how often; then the usual time that a restart takes is held to its limit too, which asks for a
machine with nothing else to do: a second and a half of it are spent on starting Python.
"""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import VEHICLE, VESSEL, configure, operating
from processes import Processes, Running, free_port, wait_until

from autonomy.commands.configuration import load_with_survey
from autonomy.core import Core
from autonomy.learning.field_model import FieldModel
from autonomy.records import Resumed
from autonomy.shell.checkpoint import fits
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal_files import Position, read_from
from autonomy.shore.subscriber import Subscriber

pytestmark = pytest.mark.process

KILLS = int(os.environ.get("HALOCLINE_KILLS", "4"))
LIMIT_S = 5.0
EXPLORING = "exploring: in AUTO under our mission"


def samples(shore: Subscriber) -> int:
    health = shore.latest(VEHICLE).health
    return 0 if health is None else int(health.samples)


def model_after_everything(config: Path, journal: Path) -> FieldModel:
    """What a core believes that has been told all of the journal, every restart included."""
    loaded, survey = load_with_survey(str(config), [])
    core = Core(loaded.configuration, survey)
    for recorded in read_from(journal, Position(1, 0)):
        if isinstance(recorded.event, Resumed):
            core.resume(recorded.event.now, recorded.event.away_s)
        else:
            core.handle(recorded.now, recorded.event)
    return core._learner.model()


def model_of_checkpoint(config: Path, folder: Path) -> tuple[FieldModel, int]:
    loaded, survey = load_with_survey(str(config), [])
    store = Store(folder)
    newest = store.load(fits(loaded.configuration, survey))[0]
    store.close()
    core = Core(loaded.configuration, survey)
    core.restore(newest.memory)
    return core._learner.model(), core._learner.samples


def assert_sails_only_what_was_read(service: Running) -> None:
    """Before the service calls the mission its own it has read it."""
    before = service.said.partition(EXPLORING)[0]
    assert re.search(r"our mission is on board|verified on board", before), before


@pytest.mark.timeout(60 + 30 * KILLS)
def test_a_killed_service_goes_on_by_itself(tmp_path: Path) -> None:
    port, operator, shore_at = free_port(), free_port(), f"tcp/127.0.0.1:{free_port()}"
    config = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        [shore_at],
        journal={"directory": str(tmp_path / "journal")},
        checkpoint={"directory": str(tmp_path / "kept"), "period_s": 3.0},
        logging={"level": "debug"},
    )
    seed = int(time.time())
    rng, took_s = np.random.default_rng(seed), []
    print(f"seed {seed}")
    with Processes() as processes, Subscriber(VEHICLE, listen=[shore_at]) as shore:
        service = processes.service(config)
        processes.vessel(
            *("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}"), *VESSEL
        )
        with operating(f"tcp:127.0.0.1:{operator}"):
            service.wait_for("re-estimated")
            for _ in range(KILLS):
                time.sleep(rng.uniform(0.0, 6.0))
                learnt = samples(shore)
                service.send(signal.SIGKILL)
                service.wait()
                started = time.monotonic()
                service = processes.service(config)
                service.wait_for(EXPLORING)
                took_s.append(time.monotonic() - started)
                assert "nothing is known yet" not in service.said
                assert "crashes the core" not in service.said
                assert_sails_only_what_was_read(service)
                wait_until(lambda: samples(shore) > 0, what="health")
                wait_until(lambda known=learnt: samples(shore) > known, what="more samples than before")
            assert service.stop() == 0
    replayed = model_after_everything(config, tmp_path / "journal")
    kept, count = model_of_checkpoint(config, tmp_path / "kept")
    axis = np.linspace(-2000.0, 2000.0, 25)
    difference = replayed.predict_grid(axis, axis).mean - kept.predict_grid(axis, axis).mean
    print(f"{count} samples after {KILLS} kills; exploring again after {np.round(took_s, 1)} s")
    print(f"replay and checkpoint differ by {np.abs(difference).max():.1e}")
    assert len(kept) > 0
    assert np.abs(difference).max() <= 1e-9
    if "HALOCLINE_KILLS" in os.environ:
        assert float(np.median(took_s)) <= LIMIT_S


def test_without_a_journal_it_goes_on_from_the_last_checkpoint(tmp_path: Path) -> None:
    """Plans that came on board since are known: they are worth a checkpoint of their own."""
    port, operator = free_port(), free_port()
    config = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        journal={"enabled": False},
        checkpoint={"directory": str(tmp_path / "kept"), "period_s": 3600.0},
    )
    with Processes() as processes:
        service = processes.service(config)
        processes.vessel(
            *("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}"), *VESSEL
        )
        with operating(f"tcp:127.0.0.1:{operator}"):
            service.wait_for("re-estimated")
            for _ in range(2):
                service.send(signal.SIGKILL)
                service.wait()
                service = processes.service(config)
                service.wait_for(EXPLORING)
                assert_sails_only_what_was_read(service)
                service.wait_for("plan ")
                assert "we don't know" not in service.said
            assert service.stop() == 0
    assert model_of_checkpoint(config, tmp_path / "kept")[1] > 0


def test_no_mission_goes_out_that_the_disk_does_not_know_of(tmp_path: Path) -> None:
    """Else the service that comes after a kill takes its own mission for somebody else's, and leaves him the boat."""
    port, operator, hold = free_port(), free_port(), tmp_path / "hold"
    config = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        journal={"directory": str(tmp_path / "journal")},
        checkpoint={"directory": str(tmp_path / "kept"), "period_s": 3600.0},
    )
    words = (str(Path(__file__).with_name("held_disk.py")), str(hold), "run", "--config", str(config))
    with Processes() as processes:
        service = processes.start(*words)
        processes.vessel(
            *("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}"), *VESSEL
        )
        with operating(f"tcp:127.0.0.1:{operator}"):
            service.wait_for(EXPLORING)
            hold.touch()
            plans, missions = service.said.count(" plan "), service.said.count("autopilot: Mission: ")
            service.wait_for(" plan ", count=plans + 1)
            time.sleep(1.0)  # an upload takes a tenth of that
            assert service.said.count("autopilot: Mission: ") == missions
            service.send(signal.SIGKILL)
            service.wait()
            hold.unlink()
            service = processes.start(*words)
            service.wait_for(EXPLORING)
            assert_sails_only_what_was_read(service)
            assert "in place of ours" not in service.said
            service.wait_for("verified on board")
            assert service.stop() == 0


def test_a_second_service_does_not_sail_the_same_boat(tmp_path: Path) -> None:
    """Started by hand beside the one that systemd keeps, say: it ends, and says what to do."""
    config = configure(tmp_path, f"udpin:127.0.0.1:{free_port()}")
    folder = tmp_path / "state" / "checkpoint"
    first = Store(folder)
    words = (sys.executable, "-m", "autonomy", "run", "--config", str(config))
    environment = {**os.environ, "STATE_DIRECTORY": str(tmp_path / "state")}
    second = subprocess.run(words, capture_output=True, text=True, env=environment, check=False)
    first.close()
    assert second.returncode == 75
    assert f"another service runs, and keeps its checkpoints in {folder}: two would fight" in second.stderr
    assert "Traceback" not in second.stderr
    assert not (tmp_path / "state" / "journal").exists()
