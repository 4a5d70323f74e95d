"""What comes from the autopilot: MAVLink, signed and not, and the core that listens to it."""

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.core import Core
from autonomy.events import DeadlineReached, JobFailed, LinkDown, LinkUp, MessageReceived
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import EPOCH_UTC_S, Signing, SigningKey

from .decoder import Decoder
from .survey import CONFIGURATION, SURVEY

ACK = mavlink.MAV_RESULT_ACCEPTED


def messages() -> list[Any]:
    """One of everything that the core listens to, as an autopilot would say it."""
    us = (1, 191)
    place = (335_000_000, -1_185_000_000)
    return [
        mavlink.MAVLink_heartbeat_message(11, 3, 209, 10, 4, 3),
        mavlink.MAVLink_heartbeat_message(11, 3, 81, 0, 5, 3),
        mavlink.MAVLink_global_position_int_message(120_000, *place, 0, 0, 100, 0, 0, 9000),
        mavlink.MAVLink_gps_raw_int_message(120_000_000, 3, *place, 0, 90, 90, 100, 0, 9),
        mavlink.MAVLink_ekf_status_report_message(0x1F, 0.1, 0.1, 0.1, 0.1, 0.1),
        mavlink.MAVLink_named_value_float_message(120_000, b"SALT", 33.5),
        mavlink.MAVLink_mission_current_message(1, 5, 3, 1),
        mavlink.MAVLink_mission_item_reached_message(1),
        mavlink.MAVLink_mission_count_message(*us, 3, 0),
        mavlink.MAVLink_mission_count_message(*us, 4, 1),
        mavlink.MAVLink_mission_item_int_message(*us, 0, 0, 16, 0, 1, 0, 0, 0, 0, *place, 0, 0),
        mavlink.MAVLink_mission_item_int_message(*us, 1, 3, 5001, 0, 1, 4, 0, 0, 0, *place, 0, 1),
        mavlink.MAVLink_mission_request_message(*us, 0, 0),
        mavlink.MAVLink_mission_request_int_message(*us, 1, 0),
        mavlink.MAVLink_mission_ack_message(*us, 0, 0),
        mavlink.MAVLink_command_ack_message(224, ACK, 0, 0, *us),
        mavlink.MAVLink_command_ack_message(511, ACK, 0, 0, *us),
        mavlink.MAVLink_param_value_message(b"FENCE_TYPE", 6.0, 9, 1, 0),
        mavlink.MAVLink_param_value_message(b"FENCE_ENABLE", 1.0, 9, 1, 0),
        mavlink.MAVLink_param_value_message(b"FENCE_RADIUS", 300.0, 9, 1, 0),
        mavlink.MAVLink_home_position_message(*place, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12_000, 100, 80, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_battery_status_message(0, 0, 1, 2000, [4000] * 10, 100, 500, -1, 80),
        mavlink.MAVLink_system_time_message(1_700_000_000_000_000, 120_000),
        mavlink.MAVLink_timesync_message(1, 2),
        mavlink.MAVLink_statustext_message(4, b"EKF3 lane switch"),
    ]


def frame_of(message: Any, sequence: int = 0) -> bytes:
    codec = Codec(1, 1)
    codec._mav.seq = sequence
    return codec.encode(message)


FRAMES = [frame_of(message) for message in messages()]


def key() -> SigningKey:
    return SigningKey(bytes(range(32)))


def signing() -> Signing:
    return Signing(key(), lambda: EPOCH_UTC_S + 1e7)


def checked_frame(content: bytes) -> bytes:
    """A MAVLink 2 frame of the message that the first byte names, with the rest as its payload."""
    message = FRAMES[content[0] % len(FRAMES)] if content else FRAMES[0]
    payload = content[1:256]
    head = bytes([0xFD, len(payload), 0, 0, message[4], message[5], message[6], *message[7:10]])
    crc = mavlink.x25crc(head[1:] + payload)
    crc.accumulate(bytes([mavlink.mavlink_map[int.from_bytes(message[7:10], "little")].crc_extra]))
    return head + payload + int(crc.crc).to_bytes(2, "little")


def payloads() -> list[bytes]:
    return [bytes([number]) + each[10:-2] for number, each in enumerate(FRAMES)]


def read_stream(data: bytes) -> None:
    codec = Codec(1, 191)
    for start in range(0, len(data), 100):
        for message in codec.decode(data[start : start + 100]):
            message.get_type()


def read_signed(data: bytes) -> None:
    codec = Codec(1, 191, signing())
    codec.decode(data)


def signed_frames() -> list[bytes]:
    codec = Codec(1, 1, signing())
    return [codec.encode(message) for message in messages()]


def signed(content: bytes) -> bytes:
    """Wrong in everything but the signature."""
    body = content[:-13] + content[-13:-6] if len(content) > 13 else content
    return body + key().signature(body)


class Listener:
    """A core that is told everything that comes, and asked for its decisions; begun anew now and then."""

    def __init__(self) -> None:
        self._codec = Codec(1, 191)
        self._heard = 0

    def _begin(self) -> None:
        self._core = Core(CONFIGURATION, SURVEY)
        self._now = 1000.0
        self._happened(LinkUp())
        for data in FRAMES:
            self.hear(data)

    def hear(self, data: bytes) -> None:
        for message in self._codec.decode(data):
            self._now += 0.05
            self._happened(MessageReceived(message))

    def read(self, data: bytes) -> None:
        if self._heard % 300 == 0:
            self._begin()
        self._heard += 1
        self.hear(data)
        match self._heard % 7:
            case 0:
                self._now += 1.0
                self._happened(DeadlineReached())
            case 1:
                for each in FRAMES[:6]:
                    self.hear(each)
            case 2 if self._heard % 5 == 0:
                self._happened(JobFailed(self._core._replanning._jobs_started, "no time"))
        if self._heard % 120 == 0:
            self._happened(LinkDown("unplugged"))
            self._happened(LinkUp())

    def _happened(self, event: Any) -> None:
        self._core.handle(self._now, event)
        if self._core.next_deadline() <= self._now:
            self._core.handle(self._now, DeadlineReached())


DECODERS = {
    "mavlink": Decoder(
        read_stream, lambda: [b"".join(FRAMES), *FRAMES], (), [b"\xfd", b"\xfe", b"\xfd\xff\x01"]
    ),
    "mavlink signed": Decoder(read_signed, signed_frames, (), [b"\xfd", b"\xff" * 6], signed),
    "core": Decoder(
        Listener().read,
        payloads,
        (),
        [b"\xff" * 4, bytes(4), b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"],
        checked_frame,
    ),
}
