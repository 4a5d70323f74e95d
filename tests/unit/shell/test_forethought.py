"""What a conversation about the mission begins with waits for the checkpoints, and for nothing else."""

import asyncio
from collections.abc import Callable, Coroutine
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.shell.forethought import PATIENCE_S, Forethought

Scenario = Callable[[], Coroutine[Any, Any, None]]


class HurriedLoop(asyncio.SelectorEventLoop):
    """Its clock jumps to the next deadline instead of waiting for it."""

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0

    def time(self) -> float:
        return self._now

    def _run_once(self) -> None:
        if not self._ready and self._scheduled:  # type: ignore[attr-defined]
            self._now = max(self._now, self._scheduled[0].when())  # type: ignore[attr-defined]
        super()._run_once()  # type: ignore[misc]


def run(scenario: Scenario) -> None:
    with asyncio.Runner(loop_factory=HurriedLoop) as runner:
        runner.run(scenario())


def count(mission_type: int = mavlink.MAV_MISSION_TYPE_MISSION) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, 20, mission_type)


def request_list(mission_type: int = mavlink.MAV_MISSION_TYPE_MISSION) -> Any:
    return mavlink.MAVLink_mission_request_list_message(1, 1, mission_type)


class Bench:
    """Forethought, checkpoints that are on the disk or not yet, the conversation that goes on, what has gone out."""

    def __init__(self) -> None:
        self.checkpoints = SimpleNamespace(is_settled=True)
        self.conversation: object | None = None
        self.sent: list[Any] = []
        self.subject = Forethought(self.checkpoints, lambda: self.conversation, self.sent.append)  # type: ignore[arg-type]

    def begins(self, first_word: Any) -> Any:
        """Another conversation."""
        self.conversation = SimpleNamespace()
        return self.says(first_word)

    def says(self, message: Any) -> Any:
        self.subject.send(message)
        return message


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.mark.parametrize("first_word", [count, request_list])
def test_a_conversation_begins_when_the_disk_has_the_plan(
    bench: Bench, first_word: Callable[[], Any]
) -> None:
    async def scenario() -> None:
        bench.checkpoints.is_settled = False
        first = bench.begins(first_word())
        await asyncio.sleep(0.9 * PATIENCE_S)
        assert bench.sent == []
        bench.checkpoints.is_settled = True
        await asyncio.sleep(0.05 * PATIENCE_S)
        assert bench.sent == [first]
        # Said again in the same conversation: what is being written by now is no plan of its.
        bench.checkpoints.is_settled = False
        assert bench.says(first_word()) is bench.sent[-1]

    run(scenario)


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 0, 1, 0, 5, 0, 0, 1, 1, 0),
        mavlink.MAVLink_mission_ack_message(1, 1, 0),
        count(mavlink.MAV_MISSION_TYPE_FENCE),
        request_list(mavlink.MAV_MISSION_TYPE_RALLY),
    ],
)
def test_nothing_else_waits(bench: Bench, message: Any) -> None:
    bench.checkpoints.is_settled = False
    bench.conversation = SimpleNamespace()
    bench.says(message)
    assert bench.sent == [message]


def test_where_all_is_written_nothing_waits(bench: Bench) -> None:
    first = bench.begins(count())
    assert bench.sent == [first]


def test_where_nothing_is_kept_nothing_waits() -> None:
    sent: list[Any] = []
    Forethought(None, SimpleNamespace, sent.append).send(count())
    assert len(sent) == 1


def test_words_said_again_meanwhile_are_said_once(bench: Bench) -> None:
    async def scenario() -> None:
        bench.checkpoints.is_settled = False
        bench.begins(count())
        await asyncio.sleep(0.5 * PATIENCE_S)
        again = bench.says(count())
        bench.checkpoints.is_settled = True
        await asyncio.sleep(2.0 * PATIENCE_S)
        assert len(bench.sent) == 1
        assert bench.sent[0] is again

    run(scenario)


def test_of_two_conversations_only_the_one_that_goes_on_is_begun(bench: Bench) -> None:
    async def scenario() -> None:
        bench.checkpoints.is_settled = False
        bench.begins(count())
        await asyncio.sleep(0.5 * PATIENCE_S)
        second = bench.begins(count())
        await asyncio.sleep(0.9 * PATIENCE_S)  # the first one's patience is over
        assert bench.sent == []
        bench.checkpoints.is_settled = True
        await asyncio.sleep(2.0 * PATIENCE_S)
        assert len(bench.sent) == 1
        assert bench.sent[0] is second

    run(scenario)


def test_who_takes_the_boat_meanwhile_hears_no_more_of_it(bench: Bench) -> None:
    async def scenario() -> None:
        bench.checkpoints.is_settled = False
        bench.begins(count())
        await asyncio.sleep(0.5 * PATIENCE_S)
        bench.conversation = None
        bench.checkpoints.is_settled = True
        await asyncio.sleep(2.0 * PATIENCE_S)
        assert bench.sent == []

    run(scenario)


def test_a_disk_that_takes_nothing_holds_nothing_up_for_ever(
    bench: Bench, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        bench.checkpoints.is_settled = False
        first = bench.begins(count())
        await asyncio.sleep(0.99 * PATIENCE_S)
        assert bench.sent == []
        await asyncio.sleep(0.02 * PATIENCE_S)
        assert bench.sent == [first]
        assert "the disk has not taken the newest plan in 3 s" in caplog.text

    run(scenario)
