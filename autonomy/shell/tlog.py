"""The raw MAVLink stream as ground stations record it: for each packet, eight bytes of microseconds UTC, big-endian."""

import struct

_TIME = struct.Struct(">Q")


def pack(utc_us: int, packet: bytes) -> bytes:
    """One packet, sent or received at this time, as it stands in the file."""
    return _TIME.pack(utc_us) + packet
