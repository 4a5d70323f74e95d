"""The service's journal on real processes: killed at any moment, it holds what happened, and replays to the same."""

import signal
import sys
import time
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from at_sea import VESSEL, configure, operating
from processes import Processes, free_port, wait_until
from pymavlink import mavutil

from autonomy.records import Asked, Happened
from autonomy.replay import replay
from autonomy.shell.journal_files import Entry, Position, Trouble, journal_files, read_entries, read_header

pytestmark = pytest.mark.process


def entries(folder: Path, run: int) -> list[Entry]:
    found = list(read_entries(folder, Position(run, 0), run))
    assert [part.text for part in found if isinstance(part, Trouble) and not part.torn] == []
    return [part for part in found if isinstance(part, Entry)]


def test_killed_at_any_moment_nothing_is_missing_and_the_run_replays(tmp_path: Path) -> None:
    """Each start is killed without a word, later and later, and begins a run of its own."""
    port, folder = free_port(), tmp_path / "journal"
    # Without checkpoints a run does not know the mission that the one before it has brought on board.
    config = configure(
        tmp_path,
        f"udpin:127.0.0.1:{port}",
        mavlink={"adopt": True},
        journal={"directory": "journal"},
        checkpoint={"enabled": False},
    )
    operator = f"tcp:127.0.0.1:{free_port()}"
    with Processes() as processes:
        processes.vessel(*VESSEL, "--listen", f"udpout:127.0.0.1:{port}", "--listen", operator)
        with operating(operator):
            for run, seconds in enumerate((0.2, 0.5, 6.0, 1.5), 1):
                service = processes.service(config)
                service.wait_for(f"recording run {run} in {folder}")
                service.wait_for("verified on board" if run == 3 else "looking for the vehicle")
                time.sleep(seconds)
                service.send(signal.SIGKILL)
                service.wait()
                numbers = [entry.position.sequence for entry in entries(folder, run)]
                assert numbers == list(range(1, len(numbers) + 1))
            service = processes.service(config)
            service.wait_for("recording run 5")
            service.wait_for("looking for the vehicle")
            assert service.stop() == 0
    assert [file.run for file in journal_files(folder)] == [1, 2, 3, 4, 5]
    for run in (3, 5):
        outcome = replay(folder, run)
        assert (outcome.differences, outcome.lost) == ([], False)
    sent = [
        effect.label
        for entry in entries(folder, 3)
        if isinstance(entry.record, Asked)
        for effect in entry.record.effects
    ]
    assert "MISSION_ITEM_INT" in sent
    assert any(
        isinstance(entry.record, Happened) and type(entry.record.event).__name__ == "StopRequested"
        for entry in entries(folder, 5)
    )
    # The stream holds both directions, in order.
    stream = mavutil.mavlink_connection(str(journal_files(folder)[2].stream))
    heard, stamps = set(), []
    while (message := stream.recv_msg()) is not None:
        heard.add((message.get_srcComponent(), message.get_type()))
        stamps.append(message._timestamp)
    stream.close()
    assert {(1, "GLOBAL_POSITION_INT"), (1, "NAMED_VALUE_FLOAT"), (191, "MISSION_ITEM_INT")} <= heard
    assert stamps == sorted(stamps)
    assert abs(stamps[-1] - time.time()) < 600.0


def test_a_run_that_went_on_after_a_kill_replays_from_the_first(tmp_path: Path) -> None:
    """The second run's core came from a checkpoint and the records since; replay comes to the same without it."""
    port, folder = free_port(), tmp_path / "journal"
    config = configure(tmp_path, f"udpin:127.0.0.1:{port}", journal={"directory": "journal"})
    state = {"XDG_STATE_HOME": str(tmp_path / "state")}
    operator = f"tcp:127.0.0.1:{free_port()}"
    with Processes() as processes:
        processes.vessel(*VESSEL, "--listen", f"udpout:127.0.0.1:{port}", "--listen", operator)
        with operating(operator):
            service = processes.service(config, environment=state)
            service.wait_for("re-estimated")
            service.send(signal.SIGKILL)
            service.wait()
            service = processes.service(config, environment=state)
            service.wait_for("resumed after")
            service.wait_for("exploring")
            time.sleep(3.0)
            assert service.stop() == 0
    header = read_header(journal_files(folder)[-1].path)
    assert header["run"] == 2
    assert header["resumed"] is not None
    outcome = replay(folder, 2)
    assert outcome.events > len(entries(folder, 1)) // 2
    assert [str(each) for each in outcome.differences] == []
    assert not outcome.lost


def test_what_happens_is_in_the_file_while_the_service_runs(tmp_path: Path) -> None:
    port, folder = free_port(), tmp_path / "journal"
    config = configure(tmp_path, f"udpin:127.0.0.1:{port}", journal={"directory": "journal"})
    with Processes() as processes:
        service = processes.service(config)
        processes.vessel(*VESSEL, "--listen", f"udpout:127.0.0.1:{port}")
        service.wait_for("recording run 1 in")
        wait_until(lambda: len(entries(folder, 1)) > 100, what="100 records")
        before = len(entries(folder, 1))
        wait_until(lambda: len(entries(folder, 1)) > before, what="another record")
        assert read_header(journal_files(folder)[0].path)["resumed"] is None


def test_a_second_service_in_the_same_folder_sails_unrecorded(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    shared = {"directory": str(tmp_path / "journal")}
    first = configure(tmp_path / "a", f"udpin:127.0.0.1:{free_port()}", journal=shared)
    second = configure(tmp_path / "b", f"udpin:127.0.0.1:{free_port()}", journal=shared)
    with Processes() as processes:
        one = processes.service(first)
        one.wait_for("recording run 1")
        other = processes.service(second)
        other.wait_for(f"another service records in {tmp_path / 'journal'}: nothing is recorded")
        other.wait_for("looking for the vehicle")
        assert other.stop() == 0
        assert one.stop() == 0
