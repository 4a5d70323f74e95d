"""Missions over links that lose, double, reorder and damage, against the simulated autopilot, in simulated time."""

import heapq
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission import MissionTransfer, Route, Verified, missions_equal, waypoint
from sim.autopilot.machine import Autopilot, Options
from sim.link import BadLink
from sim.vessel import Position, Vessel

TICK_S = 0.02
UPLOADS = 100
BAD: dict[str, Any] = {"loss": 0.2, "duplication": 0.2, "jitter_s": 0.2}
WORSE: dict[str, Any] = {
    "loss": 0.3,
    "duplication": 0.1,
    "reordering": 0.1,
    "corruption": 0.01,
    "jitter_s": 0.2,
}
ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)


class Lane:
    """One direction of a bad link, with what is under way on it; late packets overtake each other."""

    def __init__(self, link: BadLink) -> None:
        self._link = link
        self._queue: list[tuple[float, int, bytes]] = []
        self._sent = 0

    def send(self, now: float, data: bytes) -> None:
        for at, packet in self._link.transmit(now, data):
            self._sent += 1
            heapq.heappush(self._queue, (at, self._sent, packet))

    def due(self, now: float) -> list[bytes]:
        packets = []
        while self._queue and self._queue[0][0] <= now:
            packets.append(heapq.heappop(self._queue)[2])
        return packets


class Run:
    """A transfer and an autopilot with a bad link between them, on a clock of their own."""

    def __init__(self, transfer: MissionTransfer, autopilot: Autopilot, up: Lane, down: Lane) -> None:
        self.transfer, self.autopilot, self.up, self.down = transfer, autopilot, up, down
        self.ours, self.theirs = Codec(1, 191), Codec(1, 1)
        self.now = 0.0

    def _send(self, messages: list[Any]) -> None:
        for message in messages:
            self.up.send(self.now, self.ours.encode(message))

    def _answer(self, outgoing: list[tuple[Any, Any]]) -> None:
        for _, message in outgoing:
            self.down.send(self.now, self.theirs.encode(message))

    def command(self, *fields: float) -> None:
        """A COMMAND_LONG of the operator, over a good link."""
        order = mavlink.MAVLink_command_long_message(
            1, 1, fields[0], 0, *fields[1:], *[0] * (8 - len(fields))
        )
        (message,) = self.theirs.decode(Codec(255, 190).encode(order))
        self.autopilot.handle(self.now, message, "operator")

    def sail(self, seconds: float) -> None:
        self._answer(self.autopilot.advance(self.now, seconds))

    def finish(self) -> None:
        self._send(self.transfer.start(self.now))
        while self.transfer.outcome is None:
            self.now += TICK_S
            for packet in self.up.due(self.now):
                for message in self.theirs.decode(packet):
                    self._answer(self.autopilot.handle(self.now, message, "companion"))
            self._answer(self.autopilot.advance(self.now, TICK_S))
            for packet in self.down.due(self.now):
                for message in self.ours.decode(packet):
                    self._send(self.transfer.handle(self.now, message))
            deadline = self.transfer.next_deadline()
            if deadline is not None and deadline <= self.now:
                self._send(self.transfer.on_deadline(self.now))


def mission(rng: np.random.Generator, length: int) -> list[Any]:
    places = rng.uniform(-0.05, 0.05, size=(length, 2))
    return [waypoint(33.5 + lat, -118.5 + lon, acceptance_radius_m=5.0) for lat, lon in places]


def upload(seed: int, length: int, link: Mapping[str, Any], **options: Any) -> Run:
    rng = np.random.default_rng(seed)
    autopilot = Autopilot(Vessel(Position(33.5, -118.5)), options=Options(**options))
    lanes = (Lane(BadLink(rng, **link)) for _ in range(2))
    run = Run(MissionTransfer(mission(rng, length), ROUTE), autopilot, *lanes)
    run.finish()
    return run


def in_auto(seed: int, items: list[Any]) -> Run:
    """A boat that sails `items` in AUTO, with a bad link to us."""
    rng = np.random.default_rng(seed)
    autopilot = Autopilot(Vessel(Position(33.5, -118.5)))
    run = Run(MissionTransfer(items, ROUTE), autopilot, *(Lane(BadLink(rng, **BAD)) for _ in range(2)))
    run.finish()
    run.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    run.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 10)
    assert autopilot.navigator.armed
    assert autopilot.navigator.mode == 10
    return run


def renew(run: Run, items: list[Any]) -> None:
    run.transfer = MissionTransfer(items, ROUTE, make_current=True, limit_s=120.0)
    run.finish()
    assert isinstance(run.transfer.outcome, Verified), run.transfer.outcome
    assert on_board(run.autopilot) == [(item.x, item.y) for item in items]
    assert run.autopilot.navigator.current == 1
    assert run.autopilot.navigator.mission_state == mavlink.MISSION_STATE_ACTIVE


def on_board(autopilot: Autopilot) -> list[tuple[int, int]]:
    return [(item.x, item.y) for item in autopilot.store.items(0)[1:]]


@pytest.mark.parametrize("seed", range(UPLOADS))
def test_thirty_items_over_a_link_that_loses_doubles_mixes_up_and_damages_them(seed: int) -> None:
    run = upload(seed, 30, WORSE)
    assert isinstance(run.transfer.outcome, Verified), run.transfer.outcome
    assert run.now <= 60.0
    assert on_board(run.autopilot) == [(item.x, item.y) for item in run.transfer.items]


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    length=st.integers(1, 20),
    loss=st.floats(0, 0.5),
    doubled=st.floats(0, 0.5),
    damaged=st.floats(0, 0.2),
    delay_s=st.floats(0, 0.6),
    request_int=st.booleans(),
)
def test_verified_means_on_board_whatever_the_link_does(
    seed: int, length: int, loss: float, doubled: float, damaged: float, delay_s: float, request_int: bool
) -> None:
    link = {"loss": loss, "duplication": doubled, "corruption": damaged, "jitter_s": delay_s}
    run = upload(seed, length, link, request_int=request_int)
    if isinstance(run.transfer.outcome, Verified):
        assert missions_equal(run.transfer.items, run.transfer.outcome.mission)
        assert on_board(run.autopilot) == [(item.x, item.y) for item in run.transfer.items]
    else:
        assert run.transfer.outcome is not None
        assert run.transfer.outcome.on_board_unknown
    assert run.transfer.next_deadline() is None
    assert run.now <= 60.0 + 2 * TICK_S


@pytest.mark.parametrize("seed", range(5))
def test_a_shorter_mission_replaces_one_that_is_being_sailed(seed: int) -> None:
    near = [waypoint(33.5 + n * 1e-4, -118.5, acceptance_radius_m=5.0) for n in range(1, 9)]
    run = in_auto(seed, [*near, *mission(np.random.default_rng(seed), 5)])
    run.sail(60.0)
    assert run.autopilot.navigator.current > 4
    renew(run, mission(np.random.default_rng(seed + 100), 3))


@pytest.mark.parametrize("seed", range(5))
def test_a_complete_mission_is_replaced_and_started(seed: int) -> None:
    run = in_auto(seed, [waypoint(33.5001, -118.5, acceptance_radius_m=5.0)])
    run.sail(60.0)
    assert run.autopilot.navigator.mission_state == mavlink.MISSION_STATE_COMPLETE
    renew(run, mission(np.random.default_rng(seed + 100), 3))
