"""What a well-mannered onboard controller says: heartbeat, wishes for streams, words to the operator."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.mission_items import Route
from autonomy.mavlink.mission_upload import retry_interval

BRIDGE_COMPONENT = mavlink.MAV_COMP_ID_PERIPHERAL
"""Under which `autonomy bridge` speaks, unless it is told another: a peripheral of the vehicle."""

_TEXT_LENGTH = 50
_INTERVAL = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
_ANSWER_S = 1.5
_REPEATS = 5


def heartbeat(active: bool) -> Any:
    """Our own HEARTBEAT: an onboard controller that is no autopilot; `active` once we command the boat."""
    state = mavlink.MAV_STATE_ACTIVE if active else mavlink.MAV_STATE_STANDBY
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
    )


def status_text(text: str, severity: int = mavlink.MAV_SEVERITY_INFO) -> Any:
    """A line to the operator, cut at 50 characters (ASCII: ground stations show nothing else reliably)."""
    line = text.encode("ascii", errors="replace")[:_TEXT_LENGTH]
    return mavlink.MAVLink_statustext_message(severity, line)


@dataclass(frozen=True)
class Stream:
    """A message wanted `rate_hz` times a second; `group` is the MAV_DATA_STREAM that old autopilots know."""

    message_id: int
    rate_hz: float
    group: int


def wanted_streams(
    position_rate_hz: float, *, battery: bool = False, home: bool = False
) -> tuple[Stream, ...]:
    """The messages that telemetry lives on; `battery`: and those that a budget lives on; `home`: where home is."""
    status, position = mavlink.MAV_DATA_STREAM_EXTENDED_STATUS, mavlink.MAV_DATA_STREAM_POSITION
    wanted: tuple[Stream, ...] = (
        Stream(mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, position_rate_hz, position),
        Stream(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0, status),
        Stream(mavlink.MAVLINK_MSG_ID_SYS_STATUS, 0.5, status),
        Stream(mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 1.0, status),
        Stream(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME, 0.5, mavlink.MAV_DATA_STREAM_EXTRA3),
        Stream(mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT, 0.5, mavlink.MAV_DATA_STREAM_EXTRA3),
        Stream(mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT, 1.0, status),
    )
    if battery:
        wanted += (Stream(mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 0.5, mavlink.MAV_DATA_STREAM_EXTRA3),)
    if battery or home:
        wanted += (Stream(mavlink.MAVLINK_MSG_ID_HOME_POSITION, 0.1, mavlink.MAV_DATA_STREAM_EXTRA3),)
    return wanted


class Answer(Enum):
    """What became of the wish for one stream."""

    WAITING = "no answer yet"
    GRANTED = "the vehicle sends it"
    GROUP_REQUESTED = "asked for as a group, which is never answered"
    SILENT = "the vehicle never answered"


class StreamRequests:
    """Asks for streams, one after the other, with SET_MESSAGE_INTERVAL.

    COMMAND_ACK names the command but not the message it was about: so one wish is open at a time. A wish that
    is unsupported, denied or failed is asked for again as REQUEST_DATA_STREAM. Intervals hold for this link
    until the vehicle reboots: make a new machine then.
    """

    def __init__(self, streams: tuple[Stream, ...], route: Route, *, time_scale: float = 1.0) -> None:
        self._streams = streams
        self._route = route
        self._time_scale = time_scale
        self._repeats = 0
        self._deadline: float | None = None
        self._answers = dict.fromkeys(streams, Answer.WAITING)

    @property
    def answers(self) -> Mapping[Stream, Answer]:
        """What became of each wish."""
        return self._answers

    @property
    def finished(self) -> bool:
        """Whether no wish is open any more."""
        return self._open() is None

    def next_deadline(self) -> float | None:
        """Protocol time at which `on_deadline` wants to be called."""
        return self._deadline

    def start(self, now: float) -> list[Any]:
        """Ask for the first stream."""
        return self._ask(now)

    def handle(self, now: float, message: Any) -> list[Any]:
        """React to one message of the vehicle; returns what to send."""
        if message.get_type() != "COMMAND_ACK" or message.command != _INTERVAL:
            return []
        if not (self._route.is_from_vehicle(message) and self._route.is_for_us(message)):
            return []
        stream = self._open()
        later = (mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_IN_PROGRESS)
        if stream is None or message.result in later:
            return []  # the timer asks again
        if message.result == mavlink.MAV_RESULT_ACCEPTED:
            self._answers[stream] = Answer.GRANTED
            return self._next(now)
        self._answers[stream] = Answer.GROUP_REQUESTED
        return [self._group_request(stream), *self._next(now)]

    def on_deadline(self, now: float) -> list[Any]:
        """Repeat a request that wasn't answered; after five, go on to the next."""
        if self._deadline is None or now < self._deadline:
            return []
        stream = self._open()
        assert stream is not None
        if self._repeats >= _REPEATS:
            self._answers[stream] = Answer.SILENT
            return self._next(now)
        self._repeats += 1
        return self._ask(now)

    def _open(self) -> Stream | None:
        return next((each for each in self._streams if self._answers[each] is Answer.WAITING), None)

    def _next(self, now: float) -> list[Any]:
        self._repeats = 0
        return self._ask(now)

    def _ask(self, now: float) -> list[Any]:
        stream = self._open()
        if stream is None:
            self._deadline = None
            return []
        self._deadline = now + retry_interval(_ANSWER_S, self._repeats, self._time_scale)
        system, component = self._route.vehicle_system, self._route.vehicle_component
        interval_us = round(1e6 / stream.rate_hz)
        parameters = (stream.message_id, interval_us, 0, 0, 0, 0, 0)
        return [
            mavlink.MAVLink_command_long_message(system, component, _INTERVAL, self._repeats, *parameters)
        ]

    def _group_request(self, stream: Stream) -> Any:
        return mavlink.MAVLink_request_data_stream_message(
            self._route.vehicle_system,
            self._route.vehicle_component,
            stream.group,
            max(1, round(stream.rate_hz)),
            1,
        )
