"""Reading the mission on board, or its fence or rally points: one sans-io state machine."""

from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import Mission, MissionItem, Route, has_home_item
from autonomy.mavlink.mission_upload import (
    ATTEMPTS,
    BUSY_INTERVAL_S,
    COUNT_INTERVAL_S,
    COUNT_REPEATS,
    ITEM_INTERVAL_S,
    SILENCE_S,
    retry_interval,
)

MOST_ITEMS = 1000
"""More than any mission of ours, and than ArduPilot keeps without a card; a greater number is not fetched."""

SLOW_ITEM_S = 0.5
"""Each announced item prolongs the limit by this: a slow radio needs it."""

_KINDS = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK")


class Download(Enum):
    """Where a download stands."""

    IDLE = "not started"
    LISTING = "waiting for the number of items"
    FETCHING = "asking for one item after the other"
    DONE = "all items are here"
    FAILED = "no answer"


class MissionDownload:
    """Reads the mission on board; with another `mission_type` the fence or the rally points.

    Theory of operation. Here we lead: the number of items first, then item after item, each request repeated
    until its item is here. Items that weren't asked for are doubles or late ones and are ignored.

        state      COUNT n              item k (asked for)    busy (14)         timer
        IDLE       -                    -                     -                 -
        LISTING    FETCHING [a]         -                     LISTING, later    list again [b]
        FETCHING   n differs: LISTING   FETCHING, last: DONE  LISTING, later    item again [c]
        DONE       -                    -                     -                 -
        FAILED     -                    -                     -                 -

    [a] n = 0: DONE. n above 1000: FAILED. [b] After twelve requests without an answer: FAILED. [c] After 4 s of
    silence: LISTING; after twelve attempts: FAILED. Other errors may be late echoes of an upload; true ones are
    the timer's. Whatever the vehicle says: after `limit_s` of protocol time, and half a second for each item of
    the longest mission it has announced, FAILED. A vehicle that does not know the mission type has none of it:
    DONE, empty.
    """

    def __init__(
        self,
        route: Route,
        *,
        autopilot: int,
        time_scale: float = 1.0,
        limit_s: float = 60.0,
        mission_type: int = mavlink.MAV_MISSION_TYPE_MISSION,
    ) -> None:
        self._route = route
        self.mission_type = mission_type
        # Fences and rally points have no item for home.
        self._has_home = mission_type == mavlink.MAV_MISSION_TYPE_MISSION and has_home_item(autopilot)
        self._time_scale = time_scale
        self._limit_s = limit_s
        self._began: float | None = None
        self._items: list[MissionItem] = []
        self._count = 0
        self._most = 0
        self._repeats = 0
        self._attempts = 0
        self._heard_at = 0.0
        self._deadline: float | None = None
        self.state = Download.IDLE
        self.reason = ""

    @property
    def mission(self) -> Mission | None:
        """The mission without home, once it is DONE; empty if there is none on board."""
        if self.state is not Download.DONE:
            return None
        return tuple(self._items[1:] if self._has_home else self._items)

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called."""
        return None if self._deadline is None else min(self._deadline, self._ends_at)

    def start(self, now: float) -> list[Any]:
        """Ask for the number of items."""
        self._began = now if self._began is None else self._began
        self._attempts += 1
        if self._attempts > ATTEMPTS:
            return self._fail(f"given up after {ATTEMPTS} attempts to read the mission")
        self.state = Download.LISTING
        self._repeats = 0
        return self._ask(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """React to one message of the vehicle; returns what to send."""
        kind = message.get_type()
        if self.state not in (Download.LISTING, Download.FETCHING):
            return []
        if kind not in _KINDS or not self._route.is_answer(message, self.mission_type):
            return []
        if kind == "MISSION_COUNT":
            return self._on_count(now, message.count)
        if kind == "MISSION_ITEM_INT":
            return self._on_item(now, message)
        unknown = message.type == mavlink.MAV_MISSION_UNSUPPORTED
        if unknown and self.mission_type != mavlink.MAV_MISSION_TYPE_MISSION:
            self.state, self._items, self._deadline = Download.DONE, [], None
        elif message.type == mavlink.MAV_MISSION_DENIED:
            self.state = Download.LISTING
            self._heard_at = now
            self._repeats = 0
            self._deadline = now + retry_interval(BUSY_INTERVAL_S, self._attempts, self._time_scale)
        return []

    def on_deadline(self, now: float) -> list[Any]:
        """Repeat what may have been lost, if it is time to."""
        if self._deadline is None or now < min(self._deadline, self._ends_at):
            return []
        if now >= self._ends_at:
            limit_s = self._limit_s + SLOW_ITEM_S * self._most
            return self._fail(f"not finished within {limit_s:g} s: {self.state.value}")
        if self.state is Download.LISTING and self._repeats + 1 >= COUNT_REPEATS:
            return self._fail("the vehicle doesn't answer the mission request list")
        if self.state is Download.FETCHING and now - self._heard_at >= SILENCE_S:
            return self.start(now)
        self._repeats += 1
        return self._ask(now)

    @property
    def _ends_at(self) -> float:
        assert self._began is not None
        return self._began + self._limit_s + SLOW_ITEM_S * self._most

    def _on_count(self, now: float, count: int) -> list[Any]:
        if self.state is Download.FETCHING:
            return [] if count == self._count else self.start(now)
        if count > MOST_ITEMS:
            return self._fail(
                f"the vehicle tells of {count} mission items, and {MOST_ITEMS} are read at most"
            )
        self._count, self._most = count, max(count, self._most)
        self._items = []
        return self._go_on(now)

    def _on_item(self, now: float, message: Any) -> list[Any]:
        if self.state is not Download.FETCHING or message.seq != len(self._items):
            return []
        self._items.append(MissionItem.from_message(message))
        return self._go_on(now)

    def _go_on(self, now: float) -> list[Any]:
        self._heard_at = now
        self._repeats = 0
        if len(self._items) < self._count:
            self.state = Download.FETCHING
            return self._ask(now)
        self.state = Download.DONE
        self._deadline = None
        route = self._route
        accepted = mavlink.MAV_MISSION_ACCEPTED
        return [
            mavlink.MAVLink_mission_ack_message(
                route.vehicle_system, route.vehicle_component, accepted, self.mission_type
            )
        ]

    def _ask(self, now: float) -> list[Any]:
        system, component = self._route.vehicle_system, self._route.vehicle_component
        if self.state is Download.LISTING:
            self._deadline = now + retry_interval(COUNT_INTERVAL_S, self._repeats, self._time_scale)
            return [mavlink.MAVLink_mission_request_list_message(system, component, self.mission_type)]
        self._deadline = now + retry_interval(ITEM_INTERVAL_S, self._repeats, self._time_scale)
        return [
            mavlink.MAVLink_mission_request_int_message(
                system, component, len(self._items), self.mission_type
            )
        ]

    def _fail(self, reason: str) -> list[Any]:
        self.state = Download.FAILED
        self.reason = reason
        self._deadline = None
        return []
