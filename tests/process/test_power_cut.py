"""The power goes in mid-survey: of every file only what was synced is left. No observation among that is lost."""

import os
import re
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from at_sea import VESSEL, configure, operating
from processes import Processes, free_port

from autonomy.commands.configuration import load_with_survey
from autonomy.core import Core
from autonomy.records import Resumed
from autonomy.shell.checkpoint import decode, fits
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal_files import Position, Recorded, journal_files, read_from

pytestmark = pytest.mark.process

CUTS = int(os.environ.get("HALOCLINE_CUTS", "2"))
PROGRAM = str(Path(__file__).with_name("fsynced.py"))


def cut(folder: Path, notes: Path) -> int:
    """Take from each file what was never synced; returns how many bytes of the journal's records that was."""
    synced: dict[int, int] = {}
    for line in notes.read_text().splitlines():
        inode, size = map(int, line.split())
        synced[inode] = size
    lost = 0
    for path in folder.rglob("*"):
        if path.is_file() and path.stat().st_size:
            kept = synced.get(path.stat().st_ino, 0)
            if path.suffix == ".journal":
                lost += max(0, path.stat().st_size - kept)
            os.truncate(path, min(path.stat().st_size, kept))
    return lost


def on_disk(journal: Path) -> list[Recorded]:
    return list(read_from(journal, Position(1, 0)))


def told(config: Path, records: list[Recorded]) -> Any:
    """A core that has been told records, every restart included."""
    loaded, survey = load_with_survey(str(config), [])
    core: Any = Core(loaded.configuration, survey)
    for recorded in records:
        if isinstance(recorded.event, Resumed):
            core.resume(recorded.event.now, recorded.event.away_s)
        else:
            core.handle(recorded.now, recorded.event)
    return core


def kept(config: Path, folder: Path) -> Any:
    """The core of the newest checkpoint."""
    loaded, survey = load_with_survey(str(config), [])
    store = Store(folder)
    newest = store.load(fits(loaded.configuration, survey))[0]
    store.close()
    core: Any = Core(loaded.configuration, survey)
    core.restore(newest.memory)
    return core


@pytest.mark.timeout(200 + 100 * CUTS)
def test_what_was_synced_is_known_again(tmp_path: Path) -> None:
    """Checkpoints are made for new missions alone: most of what was learnt since is in the journal, or is lost."""
    port, operator, disk, notes = free_port(), free_port(), tmp_path / "disk", tmp_path / "notes"
    config = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        journal={"directory": str(disk / "journal")},
        checkpoint={"directory": str(disk / "kept"), "period_s": 3600.0},
        exploration={"minimum_basis": 50},
    )
    seed = int(time.time())
    rng = np.random.default_rng(seed)
    lost: list[int] = []
    print(f"seed {seed}")
    with Processes() as processes:
        service = processes.start(PROGRAM, str(notes), "run", "--config", str(config))
        processes.vessel(
            *("--listen", f"udpout:127.0.0.1:{port}", "--listen", f"tcp:127.0.0.1:{operator}"), *VESSEL
        )
        with operating(f"tcp:127.0.0.1:{operator}"):
            service.wait_for("exploring: in AUTO under our mission")
            for number in range(CUTS):
                time.sleep(3.0 + rng.uniform(0.0, 2.0))
                service.send(signal.SIGKILL)
                service.wait()
                written = len(on_disk(disk / "journal"))
                lost_bytes = cut(disk, notes)
                records = on_disk(disk / "journal")
                # A second's worth of records is in danger, not more than that.
                assert 0.5 * written < len(records) <= written
                lost.append(lost_bytes)
                service = processes.start(PROGRAM, str(notes), "run", "--config", str(config))
                service.wait_for("resumed after")
                assert "nothing is known yet" not in service.said
                service.wait_for("exploring: in AUTO under our mission")
                print(
                    f"cut {number + 1}: {lost_bytes} bytes lost, {written - len(records)} of {written} records;"
                )
                print(re.findall(r"replayed .*", service.said))
            assert service.stop() == 0
    assert sum(lost) > 0
    every = on_disk(disk / "journal")
    replayed, resumed = told(config, every), kept(config, disk / "kept")
    assert resumed._learner.samples == replayed._learner.samples > 0
    axis = np.linspace(-2000.0, 2000.0, 25)
    there, here = (core._learner.model().predict_grid(axis, axis).mean for core in (replayed, resumed))
    assert np.abs(there - here).max() <= 1e-9
    assert [file.run for file in journal_files(disk / "journal")] == list(range(1, CUTS + 2))
    assert all(decode(path.read_bytes()).number for path in disk.glob("kept/*.checkpoint"))
