"""What an upload begins with waits for the disk, and for nothing else."""

import asyncio
import threading
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.shell.forethought import Forethought

DEADLINE_S = 30.0


def count(items: int = 20) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, items)


class Disk:
    """A journal, or checkpoints, on a disk that takes its time: `gives_in` says which wait is over."""

    def __init__(self) -> None:
        self.position = 1
        self.waits: list[tuple[Any, threading.Event]] = []

    def sync(self, position: int, within_s: float) -> bool:
        return self._wait(position)

    def settle(self, within_s: float) -> bool:
        return self._wait("checkpoint")

    def _wait(self, what: Any) -> bool:
        over = threading.Event()
        self.waits.append((what, over))
        return over.wait(DEADLINE_S)

    def gives_in(self, number: int) -> None:
        self.waits[number][1].set()


class Bench:
    """Forethought, the transfer that is under way, and what has gone out."""

    def __init__(self, journal: Disk | None, continuity: Disk | None = None) -> None:
        self.upload: object | None = None
        self.sent: list[Any] = []
        self.subject = Forethought(
            journal,  # type: ignore[arg-type]
            continuity,  # type: ignore[arg-type]
            lambda: self.upload,
            self.sent.append,
        )

    def begins(self) -> Any:
        """Another upload; its first word."""
        self.upload = SimpleNamespace()
        return self.says(count())

    def says(self, message: Any) -> Any:
        self.subject.send(message)
        return message


async def until(condition: Any) -> None:
    async def poll() -> None:
        while not condition():
            await asyncio.sleep(0.001)

    await asyncio.wait_for(poll(), DEADLINE_S)


async def settled() -> None:
    """All threads that were let go have told the loop."""
    await asyncio.get_running_loop().shutdown_default_executor()
    await asyncio.sleep(0)


def run(scenario: Any) -> None:
    asyncio.run(asyncio.wait_for(scenario(), DEADLINE_S))


def test_an_upload_begins_when_the_journal_has_its_plan() -> None:
    async def scenario() -> None:
        disk = Disk()
        bench = Bench(disk)
        first = bench.begins()
        await until(lambda: disk.waits)
        assert bench.sent == []
        disk.gives_in(0)
        await until(lambda: bench.sent)
        assert bench.sent == [first]
        assert [what for what, _ in disk.waits] == [1]

    run(scenario)


def test_nothing_else_waits() -> None:
    async def scenario() -> None:
        disk = Disk()
        bench = Bench(disk)
        first = bench.begins()
        item = bench.says(mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 0, 1, 0, 5, 0, 0, 1, 1, 0))
        assert bench.sent == [item]
        await until(lambda: disk.waits)
        disk.gives_in(0)
        await until(lambda: len(bench.sent) == 2)
        # Begun anew in the same transfer: the disk has its plan.
        again = bench.says(count())
        assert bench.sent == [item, first, again]
        bench.upload = None
        alone = bench.says(count())
        assert bench.sent[-1] is alone

    run(scenario)


def test_words_said_again_meanwhile_are_said_once() -> None:
    async def scenario() -> None:
        disk = Disk()
        bench = Bench(disk)
        bench.begins()
        again = bench.says(count())
        await until(lambda: disk.waits)
        disk.gives_in(0)
        await until(lambda: bench.sent)
        await settled()
        assert len(bench.sent) == 1
        assert bench.sent[0] is again
        assert len(disk.waits) == 1

    run(scenario)


@pytest.mark.parametrize("released_first", [0, 1])
def test_another_upload_waits_for_its_own_plan(released_first: int) -> None:
    async def scenario() -> None:
        disk = Disk()
        bench = Bench(disk)
        bench.begins()
        await until(lambda: len(disk.waits) == 1)
        disk.position = 2
        second = bench.begins()
        await until(lambda: len(disk.waits) == 2)
        disk.gives_in(released_first)
        if released_first == 0:
            assert bench.sent == []
        disk.gives_in(1 - released_first)
        await until(lambda: bench.sent)
        await settled()
        assert len(bench.sent) == 1
        assert bench.sent[0] is second
        assert [what for what, _ in disk.waits] == [1, 2]

    run(scenario)


def test_who_takes_the_boat_meanwhile_hears_no_more_of_it() -> None:
    async def scenario() -> None:
        disk = Disk()
        bench = Bench(disk)
        bench.begins()
        await until(lambda: disk.waits)
        bench.upload = None
        disk.gives_in(0)
        await settled()
        assert bench.sent == []

    run(scenario)


def test_without_a_journal_the_checkpoint_must_do() -> None:
    async def scenario() -> None:
        disk = Disk()
        bench = Bench(None, disk)
        first = bench.begins()
        await until(lambda: disk.waits)
        assert bench.sent == []
        disk.gives_in(0)
        await until(lambda: bench.sent)
        assert bench.sent == [first]
        assert [what for what, _ in disk.waits] == ["checkpoint"]

    run(scenario)


def test_where_nothing_is_kept_nothing_waits() -> None:
    bench = Bench(None)
    first = bench.begins()
    assert bench.sent == [first]
