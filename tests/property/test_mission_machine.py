"""A mission on its way to a vehicle, packet by packet: lost, doubled, overtaken, damaged, while others upload too.

Rules decide what becomes of each packet and when time passes. HALOCLINE_EXAMPLES: how many sequences; without
it 200.
"""

import os
from typing import Any

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec
from autonomy.mavlink.mission import Failed, MissionTransfer, Route, Verified, waypoint
from autonomy.mavlink.mission import Phase as Doing
from sim.autopilot.missions import MissionStore
from sim.autopilot.transfer import MissionService
from sim.vessel import Position

ROUTE = Route(own_system=1, own_component=191, vehicle_system=1, vehicle_component=1)
COMPANION, STATION = "companion", "station"
LIMIT_S = 60.0
TICK_S = 0.05
READS = ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT")
which = st.floats(0, 1, exclude_max=True)


def places(items: Any) -> list[tuple[int, int]]:
    return [(item.x, item.y) for item in items]


class MissionMachine(RuleBasedStateMachine):
    """Our transfer, the autopilot's service, and the packets between them, each of which a rule may pick."""

    @initialize(request_int=st.booleans(), fussy=st.booleans())
    def begin(self, request_int: bool, fussy: bool) -> None:
        self.request_int, self.fussy = request_int, fussy
        self.vessel = MissionStore(Position(33.5, -118.5))
        self.missions = 0
        self.now = 0.0
        self.transfer: MissionTransfer | None = None
        self.up: list[bytes] = []
        self.down: list[bytes] = []
        self.station_up: list[bytes] = []
        self.station_items: list[Any] = []
        self.begun_at = 0.0
        self.we_wrote = self.others_wrote_since_read = False
        self.reboot()
        self.another_station_uploads_at_once(4)

    # The vehicle -------------------------------------------------------------------------------------------------

    @rule()
    def reboot(self) -> None:
        """An upload under way is forgotten, what is stored stays as it is."""
        self.service = MissionService(
            self.vessel,
            clearing_refused=lambda: False,
            request_int=self.request_int,
            ends_on_wrong_item=self.fussy,
        )
        self.theirs = Codec(1, 1)

    def on_board(self) -> list[tuple[int, int]]:
        return places(self.vessel.items(0)[1:])

    def hear(self, packet: bytes, client: str) -> None:
        """The vehicle takes a packet and answers."""
        for message in self.theirs.decode(packet):
            before = self.on_board(), len(self.vessel)
            self.answer(self.service.handle(self.now, message, client))
            if (self.on_board(), len(self.vessel)) != before:
                self.we_wrote = self.we_wrote or client == COMPANION
                self.others_wrote_since_read = self.others_wrote_since_read or client == STATION

    def answer(self, replies: list[tuple[Any, Any]]) -> None:
        for client, message in replies:
            packet = self.theirs.encode(message)
            if client == COMPANION:
                self.down.append(packet)
            elif client == STATION:
                self.station_hears(message)

    # Another station, over a good link from the vehicle, a slow one to it -----------------------------------------

    @precondition(lambda self: not self.station_up)
    @rule(length=st.integers(0, 3))
    def another_station_uploads(self, length: int) -> None:
        self.station_items = self.new_mission(length + 1)[: length + 1] if length else []
        self.station_says(mavlink.MAVLink_mission_count_message(1, 1, len(self.station_items), 0))

    def station_says(self, message: Any) -> None:
        self.station_up.append(Codec(255, 190).encode(message))

    def station_hears(self, message: Any) -> None:
        if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(
            self.station_items
        ):
            item = self.station_items[message.seq].to_message(ROUTE, message.seq)
            self.station_says(item)

    @precondition(lambda self: self.station_up)
    @rule(count=st.integers(1, 8))
    def station_goes_on(self, count: int) -> None:
        for _ in range(count):
            if self.station_up:
                self.hear(self.station_up.pop(0), STATION)

    @precondition(lambda self: not self.station_up)
    @rule(length=st.integers(1, 4))
    def another_station_uploads_at_once(self, length: int) -> None:
        self.another_station_uploads(length)
        self.station_goes_on(8)

    @precondition(lambda self: self.station_up)
    @rule()
    def station_falls_silent(self) -> None:
        self.station_up.clear()

    # We ----------------------------------------------------------------------------------------------------------

    def new_mission(self, length: int) -> list[Any]:
        self.missions += 1
        return [
            waypoint(33.5 + 1e-4 * self.missions, -118.5 + 1e-4 * n, acceptance_radius_m=5.0)
            for n in range(length)
        ]

    @property
    def talking(self) -> bool:
        return self.transfer is not None and self.transfer.outcome is None

    @precondition(lambda self: not self.talking)
    @rule(length=st.integers(1, 4))
    def we_begin(self, length: int) -> None:
        """What was under way of an earlier transfer has arrived or is lost by now."""
        self.up.clear()
        self.down.clear()
        self.ours = Codec(1, 191)
        self.transfer = MissionTransfer(self.new_mission(length), ROUTE, limit_s=LIMIT_S)
        self.begun_at = self.now
        self.we_wrote = self.others_wrote_since_read = False
        self.say(self.transfer.start(self.now))

    def say(self, messages: list[Any]) -> None:
        assert self.transfer is not None
        for message in messages:
            self.check_said(message.get_type())
            self.up.append(self.ours.encode(message))
        if self.transfer.outcome is not None:
            self.check_outcome(self.transfer.outcome)

    def check_said(self, kind: str) -> None:
        """One conversation at a time: we don't read while we upload, and announce nothing while we read."""
        assert self.transfer is not None
        if self.transfer.phase is Doing.UPLOADING:
            assert kind not in READS
        if self.transfer.phase is Doing.READING:
            assert kind != "MISSION_COUNT"

    def check_outcome(self, outcome: Any) -> None:
        assert self.transfer is not None
        if isinstance(outcome, Verified):
            assert places(outcome.mission) == places(self.transfer.items)
            # Reading takes a while: what somebody else puts on board meanwhile may go unseen this time.
            assert self.on_board() == places(self.transfer.items) or self.others_wrote_since_read
        else:
            assert isinstance(outcome, Failed)
            assert outcome.reason
            assert outcome.on_board is None
            if not outcome.on_board_unknown:
                assert not self.we_wrote
        assert self.transfer.next_deadline() is None

    def take(self, packet: bytes) -> None:
        for message in self.ours.decode(packet):
            if self.talking:
                assert self.transfer is not None
                reading = self.transfer.phase is Doing.READING
                self.say(self.transfer.handle(self.now, message))
                if not reading and self.transfer.phase is not Doing.READING:
                    self.others_wrote_since_read = False

    @precondition(lambda self: self.talking)
    @rule()
    def we_cancel(self) -> None:
        assert self.transfer is not None
        self.say(self.transfer.cancel())
        assert not self.talking

    # The link ----------------------------------------------------------------------------------------------------

    @precondition(lambda self: self.up or self.down)
    @rule(rounds=st.integers(1, 12))
    def all_goes_well(self, rounds: int) -> None:
        for _ in range(rounds):
            up, self.up = self.up, []
            for packet in up:
                self.hear(packet, COMPANION)
            down, self.down = self.down, []
            for packet in down:
                self.take(packet)

    @precondition(lambda self: self.up)
    @rule(place=which, keep=st.booleans())
    def one_reaches_the_vehicle(self, place: float, keep: bool) -> None:
        """Whichever: they overtake each other; kept, it will come again."""
        at = int(place * len(self.up))
        self.hear(self.up[at] if keep else self.up.pop(at), COMPANION)

    @precondition(lambda self: self.down)
    @rule(place=which, keep=st.booleans())
    def one_reaches_us(self, place: float, keep: bool) -> None:
        at = int(place * len(self.down))
        self.take(self.down[at] if keep else self.down.pop(at))

    @precondition(lambda self: self.up or self.down)
    @rule(upwards=st.booleans(), place=which, byte=which, bit=st.integers(0, 7))
    def one_is_damaged(self, upwards: bool, place: float, byte: float, bit: int) -> None:
        lane = self.up if upwards else self.down
        if not lane:
            return
        at = int(place * len(lane))
        packet = bytearray(lane[at])
        packet[int(byte * len(packet))] ^= 1 << bit
        lane[at] = bytes(packet)

    @precondition(lambda self: self.up or self.down)
    @rule(upwards=st.booleans(), place=which)
    def one_is_lost(self, upwards: bool, place: float) -> None:
        lane = self.up if upwards else self.down
        if lane:
            del lane[int(place * len(lane))]

    @rule(seconds=st.sampled_from([0.1, 0.3, 0.6, 1.6, 4.5, 9.5, 30.0]))
    def time_passes(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:
            self.now = min(until, self.now + TICK_S)
            self.answer(self.service.poll(self.now))
            self.ask_timers()

    def ask_timers(self) -> None:
        if not self.talking:
            return
        assert self.transfer is not None
        deadline = self.transfer.next_deadline()
        assert deadline is not None
        assert deadline <= self.begun_at + LIMIT_S
        if deadline <= self.now:
            self.say(self.transfer.on_deadline(self.now))

    # What holds whatever happens ---------------------------------------------------------------------------------

    @invariant()
    def it_ends_within_its_limit(self) -> None:
        if self.talking:
            assert self.now <= self.begun_at + LIMIT_S

    def teardown(self) -> None:
        """Silence would satisfy all of this: once the link is good and nobody meddles, a mission gets on board."""
        if not hasattr(self, "service"):
            return
        self.station_up.clear()
        if self.talking:
            self.we_cancel()
        self.we_begin(3)
        while self.talking:
            self.all_goes_well(1)
            self.time_passes(0.5)
            self.station_up.clear()
        assert self.transfer is not None
        assert isinstance(self.transfer.outcome, Verified), self.transfer.outcome
        assert self.on_board() == places(self.transfer.items)


TestMission = MissionMachine.TestCase
TestMission.settings = settings(
    max_examples=int(os.environ.get("HALOCLINE_EXAMPLES", "200")),
    stateful_step_count=50,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
