"""Plans on their way on board, against the simulated autopilot: one at a time, and only the newest waits."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.dispatch import Dispatched, MissionDispatch
from autonomy.mavlink.authority import Authority, OnBoard
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission import Route, waypoint
from autonomy.mavlink.vehicle import VehicleState
from autonomy.planning.plan import Plan
from sim.autopilot import Autopilot, Mode, transfer
from sim.autopilot.missions import MissionItem
from sim.router import Router
from sim.vessel import Position, Vessel

START = Position(33.5, -118.5)
ROUTE = Route(1, 191, 1, 1)


def dispatched(name: str, count: int = 5) -> Dispatched:
    shift = sum(map(ord, name)) * 1e-3
    points = [(START.lat_deg + shift, START.lon_deg + 1e-3 * k) for k in range(1, count + 1)]
    plan = Plan(np.zeros(2), np.zeros((count, 2)), np.ones(count, dtype=bool), 0.0, "paper", name)
    return Dispatched(plan, tuple(waypoint(lat, lon, acceptance_radius_m=5.0) for lat, lon in points))


class Bench:
    """A dispatch on a link to a vehicle; `passes` says which of our messages the link carries."""

    def __init__(self, adopt: bool = False) -> None:
        self.authority = Authority(adopt)
        self.dispatch = MissionDispatch(self.authority)
        self.autopilot = Autopilot(Vessel(START))
        self.router = Router(self.autopilot)
        self.codec, self.station = Codec(1, 191), Codec(255, 190)
        self.now = 500.0
        self.sent: list[tuple[float, Any]] = []
        self.notes: list[str] = []
        self.passes: Callable[[Any], bool] = lambda message: True
        self.router.join(self.now, "us")

    @property
    def state(self) -> VehicleState:
        navigator = self.autopilot.navigator
        return VehicleState(
            1, 1, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, mavlink.MAV_TYPE_SURFACE_BOAT, int(navigator.mode),
            navigator.armed, mavlink.MAV_STATE_ACTIVE,
            mission_total=self.autopilot.store.total or None, mission_state=int(navigator.mission_state),
        )  # fmt: skip

    def send(self, messages: list[Any]) -> None:
        for message in messages:
            self.sent.append((self.now, message))
            if self.passes(message):
                self.hear(self.router.receive(self.now, "us", self.codec.encode(message)))

    def hear(self, packets: list[tuple[Any, bytes]]) -> None:
        for client, packet in packets:
            if client == "us":
                for message in self.codec.decode(packet, "vehicle"):
                    self.send(self.dispatch.handle(self.now, message))

    def turn(self) -> None:
        self.authority.observe(self.state)
        self.send(self.dispatch.step(self.now, self.state, ROUTE, 1.0))
        deadline = self.dispatch.next_deadline()
        assert deadline is None or deadline > self.now, "a deadline in the past would make a service spin"
        self.notes += [note.text for note in self.dispatch.take_notes()]

    def advance(self, duration_s: float, until: Callable[[], bool] = lambda: False) -> bool:
        end = self.now + duration_s
        while self.now < end and not until():
            self.turn()
            self.now += 0.25
            self.hear(self.router.advance(self.now, 0.25))
        return until()

    def operator(self, message: Any) -> None:
        self.hear(self.router.receive(self.now, "operator", self.station.encode(message)))

    def start(self, first: Dispatched) -> None:
        """Bring a first plan on board and let the operator start."""
        self.advance(1.0)
        self.dispatch.offer(first)
        assert self.advance(5.0, until=lambda: self.dispatch.active is first)
        self.autopilot.navigator.armed = True
        self.autopilot.navigator.set_mode(Mode.AUTO)
        self.advance(1.0)
        assert self.authority.in_command

    def counts(self) -> int:
        return sum(each.get_type() == "MISSION_COUNT" for _, each in self.sent)

    def place(self, items: tuple[Any, ...]) -> None:
        """A mission that came on board some other way."""
        self.autopilot.store.truncate(0)
        for seq, item in enumerate((items[0], *items)):
            self.autopilot.store.write(
                seq, MissionItem(item.frame, item.command, (0.0,) * 4, item.x, item.y, 0.0)
            )

    def answer(self, message: Any) -> None:
        """The vehicle says something of its own, in answer to the message that is being sent."""
        for heard in self.codec.decode(Codec(1, 1).encode(message), "vehicle"):
            self.send(self.dispatch.handle(self.now, heard))

    def refuse(self, result: int) -> None:
        """The vehicle answers every announcement of a mission with this result."""

        def passes(message: Any) -> bool:
            if message.get_type() != "MISSION_COUNT":
                return True
            self.answer(mavlink.MAVLink_mission_ack_message(1, 191, result, 0))
            return False

        self.passes = passes

    def said(self, kind: str, since: float = 0.0) -> list[float]:
        """When a kind of message was sent."""
        return [time for time, each in self.sent if each.get_type() == kind and time > since]

    def stall_after(self, items: int) -> None:
        left = iter(range(items))
        self.passes = lambda message: message.get_type() != "MISSION_ITEM_INT" or next(left, None) is not None

    def unstall(self) -> None:
        self.passes = lambda message: True

    def on_board(self) -> list[tuple[int, int]]:
        return [
            (self.autopilot.store[k].x, self.autopilot.store[k].y)
            for k in range(1, len(self.autopilot.store))
        ]


def places(each: Dispatched) -> list[tuple[int, int]]:
    return [(item.x, item.y) for item in each.items]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_what_is_on_board_is_read_first(bench):
    assert bench.authority.on_board is OnBoard.UNREAD
    bench.advance(1.0)
    assert bench.authority.on_board is OnBoard.EMPTY
    assert bench.notes == ["0 waypoints on board: no mission on board"]
    assert bench.dispatch.next_deadline() is None
    assert bench.counts() == 0


def test_a_plan_comes_on_board_once(bench):
    first = dispatched("first")
    bench.advance(1.0)
    bench.dispatch.offer(first)
    assert bench.dispatch.busy
    assert bench.advance(5.0, until=lambda: bench.dispatch.active is first)
    assert not bench.dispatch.busy
    bench.advance(60.0)
    assert bench.counts() == 1
    assert bench.on_board() == places(first)


def test_a_running_transfer_is_let_end_and_only_the_newest_plan_waits(bench):
    bench.start(dispatched("first"))
    second, third, fourth = (dispatched(name) for name in ("second", "third", "fourth"))
    bench.stall_after(2)
    bench.dispatch.offer(second)
    bench.advance(2.0)
    bench.dispatch.offer(third)
    bench.dispatch.offer(fourth)
    bench.advance(2.0)
    bench.unstall()
    seen = []
    bench.advance(30.0, until=lambda: seen.append(bench.dispatch.active) or bench.dispatch.active is fourth)
    assert list(dict.fromkeys(each.plan.reason for each in seen)) == [
        "first",
        "second",
        "fourth",
    ]
    assert bench.counts() == 3
    assert bench.on_board() == places(fourth)
    assert bench.autopilot.navigator.current == 1


def test_a_failed_transfer_is_read_back_and_sent_again(bench):
    bench.start(dispatched("first", 6))
    second = dispatched("second", 4)
    bench.stall_after(2)
    bench.dispatch.offer(second)
    assert bench.advance(120.0, until=lambda: any("transfer failed" in note for note in bench.notes))
    assert bench.authority.on_board is OnBoard.DAMAGED
    assert len(bench.on_board()) == 4  # two of the new ones, two of the old ones
    bench.unstall()
    assert bench.advance(30.0, until=lambda: bench.dispatch.active is second)
    assert bench.on_board() == places(second)
    assert bench.authority.on_board is OnBoard.OURS


def test_a_newer_plan_replaces_one_whose_transfer_failed(bench):
    bench.start(dispatched("first"))
    second, third = dispatched("second"), dispatched("third")
    bench.stall_after(1)
    bench.dispatch.offer(second)
    bench.advance(1.0)
    bench.dispatch.offer(third)
    assert bench.advance(120.0, until=lambda: any("transfer failed" in note for note in bench.notes))
    bench.unstall()
    assert bench.advance(30.0, until=lambda: bench.dispatch.active is not None and not bench.dispatch.busy)
    assert bench.dispatch.active is third


def test_a_link_that_was_gone_leaves_a_mixture_that_is_ours_to_mend(bench):
    bench.start(dispatched("first"))
    second = dispatched("second")
    bench.stall_after(2)
    bench.dispatch.offer(second)
    bench.advance(2.0)
    bench.dispatch.forget()
    bench.advance(10.0)
    assert bench.authority.on_board is OnBoard.DAMAGED
    bench.unstall()
    assert bench.advance(60.0, until=lambda: bench.dispatch.active is second)


def test_a_mission_that_came_after_a_failed_transfer_is_not_taken_for_its_remains(bench):
    bench.start(dispatched("first"))
    bench.stall_after(2)
    bench.dispatch.offer(dispatched("second"))
    bench.advance(2.0)
    bench.dispatch.forget()
    theirs = dispatched("theirs", 3)
    bench.place(theirs.items)
    bench.unstall()
    bench.advance(60.0)
    assert bench.authority.on_board is OnBoard.REPLACED
    assert bench.on_board() == places(theirs)
    assert not bench.dispatch.busy
    permission = bench.dispatch.permission(bench.state)
    assert not permission.allowed
    assert "another mission on board in place of ours" in permission.reason


@pytest.mark.parametrize("adopt", [False, True])
def test_a_mission_of_equal_length_is_seen_before_it_would_be_overwritten(adopt):
    bench = Bench(adopt)
    bench.start(dispatched("first"))
    theirs = dispatched("theirs")
    bench.place(theirs.items)
    bench.advance(5.0)
    assert bench.authority.on_board is OnBoard.OURS  # nobody has told the dispatch yet
    bench.dispatch.offer(dispatched("second"))
    bench.advance(30.0)
    assert bench.on_board() == places(theirs)
    assert bench.authority.on_board is OnBoard.REPLACED
    assert not bench.dispatch.busy


def test_a_doubt_has_the_mission_read_while_what_we_know_of_it_holds():
    bench = Bench()
    bench.start(dispatched("first"))
    bench.autopilot.navigator.set_mode(Mode.AUTO)
    bench.autopilot.navigator.armed = True
    bench.turn()
    known = len(bench.said("MISSION_REQUEST_LIST"))
    bench.dispatch.doubt("the boat sails elsewhere")
    bench.turn()
    assert bench.authority.on_board is OnBoard.OURS
    bench.advance(5.0)
    assert len(bench.said("MISSION_REQUEST_LIST")) == known + 1
    assert bench.authority.on_board is OnBoard.OURS
    bench.place(dispatched("theirs").items)
    bench.dispatch.doubt("the boat sails elsewhere")
    bench.advance(5.0)
    assert bench.authority.on_board is OnBoard.REPLACED
    assert not bench.authority.in_command


def test_a_doubt_is_kept_until_the_mission_could_be_read(bench):
    bench.start(dispatched("first"))
    bench.place(dispatched("theirs").items)
    bench.passes = lambda message: message.get_type() != "MISSION_REQUEST_LIST"
    bench.dispatch.doubt("the boat sails elsewhere")
    assert bench.advance(60.0, until=lambda: "could not be read" in "".join(bench.notes))
    assert bench.authority.on_board is OnBoard.OURS
    bench.unstall()
    assert bench.advance(5.0, until=lambda: bench.authority.on_board is OnBoard.REPLACED)


def test_a_mission_that_is_sailed_is_read_again_every_ten_minutes_and_one_that_is_not_never(bench):
    bench.start(dispatched("first"))
    bench.autopilot.navigator.set_mode(Mode.HOLD)
    bench.advance(1300.0)
    known = len(bench.said("MISSION_REQUEST_LIST"))
    bench.autopilot.navigator.set_mode(Mode.AUTO)
    bench.advance(10.0)
    begun = len(bench.said("MISSION_REQUEST_LIST"))
    assert begun == known + 1  # whoever had the boat may have changed it
    bench.advance(580.0)
    assert len(bench.said("MISSION_REQUEST_LIST")) == begun
    bench.place(dispatched("theirs").items)
    bench.advance(20.0)
    assert len(bench.said("MISSION_REQUEST_LIST")) == begun + 1
    assert bench.authority.on_board is OnBoard.REPLACED
    bench.advance(700.0)
    assert len(bench.said("MISSION_REQUEST_LIST")) == begun + 1


def test_an_upload_of_somebody_else_between_look_and_upload_goes_first(bench):
    bench.start(dispatched("first"))
    theirs = dispatched("theirs", 3)

    def race(message):
        if message.get_type() == "MISSION_COUNT":
            bench.unstall()
            bench.operator(mavlink.MAVLink_mission_count_message(1, 1, 4, 0))
        return True

    bench.passes = race
    bench.dispatch.offer(dispatched("second"))
    bench.advance(1.5)
    bench.notes += [note.text for note in bench.dispatch.take_notes()]
    assert "somebody else is uploading a mission: ours waits" in bench.notes
    for seq, item in enumerate((theirs.items[0], *theirs.items)):
        bench.operator(item.to_message(ROUTE, seq))
    bench.advance(30.0)
    assert bench.on_board() == places(theirs)
    assert bench.authority.on_board is OnBoard.REPLACED
    assert not bench.dispatch.busy
    assert bench.counts() == 2


@pytest.mark.parametrize("count", [3, 5, 8])
def test_an_upload_of_somebody_else_before_our_read_back_stays(bench, count):
    """What is read back is then neither what we sent nor a part of it: sent again, ours would wipe it out."""
    bench.start(dispatched("first"))
    theirs = dispatched("theirs", count)

    def race(message):
        if message.get_type() == "MISSION_REQUEST_LIST" and bench.counts() == 2:
            bench.unstall()
            bench.operator(mavlink.MAVLink_mission_count_message(1, 1, count + 1, 0))
            for seq, item in enumerate((theirs.items[0], *theirs.items)):
                bench.operator(item.to_message(ROUTE, seq))
        return True

    bench.passes = race
    bench.dispatch.offer(dispatched("second"))
    bench.advance(60.0)
    assert bench.on_board() == places(theirs)
    assert bench.authority.on_board is OnBoard.REPLACED
    assert not bench.dispatch.busy
    assert bench.counts() == 2


@pytest.mark.parametrize("total", [4, 7, 0])
def test_another_length_is_looked_into_once(bench, total):
    bench.start(dispatched("first", 5))
    if total:
        bench.place(dispatched("theirs", total).items)
    else:
        bench.autopilot.store.truncate(0)
    lists = [each for _, each in bench.sent if each.get_type() == "MISSION_REQUEST_LIST"]
    for _ in range(20):
        bench.dispatch.compare(bench.state)
        bench.advance(1.0)
    again = [each for _, each in bench.sent if each.get_type() == "MISSION_REQUEST_LIST"]
    assert len(again) == len(lists) + 1
    assert bench.authority.on_board is (OnBoard.REPLACED if total else OnBoard.EMPTY)
    assert not bench.dispatch.permission(bench.state).allowed


def test_an_autopilot_that_counts_otherwise_is_asked_ever_more_rarely(bench):
    bench.start(dispatched("first", 5))
    begun = bench.now

    def reads():
        return len(bench.said("MISSION_REQUEST_LIST", begun))

    def told(total, duration_s):
        for _ in range(duration_s):
            bench.dispatch.compare(replace(bench.state, mission_total=total))
            bench.advance(1.0)

    told(10, 300)
    assert 3 < reads() < 10
    assert bench.authority.on_board is OnBoard.OURS
    known = reads()
    bench.place(dispatched("theirs", 7).items)
    told(12, 2)
    assert reads() == known + 1, "another number is another matter"
    assert bench.authority.on_board is OnBoard.REPLACED


@pytest.mark.parametrize("total", [None, 5, 6])
def test_a_length_that_may_count_home_is_no_reason_to_look(bench, total):
    bench.start(dispatched("first", 5))
    state = VehicleState(1, 1, 3, 11, 10, True, 4, mission_total=total, mission_state=3)
    bench.dispatch.compare(state)
    assert bench.authority.on_board is OnBoard.OURS


def test_a_mission_that_is_verified_but_not_sailed_is_sent_again(bench):
    bench.start(dispatched("first"))
    second = dispatched("second")
    bench.passes = lambda message: message.get_type() != "COMMAND_LONG"
    bench.dispatch.offer(second)
    bench.dispatch.reached = 5
    assert bench.advance(120.0, until=lambda: any("transfer failed" in note for note in bench.notes))
    assert bench.dispatch.active is second
    assert bench.dispatch.reached == 0
    assert bench.dispatch.busy
    bench.dispatch.reached = 3  # the boat sails some of it, from somewhere in its middle
    bench.unstall()
    assert bench.advance(30.0, until=lambda: not bench.dispatch.busy)
    assert bench.dispatch.reached == 0
    assert bench.autopilot.navigator.current == 1


@pytest.mark.parametrize("result", [2, 3, 5, 7, 11])
def test_a_plan_that_is_refused_is_given_up_and_said_once(bench, result):
    first = dispatched("first")
    bench.start(first)
    bench.refuse(result)
    began = bench.now
    bench.dispatch.offer(dispatched("second"))
    bench.advance(120.0)
    assert len(bench.said("MISSION_COUNT", since=began)) == 1
    assert not bench.dispatch.busy
    assert bench.authority.on_board is OnBoard.OURS
    assert bench.dispatch.active is first
    assert "the vehicle refuses the mission" in bench.dispatch.take_refusal()
    assert bench.dispatch.take_refusal() is None
    bench.unstall()
    third = dispatched("third")
    bench.dispatch.offer(third)
    assert bench.advance(10.0, until=lambda: bench.dispatch.active is third)


def test_a_plan_that_is_too_long_goes_on_board_in_part_and_so_does_every_other(bench, monkeypatch):
    monkeypatch.setattr(transfer, "MOST_ITEMS", 12)
    first, long = dispatched("first"), dispatched("long", 40)
    bench.start(first)
    bench.dispatch.offer(long)
    assert bench.advance(60.0, until=lambda: not bench.dispatch.busy)
    assert bench.dispatch.take_refusal() is None
    assert bench.dispatch.active.plan is long.plan
    assert bench.dispatch.active.items == long.items[:10]  # the half, and again the half, fits
    assert not bench.dispatch.active.is_whole
    announced = len(bench.said("MISSION_COUNT"))
    bench.dispatch.offer(dispatched("longer", 50))
    assert bench.advance(60.0, until=lambda: not bench.dispatch.busy)
    assert len(bench.dispatch.active.items) == 10
    assert len(bench.said("MISSION_COUNT")) == announced + 1


def test_a_plan_that_may_not_be_made_current_is_given_up_too(bench):
    bench.start(dispatched("first"))
    second = dispatched("second")

    def passes(message):
        if message.get_type() != "COMMAND_LONG":
            return True
        bench.answer(mavlink.MAVLink_command_ack_message(message.command, 2, 0, 0, 1, 191))
        return False

    bench.passes = passes
    bench.dispatch.offer(second)
    bench.advance(120.0)
    assert bench.counts() == 2
    assert len(bench.said("COMMAND_LONG")) == 1
    assert bench.dispatch.active is second
    assert not bench.dispatch.busy
    assert "refuses to set the current mission item" in bench.dispatch.take_refusal()


def test_the_pause_doubles_and_the_fifth_failure_in_a_row_is_the_last(bench):
    bench.start(dispatched("first"))
    failed = []
    bench.passes = lambda message: message.get_type() != "MISSION_COUNT"
    began = bench.now
    bench.dispatch.offer(dispatched("second"))
    known = len(bench.notes)

    def has_failed():
        return sum("transfer failed" in note for note in bench.notes[known:]) > len(failed)

    while bench.advance(100.0, until=has_failed):
        failed.append(bench.now)
    assert len(failed) == 5
    looks = bench.said("MISSION_REQUEST_LIST", since=began)
    pauses = [min(look for look in looks if look > time - 0.5) - time for time in failed[:-1]]
    assert pauses == pytest.approx([2.0, 4.0, 8.0, 16.0], abs=0.6)
    assert not bench.dispatch.busy
    assert "(5 failures in a row)" in bench.dispatch.take_refusal()


def test_a_success_makes_the_pauses_short_again(bench):
    bench.start(dispatched("first"))
    for name in ("second", "third"):
        bench.passes = lambda message: message.get_type() != "MISSION_COUNT"
        bench.dispatch.offer(dispatched(name))
        known = len(bench.notes)
        assert bench.advance(
            60.0, until=lambda known=known: "transfer failed" in "".join(bench.notes[known:])
        )
        bench.unstall()
        assert bench.advance(4.0, until=lambda: not bench.dispatch.busy)


def test_what_is_on_board_is_not_uploaded_again_to_be_made_current(bench):
    bench.start(dispatched("first"))
    second = dispatched("second")
    bench.passes = lambda message: message.get_type() != "COMMAND_LONG"
    bench.dispatch.offer(second)
    assert bench.advance(120.0, until=lambda: any("transfer failed" in note for note in bench.notes))
    bench.unstall()
    assert bench.advance(30.0, until=lambda: not bench.dispatch.busy)
    assert bench.dispatch.active is second
    assert bench.counts() == 2  # the first and the second, once each
    assert bench.autopilot.navigator.current == 1


def test_what_was_interrupted_is_remembered_without_bounds_nowhere(bench):
    bench.start(dispatched("first"))
    second = dispatched("second")
    for _ in range(30):
        bench.dispatch._aboard.interrupted(second.items)
    assert len(bench.dispatch._aboard.sources) == 3  # with what is on board itself
    for k in range(30):
        bench.dispatch._aboard.interrupted(dispatched("x" * k).items)
    assert len(bench.dispatch._aboard.sources) <= 9


def test_failures_are_warnings_and_successes_none(bench):
    bench.advance(1.0)
    bench.refuse(4)
    bench.dispatch.offer(dispatched("first"))
    bench.authority.observe(bench.state)
    for _ in range(20):
        bench.send(bench.dispatch.step(bench.now, bench.state, ROUTE, 1.0))
        bench.now += 0.25
    warnings = {note.text: note.is_warning for note in bench.dispatch.take_notes()}
    assert [text for text, is_warning in warnings.items() if is_warning] == [
        "mission transfer failed: the vehicle refuses the mission: no space for so many items",
        "the plan is given up: the vehicle refuses the mission: no space for so many items",
    ]


def test_a_vehicle_that_does_not_answer_is_asked_again_after_a_pause(bench):
    bench.passes = lambda message: False
    bench.advance(60.0)
    failures = [note for note in bench.notes if "could not be read" in note]
    assert 2 <= len(failures) <= 10
    bench.unstall()
    bench.advance(10.0)
    assert bench.authority.on_board is OnBoard.EMPTY


def test_nothing_moves_while_the_operator_has_the_boat(bench):
    bench.start(dispatched("first"))
    bench.stall_after(2)
    bench.dispatch.offer(dispatched("second"))
    bench.advance(1.0)
    bench.autopilot.navigator.set_mode(Mode.HOLD)
    bench.turn()
    assert bench.sent[-1][1].get_type() == "MISSION_ACK"
    said = len(bench.sent)
    bench.dispatch.offer(dispatched("third"))
    bench.advance(60.0)
    assert len(bench.sent) == said
    assert not bench.dispatch.busy
    assert bench.dispatch.next_deadline() is None
