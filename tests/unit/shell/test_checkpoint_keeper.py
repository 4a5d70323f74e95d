"""Checkpoints written by a thread of their own: two generations at any time, and no error ends the thread."""

import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autonomy.shell import checkpoint_store
from autonomy.shell.checkpoint import Checkpoint
from autonomy.shell.checkpoint_keeper import Keeper
from autonomy.shell.checkpoint_store import Store

Write = Any


def checkpoint(now: float) -> Checkpoint:
    return Checkpoint(0, {}, {"known": now}, now, 1e9, "boot", None)


def kept(folder: Path) -> list[float]:
    """When the sound checkpoints in a folder were made, newest first."""
    store = Store(folder)
    found = [each.now for each in store.load({})]
    store.close()
    return found


def wait_until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


class Disk:
    """Waits while it is not `free`, and raises `error` if there is one."""

    def __init__(self, write: Write) -> None:
        self._sound = write
        self.free = threading.Event()
        self.free.set()
        self.asked = threading.Semaphore(0)
        self.tried = 0
        self.error: Exception | None = None

    def write(self, path: Path, data: bytes) -> None:
        self.asked.release()
        assert self.free.wait(60.0)
        try:
            if self.error is not None:
                raise self.error
            self._sound(path, data)
        finally:
            self.tried += 1


@pytest.fixture
def disk(monkeypatch: pytest.MonkeyPatch) -> Disk:
    disk = Disk(checkpoint_store.write_atomically)
    monkeypatch.setattr(checkpoint_store, "write_atomically", disk.write)
    return disk


def write_all_at_once(folder: Path, disk: Disk, *times: float) -> None:
    """The first is being written while the others are handed in."""
    store = Store(folder)
    keeper = Keeper(store)
    disk.free.clear()
    for number, now in enumerate(times):
        keeper.keep(checkpoint(now))
        if not number:
            disk.asked.acquire()
    disk.free.set()
    keeper.close()
    store.close()


def test_what_waits_is_written_before_the_end(tmp_path: Path, disk: Disk) -> None:
    write_all_at_once(tmp_path, disk, 1.0, 2.0)
    assert kept(tmp_path) == [2.0, 1.0]


def test_where_one_gave_way_the_older_of_two_generations_is_replaced(tmp_path: Path, disk: Disk) -> None:
    """Not the newest, which would leave one that is two older than the last, or none beside it."""
    write_all_at_once(tmp_path, disk, 1.0, 2.0, 3.0)
    assert kept(tmp_path) == [3.0, 1.0]


def test_all_are_settled_when_the_last_is_written_or_refused(tmp_path: Path, disk: Disk) -> None:
    store = Store(tmp_path)
    keeper = Keeper(store)
    assert keeper.is_settled
    disk.free.clear()
    keeper.keep(checkpoint(1.0))
    assert not keeper.is_settled
    disk.asked.acquire()  # taken, and not written
    assert not keeper.is_settled
    keeper.keep(checkpoint(2.0))
    assert not keeper.is_settled
    disk.free.set()
    wait_until(lambda: keeper.is_settled)
    assert store.newest == 2
    disk.error = OSError(5, "Input/output error")
    keeper.keep(checkpoint(3.0))
    wait_until(lambda: keeper.is_settled)
    assert keeper.trouble
    keeper.close()
    store.close()


@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), MemoryError("no room"), RecursionError("too deep")]
)
def test_whatever_one_failed_over_is_told_and_the_next_replaces_the_older(
    tmp_path: Path, disk: Disk, error: Exception, caplog: pytest.LogCaptureFixture
) -> None:
    """Disk and memory come back; a thread that has ended would not, and nobody would hear of it."""
    store = Store(tmp_path)
    keeper = Keeper(store)
    for now in (1.0, 2.0):
        keeper.keep(checkpoint(now))
        wait_until(lambda now=now: store.newest == now)
    disk.error = error
    for now in (3.0, 4.0):
        tried = disk.tried
        keeper.keep(checkpoint(now))
        wait_until(lambda tried=tried: disk.tried > tried and keeper.trouble)
    assert "No space left" in keeper.trouble or str(error) in keeper.trouble
    disk.error = None
    keeper.keep(checkpoint(5.0))
    keeper.close()
    assert keeper.trouble == ""
    assert caplog.text.count("no checkpoint could be written") == 1
    store.close()
    assert kept(tmp_path) == [5.0, 2.0]


def test_a_folder_that_is_removed_under_way_is_made_and_locked_again(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    store = Store(folder)
    for now in (1.0, 2.0):
        keeper = Keeper(store)
        keeper.keep(checkpoint(now))
        keeper.close()
        if now == 1.0:
            shutil.rmtree(folder)
    assert keeper.trouble == ""
    with pytest.raises(BlockingIOError):
        Store(folder)
    store.close()
    assert kept(folder) == [2.0]


def test_a_folder_that_another_service_has_made_meanwhile_is_left_to_it(tmp_path: Path) -> None:
    """What it keeps there is its own, and both would be the boat's."""
    folder = tmp_path / "kept"
    store = Store(folder)
    shutil.rmtree(folder)
    other = Store(folder)
    keeper = Keeper(store)
    keeper.keep(checkpoint(1.0))
    keeper.close()
    assert keeper.trouble == f"{folder}/lock: another process uses it"
    other.close()
    store.close()
    assert kept(folder) == []
