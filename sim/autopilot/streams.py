"""Which message each client gets how often: ArduPilot's streams and per-link message intervals."""

from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import ardupilotmega as mav

# The groups are ArduPilot's; REQUEST_DATA_STREAM speaks of them.
GROUPS: dict[int, tuple[int, ...]] = {
    mav.MAV_DATA_STREAM_EXTENDED_STATUS: (
        mav.MAVLINK_MSG_ID_SYS_STATUS,
        mav.MAVLINK_MSG_ID_GPS_RAW_INT,
        mav.MAVLINK_MSG_ID_MISSION_CURRENT,
        mav.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    ),
    mav.MAV_DATA_STREAM_POSITION: (mav.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,),
    mav.MAV_DATA_STREAM_EXTRA1: (mav.MAVLINK_MSG_ID_ATTITUDE,),
    mav.MAV_DATA_STREAM_EXTRA2: (mav.MAVLINK_MSG_ID_VFR_HUD,),
    mav.MAV_DATA_STREAM_EXTRA3: (
        mav.MAVLINK_MSG_ID_SYSTEM_TIME,
        mav.MAVLINK_MSG_ID_BATTERY_STATUS,
        mav.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}
STREAMED = frozenset(message for group in GROUPS.values() for message in group)
# A heartbeat is no part of any group but its interval can be asked for.
DEFAULT_INTERVAL_S = 1.0
_FASTEST_S = 0.02


@dataclass
class _Subscription:
    interval_s: dict[int, float]
    due: dict[int, float]
    next_due: float = field(default=0.0)


class Streams:
    """Intervals and due times of every client; a client that joins gets everything at 1 Hz, unasked."""

    def __init__(self) -> None:
        self._clients: dict[Hashable, _Subscription] = {}

    @property
    def clients(self) -> list[Hashable]:
        """Whoever is served."""
        return list(self._clients)

    def join(self, now: float, client: Hashable) -> bool:
        """Start serving a client; False if it is served already."""
        if client in self._clients:
            return False
        ids = [mav.MAVLINK_MSG_ID_HEARTBEAT, *sorted(STREAMED)]
        intervals = dict.fromkeys(ids, DEFAULT_INTERVAL_S)
        self._clients[client] = _Subscription(intervals, dict.fromkeys(ids, now), now)
        return True

    def leave(self, client: Hashable) -> None:
        """Forget a client and what it had asked for."""
        self._clients.pop(client, None)

    def set_interval(self, now: float, client: Hashable, message_id: int, interval_us: float) -> bool:
        """SET_MESSAGE_INTERVAL: -1 stops a message, 0 restores the default; False if it is not streamed."""
        if message_id not in STREAMED and message_id != mav.MAVLINK_MSG_ID_HEARTBEAT:
            return False
        self.join(now, client)
        subscription = self._clients[client]
        if interval_us < 0.0:
            subscription.interval_s.pop(message_id, None)
            subscription.due.pop(message_id, None)
        else:
            interval_s = DEFAULT_INTERVAL_S if interval_us == 0.0 else max(_FASTEST_S, interval_us * 1e-6)
            subscription.interval_s[message_id] = interval_s
            subscription.due[message_id] = now
        subscription.next_due = now
        return True

    def interval_us(self, client: Hashable, message_id: int) -> int:
        """The interval of a message at a client in microseconds; -1 if it is stopped, 0 if not streamed."""
        if message_id not in STREAMED and message_id != mav.MAVLINK_MSG_ID_HEARTBEAT:
            return 0
        subscription = self._clients.get(client)
        if subscription is None or message_id not in subscription.interval_s:
            return -1
        return round(subscription.interval_s[message_id] * 1e6)

    def request_group(self, now: float, client: Hashable, group: int, rate_hz: float) -> None:
        """REQUEST_DATA_STREAM: set a whole group, or all of them (group 0), to a rate; 0 stops it."""
        ids: Iterable[int] = STREAMED if group == mav.MAV_DATA_STREAM_ALL else GROUPS.get(group, ())
        for message_id in ids:
            self.set_interval(now, client, message_id, 1e6 / rate_hz if rate_hz > 0.0 else -1.0)

    def due(self, now: float) -> list[tuple[Hashable, int]]:
        """What is to be sent now; missed repeats are not made up for."""
        result: list[tuple[Hashable, int]] = []
        for client, subscription in self._clients.items():
            if now < subscription.next_due:
                continue
            for message_id, when in subscription.due.items():
                if now >= when:
                    result.append((client, message_id))
                    later = when + subscription.interval_s[message_id]
                    subscription.due[message_id] = (
                        later if later > now else now + subscription.interval_s[message_id]
                    )
            subscription.next_due = min(subscription.due.values(), default=float("inf"))
        return result
