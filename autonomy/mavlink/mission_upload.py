"""Uploading a mission: one sans-io state machine."""

from collections.abc import Sequence
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import MissionItem, Route

COUNT_INTERVAL_S = 1.5
ITEM_INTERVAL_S = 0.25
BUSY_INTERVAL_S = 2.0
SILENCE_S = 4.0
ABANDONED_S = 9.0
"""ArduPilot asks for an item again every second, and ends an upload after eight silent ones: begun anew before that,
it would only lose what has got through."""

COUNT_REPEATS = 12
ATTEMPTS = 12
_GROWTH = 1.5
_KINDS = ("MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")


def retry_interval(base_s: float, repeats: int, time_scale: float) -> float:
    """Seconds of protocol time to the next repetition, after `repeats` of them.

    The timers of a simulated vehicle may run `1 / time_scale` times faster than ours, or may not: begin at
    its pace, and slow down to the ordinary one. How long we wait before giving up is never scaled.
    """
    return min(base_s, base_s * time_scale * _GROWTH**repeats)


class Upload(Enum):
    """Where an upload stands."""

    IDLE = "not started"
    ANNOUNCED = "waiting for the first request"
    SERVING = "answering requests"
    BUSY = "waiting until the vehicle's mission is free"
    SENT = "every item was asked for and sent"
    FAILED = "refused, or no answer"


_REASONS = {
    mavlink.MAV_MISSION_UNSUPPORTED_FRAME: "unsupported frame",
    mavlink.MAV_MISSION_UNSUPPORTED: "unsupported command",
    mavlink.MAV_MISSION_NO_SPACE: "no space for so many items",
    mavlink.MAV_MISSION_INVALID: "invalid parameter",
}


class MissionUpload:
    """Sends a list of items, all of them, item 0 included.

    Theory of operation. We announce the number of items; from then on the vehicle leads and asks for one
    item after the other. We answer every request, also repeated, late and old-fashioned ones (MISSION_REQUEST
    gets a MISSION_ITEM_INT too): a lost or doubled packet looks just like that. Our own timer only fills in
    for packets lost on our side.

        state      request  accepted (0)  busy (14)  error (1)       cancelled (15)  refused  timer
        IDLE       -        -             -          -               -               -        -
        ANNOUNCED  SERVING  -             BUSY       BUSY            -               FAILED   COUNT again [a]
        SERVING    SERVING  SENT [b]      -          BUSY, SENT [b]  ANNOUNCED       FAILED   item again [c]
        BUSY       SERVING  -             -          -               -               FAILED   ANNOUNCED [d]
        SENT       SENT     -             -          -               -               -        -
        FAILED     -        -             -          -               -               -        -

    Every request is answered with its item, in SENT too: the vehicle may have missed what we take as sent.
    [a] After twelve counts without an answer: FAILED.
    [b] Only once the last item was asked for: an earlier ACK 0 belongs to someone else. An error then
        means that the vehicle doesn't wait for items any more.
    [c] The item last asked for. SENT after 4 s without a request if the mission's last item was asked for (the
        final ACK got lost), otherwise ANNOUNCED after 9 s.
    [d] After twelve attempts: FAILED.

    ArduPilot answers an item it didn't expect, a doubled one for instance, with 13 (invalid sequence) and
    goes on asking, so 13 alone means nothing; in answer to a repetition of the last item it means that this
    item had arrived: SENT. And SENT doesn't mean that the mission is on board: only reading it back tells.
    """

    def __init__(self, items: Sequence[MissionItem], route: Route, *, time_scale: float = 1.0) -> None:
        self._items = tuple(items)
        self._route = route
        self._time_scale = time_scale
        self._asked_for_last = False
        self._last = 0
        self._repeats = 0
        self._attempts = 0
        self._heard_at = 0.0
        self._item_interval_s = ITEM_INTERVAL_S
        self._deadline: float | None = None
        self.state = Upload.IDLE
        self.reason = ""
        self.refused = False
        """Whether the vehicle will not have this mission, now or later."""
        self.no_space = False
        """Whether that is because it has too many items."""
        self._requested = False
        self._counts = 0
        self._refusals = 0
        self.contested = False
        """Whether somebody else was found uploading."""
        self.touched = False
        """Whether the vehicle may have changed the mission it had before."""

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called."""
        return self._deadline

    def start(self, now: float) -> list[Any]:
        """Announce the mission."""
        self.state = Upload.ANNOUNCED
        self._attempts += 1
        self._repeats = 0
        self._asked_for_last = False
        self.touched = True  # a lost answer can't tell us that the count arrived, and a shorter one truncates
        return self._announce(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """React to one message of the vehicle; returns what to send."""
        kind = message.get_type()
        if kind not in _KINDS or not self._route.is_answer(message):
            return []
        if kind == "MISSION_ACK":
            return self._on_ack(now, message.type)
        return self._on_request(now, message.seq)

    def on_deadline(self, now: float) -> list[Any]:
        """Repeat what may have been lost, if it is time to."""
        if self._deadline is None or now < self._deadline:
            return []
        if self.state is Upload.ANNOUNCED:
            if self._repeats + 1 >= COUNT_REPEATS:
                return self._fail("the vehicle doesn't answer the mission count")
            self._repeats += 1
            return self._announce(now)
        if self.state is Upload.BUSY:
            return self._again(now)
        if self._asked_for_last and now - self._heard_at >= SILENCE_S:
            return self._finish()
        if now - self._heard_at >= ABANDONED_S:
            return self._again(now)
        self._repeats += 1
        return self._send_item(now, self._last)

    def cancel(self) -> list[Any]:
        """Tell a vehicle that may still be asking for items that no more will come."""
        unfinished = self.state in (Upload.ANNOUNCED, Upload.SERVING)
        self._fail("cancelled")
        if not unfinished:
            return []
        route = self._route
        cancelled = mavlink.MAV_MISSION_OPERATION_CANCELLED
        return [
            mavlink.MAVLink_mission_ack_message(route.vehicle_system, route.vehicle_component, cancelled, 0)
        ]

    def _on_request(self, now: float, seq: int) -> list[Any]:
        if self.state in (Upload.IDLE, Upload.FAILED) or seq >= len(self._items):
            return []
        self.touched = True
        self._requested = True
        if self.state is Upload.SENT:
            return [self._items[seq].to_message(self._route, seq)]
        self.state = Upload.SERVING
        self._heard_at = now
        self._asked_for_last = self._asked_for_last or seq == len(self._items) - 1
        self._last = seq
        self._repeats = 0
        return self._send_item(now, seq)

    def _on_ack(self, now: float, result: int) -> list[Any]:
        if self.state not in (Upload.ANNOUNCED, Upload.SERVING, Upload.BUSY):
            return []
        if result == mavlink.MAV_MISSION_ACCEPTED:
            return self._finish() if self._asked_for_last else []
        if result == mavlink.MAV_MISSION_INVALID_SEQUENCE:
            return self._finish() if self._asked_for_last and self._repeats else []
        if result == mavlink.MAV_MISSION_OPERATION_CANCELLED:
            return self._again(now) if self.state is Upload.SERVING else []
        if result == mavlink.MAV_MISSION_ERROR and self._asked_for_last:
            return self._finish()
        if result == mavlink.MAV_MISSION_DENIED and self.state is Upload.SERVING:
            return []  # it asks us for items, so this answered something older
        if result in (mavlink.MAV_MISSION_DENIED, mavlink.MAV_MISSION_ERROR):
            return self._back_off(now, result)
        self.touched = self._requested
        self.refused = True
        self.no_space = result == mavlink.MAV_MISSION_NO_SPACE
        return self._fail("the vehicle refuses the mission: " + _REASONS.get(result, f"result {result}"))

    def _back_off(self, now: float, result: int) -> list[Any]:
        # A late refusal of one count doesn't say that the vehicle has not taken the next.
        self._refusals += 1
        self.touched = self._requested or self._counts > self._refusals
        if self.state is Upload.BUSY:
            return []
        if self.state is Upload.SERVING:
            # Some end an upload over an item that comes twice; over a slow link ours did, for want of patience.
            self._item_interval_s = min(2.0 * self._item_interval_s, SILENCE_S)
        self.state = Upload.BUSY
        denied = result == mavlink.MAV_MISSION_DENIED
        self.contested = self.contested or denied
        self.reason = "another upload is running" if denied else "the vehicle reports an error"
        self._deadline = now + retry_interval(BUSY_INTERVAL_S, self._attempts - 1, self._time_scale)
        return []

    def _announce(self, now: float) -> list[Any]:
        self._deadline = now + retry_interval(COUNT_INTERVAL_S, self._repeats, self._time_scale)
        self._counts += 1
        route = self._route
        return [
            mavlink.MAVLink_mission_count_message(
                route.vehicle_system, route.vehicle_component, len(self._items), 0
            )
        ]

    def _again(self, now: float) -> list[Any]:
        if self._attempts >= ATTEMPTS:
            return self._fail(
                f"given up after {ATTEMPTS} attempts: {self.reason or 'the vehicle fell silent'}"
            )
        return self.start(now)

    def _send_item(self, now: float, seq: int) -> list[Any]:
        self._deadline = now + retry_interval(self._item_interval_s, self._repeats, self._time_scale)
        return [self._items[seq].to_message(self._route, seq)]

    def _finish(self) -> list[Any]:
        self.state = Upload.SENT
        self._deadline = None
        return []

    def _fail(self, reason: str) -> list[Any]:
        self.state = Upload.FAILED
        self.reason = reason
        self._deadline = None
        return []
