"""Bytes to MAVLink messages and back: pymavlink's generated dialect with framing of our own.

pymavlink's own stream parser gives up the whole claimed length of a frame whose checksum is wrong, and
with it the good frames inside. Here the search goes on at the next byte: one flipped bit costs one message.
"""

import re
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.signing import SIGNATURE_BYTES, Signing

_MARKER = re.compile(b"[\xfe\xfd]")
_V1_OVERHEAD = 8  # marker, 5 header bytes, 2 checksum bytes
_V2_OVERHEAD = 12
_SIGNED = mavlink.MAVLINK_IFLAG_SIGNED
_MAXIMUM_PEERS = 64
_BAD_FRAMES = 64
_BAD_FRAMES_OF_A_STREAM = 512
_BYTES_A_BAD_FRAME = 16
"""Random bytes have a marker in 128; those of a disturbed line, where a glitch reads as 0xFE, in five or so."""


@dataclass
class DecodingCounters:
    """What came in since the codec was made.

    `skipped_bytes` are no part of a frame, or came behind too many bad ones. `keys` are messages that bring a signing
    key: nobody gets to see them.
    """

    messages: int = 0
    bad_frames: int = 0
    unknown_messages: int = 0
    skipped_bytes: int = 0
    keys: int = 0


class Codec:
    """One end of a MAVLink link: our identity, our sequence numbers, and one parser for each peer.

    `system_id` may be changed at any time: a companion takes over the vehicle's once it is known. With `signing` all
    that is sent is signed, and nothing is accepted that is not signed with the same key, or was accepted before.
    """

    def __init__(self, system_id: int, component_id: int, signing: Signing | None = None) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._mav.robust_parsing = True
        self._signing = signing
        self._tails: OrderedDict[Hashable, bytes] = OrderedDict()
        self.counters = DecodingCounters()

    @property
    def system_id(self) -> int:
        """The system id that outgoing messages carry."""
        return int(self._mav.srcSystem)

    @system_id.setter
    def system_id(self, value: int) -> None:
        if not 1 <= value <= 255:
            raise ValueError(f"MAVLink system id must be 1 to 255, got {value}")
        self._mav.srcSystem = value

    @property
    def component_id(self) -> int:
        """The component id that outgoing messages carry."""
        return int(self._mav.srcComponent)

    def encode(self, message: Any) -> bytes:
        """Pack `message` with our identity and the next sequence number, and sign it if there is a key."""
        data = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + 1) % 256
        return data if self._signing is None else self._signing.sign(data, message.crc_extra)

    def decode(self, data: bytes, peer: Hashable = None, *, stream: bool = False) -> list[Any]:
        """All complete messages of known type after `data` arrived from `peer`; never raises on any bytes.

        A frame may be split over several calls with the same peer. Corrupt and unknown frames are counted
        in `counters` and left out; so are those that signing refuses, which it counts itself.

        Behind 64 bad frames the rest of a datagram is dropped: made of nothing but markers, it would hold the control
        loop up for as long as thousands of good ones. Of a `stream` as many more are borne as a disturbed line can
        bring before good frames go on; what is dropped at last ends with `data`.
        """
        tail = self._tails.pop(peer, b"")
        if tail and self._opens_with_a_frame(data):
            # The rest of the broken frame will not come: this datagram begins anew.
            self.counters.skipped_bytes += len(tail)
            tail = b""
        buffer = tail + bytes(data)
        bearable = _BAD_FRAMES_OF_A_STREAM + len(buffer) // _BYTES_A_BAD_FRAME if stream else _BAD_FRAMES
        messages, rest = self._parse(buffer, bearable)
        if rest:
            self._tails[peer] = rest
            if len(self._tails) > _MAXIMUM_PEERS:
                self._tails.popitem(last=False)
        return messages

    def _parse(self, buffer: bytes, bearable: int) -> tuple[list[Any], bytes]:
        messages: list[Any] = []
        position = bad = 0
        while bad < bearable and (marker := _MARKER.search(buffer, position)) is not None:
            self.counters.skipped_bytes += marker.start() - position
            position = marker.start()
            length = _frame_length(buffer, position)
            if length is None or position + length > len(buffer):
                return messages, buffer[position:]
            message = self._message(buffer[position : position + length])
            if message is None or (_is_unknown(message) and not _ends_cleanly(buffer, position + length)):
                self.counters.bad_frames += 1
                bad += 1
                position += 1
                continue
            position += length
            if self._is_welcome(message):
                self.counters.messages += 1
                messages.append(message)
        self.counters.skipped_bytes += len(buffer) - position
        return messages, b""

    def _is_welcome(self, message: Any) -> bool:
        """Whether a sound message is to be passed on."""
        if _is_unknown(message):
            self.counters.unknown_messages += 1
            return False
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if self._signing is not None and self._signing.check(
            bytes(message.get_msgbuf()), *sender, message.get_msgId()
        ):
            return False
        if message.get_msgId() == mavlink.MAVLINK_MSG_ID_SETUP_SIGNING:
            # It holds somebody's key, and would go into the journal.
            self.counters.keys += 1
            return False
        return True

    def _message(self, frame: bytes) -> Any | None:
        if frame[0] == mavlink.PROTOCOL_MARKER_V2 and frame[2] & ~_SIGNED:
            return None
        try:
            return self._mav.decode(bytearray(frame))
        except mavlink.MAVError:
            return None

    def _opens_with_a_frame(self, data: bytes) -> bool:
        if not data or data[0] not in (mavlink.PROTOCOL_MARKER_V1, mavlink.PROTOCOL_MARKER_V2):
            return False
        length = _frame_length(data, 0)
        if length is None or length > len(data):
            return False
        message = self._message(bytes(data[:length]))
        return message is not None and not _is_unknown(message)


def _frame_length(buffer: bytes, start: int) -> int | None:
    """Length in bytes of the frame at `start`, None as long as its header is incomplete."""
    if len(buffer) - start < 3:
        return None
    payload = buffer[start + 1]
    if buffer[start] == mavlink.PROTOCOL_MARKER_V1:
        return payload + _V1_OVERHEAD
    return payload + _V2_OVERHEAD + (SIGNATURE_BYTES if buffer[start + 2] & _SIGNED else 0)


def _ends_cleanly(buffer: bytes, end: int) -> bool:
    """Whether a frame may end here. We can't test an unknown message's checksum; its neighbour tells."""
    return end == len(buffer) or _MARKER.match(buffer, end) is not None


def _is_unknown(message: Any) -> bool:
    return isinstance(message, mavlink.MAVLink_unknown)
