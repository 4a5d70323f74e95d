"""The vehicle's side of the mission protocol, with ArduPilot's habits.

Uploads: COUNT cuts the mission to size at once, then one request per item, the legacy MISSION_REQUEST by
default; a request is repeated after a second, and eight silent seconds end the upload with
MISSION_ACK(CANCELLED), leaving the hybrid of new and old items on board. An item out of turn is answered
INVALID_SEQUENCE and the upload goes on. Only fence and rally uploads are atomic.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from sim.autopilot import missions
from sim.autopilot.missions import MOST_ITEMS, STORED_TYPES, MissionItem, MissionStore, Refused

REPEAT_S = 1.0
GIVE_UP_S = 8.0

Replies = list[tuple[Hashable, Any]]


@dataclass
class _Upload:
    client: Hashable
    sender: tuple[int, int]
    mission_type: int
    count: int
    heard: float
    asked: float
    seq: int = 0
    points: list[MissionItem] = field(default_factory=list)


class MissionService:
    """Answers every message of the mission protocol; `poll` runs its timers."""

    def __init__(
        self,
        store: MissionStore,
        clearing_refused: Callable[[], bool],
        request_int: bool = False,
        stored: Callable[[int], None] = lambda mission_type: None,
        *,
        ends_on_wrong_item: bool = False,
        atomic: bool = False,
        stores: tuple[int, ...] = STORED_TYPES,
    ) -> None:
        """Serve a store.

        Args:
            store: what is on board.
            clearing_refused: whether a mission must not be cleared now (in AUTO).
            request_int: ask with MISSION_REQUEST_INT instead of ArduPilot's legacy MISSION_REQUEST.
            stored: called with the mission type when an upload is complete or a store was cleared.
            ends_on_wrong_item: an item out of turn ends the upload.
            atomic: a mission replaces the one before when it is complete.
            stores: mission types that it knows.
        """
        self._store = store
        self._clearing_refused = clearing_refused
        self._request_int = request_int
        self._stored = stored
        self._ends_on_wrong_item = ends_on_wrong_item
        self._atomic = atomic
        self._stores = stores
        self._upload: _Upload | None = None

    def handle(self, now: float, message: Any, client: Hashable) -> Replies:
        """Answer one message of the protocol; anything else is not answered."""
        kind = message.get_type()
        if kind == "MISSION_COUNT":
            return self._on_count(now, message, client)
        if kind in ("MISSION_ITEM_INT", "MISSION_ITEM"):
            return self._on_item(now, message, client)
        if kind == "MISSION_REQUEST_LIST":
            return self._on_request_list(message, client)
        if kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            return self._on_request(message, client)
        if kind == "MISSION_CLEAR_ALL":
            return self._on_clear(message, client)
        if kind == "MISSION_ACK":
            return self._on_ack(message)
        return []

    def poll(self, now: float) -> Replies:
        """Repeat a request that was not answered; give an upload up that went silent."""
        upload = self._upload
        if upload is None:
            return []
        if now - upload.heard >= GIVE_UP_S:
            self._upload = None
            return [
                (upload.client, _ack(upload.sender, mav.MAV_MISSION_OPERATION_CANCELLED, upload.mission_type))
            ]
        if now - upload.asked >= REPEAT_S:
            return [self._ask(now, upload)]
        return []

    def forget(self, client: Hashable) -> None:
        """A client is gone; its upload will time out like any other that went silent."""
        if self._upload is not None and self._upload.client == client:
            self._upload.client = None

    def _on_count(self, now: float, message: Any, client: Hashable) -> Replies:
        sender, kind = _sender(message), message.mission_type
        if kind not in self._stores:
            return [(client, _ack(sender, mav.MAV_MISSION_UNSUPPORTED, kind))]
        if self._upload is not None and (self._upload.client, self._upload.sender) != (client, sender):
            return [(client, _ack(sender, mav.MAV_MISSION_DENIED, kind))]
        if message.count > MOST_ITEMS:
            return [(client, _ack(sender, mav.MAV_MISSION_NO_SPACE, kind))]
        if kind == missions.MISSION and (message.count == 0 or not self._atomic):
            self._store.truncate(message.count)
        if message.count == 0:
            self._upload = None
            self._finish(kind, [])
            return [(client, _ack(sender, mav.MAV_MISSION_ACCEPTED, kind))]
        self._upload = _Upload(client, sender, kind, message.count, heard=now, asked=now)
        return [self._ask(now, self._upload)]

    def _on_item(self, now: float, message: Any, client: Hashable) -> Replies:
        sender, kind, upload = _sender(message), message.mission_type, self._upload
        if upload is None or upload.sender != sender or upload.mission_type != kind:
            return [(client, _ack(sender, mav.MAV_MISSION_ERROR, kind))]
        if message.seq != upload.seq:
            self._upload = None if self._ends_on_wrong_item else upload
            return [(client, _ack(sender, mav.MAV_MISSION_INVALID_SEQUENCE, kind))]
        try:
            item = missions.from_message(message, kind)
        except Refused as refusal:
            self._upload = None
            return [(client, _ack(sender, refusal.result, kind))]
        if kind == missions.MISSION and not self._atomic:
            self._store.write(upload.seq, item)
        else:
            upload.points.append(item)
        upload.client, upload.heard, upload.seq = client, now, upload.seq + 1
        if upload.seq < upload.count:
            return [self._ask(now, upload)]
        self._upload = None
        self._finish(kind, upload.points)
        return [(client, _ack(sender, mav.MAV_MISSION_ACCEPTED, kind))]

    def _finish(self, kind: int, points: list[MissionItem]) -> None:
        if kind == missions.MISSION and self._atomic:
            self._store.truncate(0)
            for seq, item in enumerate(points):
                self._store.write(seq, item)
        elif kind == missions.FENCE:
            self._store.fence = points
        elif kind == missions.RALLY:
            self._store.rally = points
        self._stored(kind)

    def _on_request_list(self, message: Any, client: Hashable) -> Replies:
        sender, kind = _sender(message), message.mission_type
        refusal = self._refusal(kind)
        if refusal is not None:
            return [(client, _ack(sender, refusal, kind))]
        return [(client, mav.MAVLink_mission_count_message(*sender, len(self._store.items(kind)), kind))]

    def _on_request(self, message: Any, client: Hashable) -> Replies:
        sender, kind = _sender(message), message.mission_type
        refusal = self._refusal(kind)
        if refusal is not None:
            return [(client, _ack(sender, refusal, kind))]
        items = self._store.items(kind)
        if message.seq >= len(items):
            # ArduPilot teaches the asker how long the mission really is, then refuses.
            count = mav.MAVLink_mission_count_message(*sender, len(items), kind)
            return [(client, count), (client, _ack(sender, mav.MAV_MISSION_ERROR, kind))]
        integers = message.get_type() == "MISSION_REQUEST_INT"
        return [(client, missions.to_message(items[message.seq], message.seq, kind, sender, integers))]

    def _refusal(self, kind: int) -> int | None:
        """Why nothing of this kind can be read now."""
        if kind not in self._stores:
            return int(mav.MAV_MISSION_UNSUPPORTED)
        return None if self._upload is None else int(mav.MAV_MISSION_DENIED)

    def _on_clear(self, message: Any, client: Hashable) -> Replies:
        sender, kind = _sender(message), message.mission_type
        kinds: tuple[int, ...]
        if kind == mav.MAV_MISSION_TYPE_ALL:
            kinds = self._stores
        elif kind in self._stores:
            kinds = (kind,)
        else:
            return [(client, _ack(sender, mav.MAV_MISSION_UNSUPPORTED, kind))]
        if self._upload is not None or (missions.MISSION in kinds and self._clearing_refused()):
            return [(client, _ack(sender, mav.MAV_MISSION_ERROR, kind))]
        for each in kinds:
            if each == missions.MISSION:
                self._store.truncate(0)
            self._finish(each, [])
        return [(client, _ack(sender, mav.MAV_MISSION_ACCEPTED, kind))]

    def _on_ack(self, message: Any) -> Replies:
        upload = self._upload
        if (
            upload is not None
            and _sender(message) == upload.sender
            and message.type == mav.MAV_MISSION_OPERATION_CANCELLED
        ):
            self._upload = None
        return []

    def _ask(self, now: float, upload: _Upload) -> tuple[Hashable, Any]:
        upload.asked = now
        request = (
            mav.MAVLink_mission_request_int_message
            if self._request_int
            else mav.MAVLink_mission_request_message
        )
        return upload.client, request(*upload.sender, upload.seq, upload.mission_type)


def _sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _ack(to: tuple[int, int], result: int, mission_type: int) -> Any:
    return mav.MAVLink_mission_ack_message(*to, result, mission_type)
