"""The desk: who may command, how many, which answers wait for the disk, and what is told of those who may not."""

import logging
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from autonomy import wire_commands as wire
from autonomy.effects import Answer, Outcome
from autonomy.events import CommandReceived
from autonomy.shell.command_desk import WAITING, CommandDesk

TOKEN = wire.Token(b"0123456789abcdefghij")
UTC_S = 1.7e9


class Payload(bytes):
    """As zenoh's: it has a length and can be made bytes of."""


class Query:
    """As zenoh's; what it was answered comes within the deadline, or never."""

    def __init__(self, payload: bytes | None) -> None:
        self.payload = None if payload is None else Payload(payload)
        self.error: str | None = None
        self.answer: tuple[Answer, bool] | None = None
        self.closed = threading.Event()

    def reply(self, key: str, payload: bytes, *, encoding: Any) -> None:
        assert key == "usv/boat1/command"
        assert str(encoding) == "application/cbor;halocline/command/3"
        self.answer = wire.decode_answer(payload, TOKEN)

    def reply_err(self, text: str) -> None:
        self.error = text

    def __enter__(self) -> "Query":
        return self

    def __exit__(self, *_: object) -> None:
        self.closed.set()

    def wait(self) -> "Query":
        assert self.closed.wait(20.0)
        return self


class Clock:
    def __init__(self) -> None:
        self.s = 1000.0

    def __call__(self) -> float:
        return self.s


class Disk:
    """A journal that syncs when it is let."""

    position = (1, 7)
    trouble = ""

    def __init__(self) -> None:
        self.free = threading.Event()
        self.synced: list[Any] = []

    def sync(self, at: Any, within_s: float) -> bool:
        self.synced.append(at)
        return self.free.wait(10.0)

    @property
    def status(self) -> "Disk":
        return self


def request(number: int = 1, token: wire.Token | None = TOKEN, **changes: Any) -> bytes:
    sound = wire.Request(number.to_bytes(16, "big"), "boat1", "replan", UTC_S, 30.0)
    return wire.encode_request(replace(sound, **changes), token)


@pytest.fixture
def make_desk() -> Iterator[Callable[..., CommandDesk]]:
    """`make_desk(**arguments)`: it hands over to `desk.handed`."""
    made: list[CommandDesk] = []

    def make(**arguments: Any) -> CommandDesk:
        sound = {"accepted": True, "token": TOKEN, "fresh": False, "utc_s": lambda: UTC_S, "clock": Clock()}
        desk = CommandDesk("boat1", **(sound | arguments))
        desk.handed = []  # type: ignore[attr-defined]
        desk.start(desk.handed.append)  # type: ignore[attr-defined]
        made.append(desk)
        return desk

    yield make
    for desk in made:
        desk.close()


def asked(desk: CommandDesk, payload: bytes | None) -> Query:
    query = Query(payload)
    desk.take(query)
    return query


def done(command: CommandReceived, outcome: Outcome = Outcome.DONE) -> Answer:
    return Answer(command.command_id, command.verb, outcome, "so it is", "paused", "", "AUTO", True, UTC_S)


def test_what_is_authorised_reaches_the_core_and_is_answered(make_desk: Any) -> None:
    desk = make_desk()
    query = asked(desk, request())
    assert desk.handed == [CommandReceived((1).to_bytes(16, "big"), "replan", UTC_S, 30.0, UTC_S)]
    assert not query.closed.is_set()
    desk.answered(done(desk.handed[0]))
    answer, recorded = query.wait().answer
    assert (answer.text, recorded) == ("so it is", False)
    assert desk.report == ""


def test_an_answer_waits_until_the_disk_has_it(make_desk: Any) -> None:
    disk = Disk()
    desk = make_desk(journal=disk)
    query = asked(desk, request())
    desk.answered(done(desk.handed[0]))
    assert not query.closed.wait(0.05)
    disk.free.set()
    assert query.wait().answer[1] is True
    assert disk.synced == [disk.position]


def test_whatever_one_answer_fails_over_the_next_is_given(
    make_desk: Any, caplog: pytest.LogCaptureFixture
) -> None:
    class Odd(Query):
        def reply(self, key: str, payload: bytes, *, encoding: Any) -> None:
            raise RuntimeError("zenoh has a bug")

    desk = make_desk()
    odd = Odd(request(1))
    desk.take(odd)
    desk.answered(done(desk.handed[0]))
    odd.wait()
    query = asked(desk, request(2))
    desk.answered(done(desk.handed[1]))
    assert query.wait().answer is not None
    assert "zenoh has a bug" in caplog.text


def test_a_disk_that_fails_is_told_of(make_desk: Any) -> None:
    disk = Disk()
    disk.trouble = "the disk is full"
    disk.free.set()
    desk = make_desk(journal=disk)
    query = asked(desk, request())
    desk.answered(done(desk.handed[0]))
    assert query.wait().answer[1] is False


@pytest.mark.parametrize(
    ("arguments", "payload", "says", "counted"),
    [
        ({"accepted": False, "token": None}, request(), "commands are off on this vehicle", "unauthorised"),
        ({}, request(token=None), "not sealed with the vehicle's token", "unauthorised"),
        ({}, request(token=wire.Token(b"another, of 16 bytes")), "sealed with another token", "unauthorised"),
        ({}, request(vehicle="boat2"), "vehicle: must be boat1 (got boat2)", "malformed"),
        ({}, None, "a payload of at most 4096 bytes", "malformed"),
        ({}, bytes(5000), "a payload of at most 4096 bytes", "malformed"),
        ({}, b"nonsense", "is not CBOR", "malformed"),
    ],
)
def test_who_may_not_is_told_why_and_nothing_is_done(
    make_desk: Any,
    caplog: pytest.LogCaptureFixture,
    arguments: dict[str, Any],
    payload: bytes,
    says: str,
    counted: str,
) -> None:
    desk = make_desk(**arguments)
    with caplog.at_level(logging.WARNING):
        query = asked(desk, payload).wait()
    assert says in query.error
    assert query.answer is None
    assert desk.handed == []
    assert desk.report.startswith(f"commands from ashore: 1 {counted}; the last: ")
    assert says in caplog.text


def test_strangers_are_counted_but_neither_answered_nor_logged_without_end(
    make_desk: Any, caplog: pytest.LogCaptureFixture
) -> None:
    desk = make_desk()
    queries = [asked(desk, b"nonsense") for _ in range(2000)]
    desk.close()
    assert sum(query.error is not None for query in queries) == 10
    assert len(caplog.records) == 4  # at 1, 10, 100 and 1000
    assert "2000 malformed" in desk.report
    assert desk.handed == []


def test_strangers_do_not_keep_the_operator_out(make_desk: Any) -> None:
    desk = make_desk()
    for _ in range(1000):
        asked(desk, b"nonsense")
    query = asked(desk, request())
    desk.answered(done(desk.handed[0]))
    assert query.wait().answer


def test_of_too_many_the_core_hears_few_and_the_rest_are_to_come_again(make_desk: Any) -> None:
    clock = Clock()
    desk = make_desk(clock=clock)
    queries = [asked(desk, request(k)) for k in range(15)]
    assert len(desk.handed) == 10
    assert all(query.wait().answer[0].outcome is Outcome.BUSY for query in queries[10:])
    clock.s += 3.0
    for command in list(desk.handed):
        desk.answered(done(command))
    for k in range(15, 20):
        asked(desk, request(k))
    assert len(desk.handed) == 13


@pytest.mark.parametrize("verb", ["pause", "finish", "return"])
def test_who_asks_for_too_much_keeps_nobody_from_stopping_the_boat(make_desk: Any, verb: str) -> None:
    """A script that asks for the status over and over, and one whose commands the core does not answer."""
    clock = Clock()
    desk = make_desk(clock=clock)
    for k in range(500):
        asked(desk, request(k, verb="status"))
    asked(desk, request(1000, verb=verb))
    assert desk.handed[-1].verb == verb
    for k in range(2 * WAITING):
        clock.s += 1.0
        asked(desk, request(2000 + k))
    asked(desk, request(3000, verb=verb))
    assert desk.handed[-1].verb == verb


def test_a_core_that_does_not_answer_is_asked_no_more_than_it_can_hold(make_desk: Any) -> None:
    clock = Clock()
    desk = make_desk(clock=clock)
    for k in range(2 * WAITING):
        clock.s += 1.0
        asked(desk, request(k))
    assert len(desk.handed) == WAITING


def test_repetitions_that_wait_together_are_all_answered(make_desk: Any) -> None:
    desk = make_desk()
    queries = [asked(desk, request()) for _ in range(3)]
    for command in desk.handed:
        desk.answered(done(command))
    assert [query.wait().answer[0].outcome for query in queries] == [Outcome.DONE] * 3


def test_what_an_earlier_run_may_have_done_is_not_done_again_by_one_that_knows_nothing(
    make_desk: Any,
) -> None:
    clock = Clock()
    desk = make_desk(fresh=True, clock=clock)
    clock.s += 10.0
    query = asked(desk, request(issued_utc_s=UTC_S - 11.0))
    assert query.wait().answer[0].outcome is Outcome.UNKNOWN
    asked(desk, request(2, issued_utc_s=UTC_S - 9.0))
    asked(desk, request(3, verb="status", issued_utc_s=UTC_S - 11.0))
    assert [command.verb for command in desk.handed] == ["replan", "status"]


def test_a_new_run_whose_clock_is_far_ahead_lets_the_core_say_so(make_desk: Any) -> None:
    """Not that nobody knows: the operator would be kept out for as long as the clock is wrong."""
    desk = make_desk(fresh=True)
    asked(desk, request(issued_utc_s=UTC_S - 5 * 3600.0))
    assert [command.verb for command in desk.handed] == ["replan"]
    unknown = asked(desk, request(2, issued_utc_s=UTC_S - 59.0)).wait()
    assert unknown.answer[0].outcome is Outcome.UNKNOWN


def test_what_the_core_refuses_shows_in_health(make_desk: Any) -> None:
    desk = make_desk()
    asked(desk, request())
    desk.answered(done(desk.handed[0], Outcome.REFUSED))
    assert desk.report == "commands from ashore: 1 refused; the last: replan: so it is"


def test_before_it_is_open_and_after_commands_are_to_come_again(make_desk: Any) -> None:
    desk = make_desk()
    desk.close()
    query = asked(desk, request())
    assert desk.handed == []
    assert query.error is None
