"""MAVLink 2 signing: https://mavlink.io/en/guide/message_signing.html.

The check is our own. pymavlink's remembers a packet's timestamp before it has looked at the signature, so that one
forged packet from the far future silences an honest sender for good, and it lets a wrongly signed packet through
where an unsigned one would be. What it signs, and whether it takes what we sign, is compared in the tests.
"""

import hashlib
import hmac
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import SigningSection
from autonomy.config.private import PrivateFileError, read_private

TICKS_PER_S = 100_000
EPOCH_UTC_S = 1_420_070_400.0
"""Timestamps count ten microseconds since 1 January 2015."""

KEY_BYTES = 32
SIGNATURE_BYTES = 13
"""Link id, six bytes of timestamp, six bytes of signature."""

MAXIMUM_STREAMS = 256
"""That are heard; ours of earlier runs are among them."""

MAXIMUM_PLEDGED = MAXIMUM_STREAMS + 16
"""Streams in a pledge: all that are heard, and ours of this run, one for each system id that we had."""

LARGEST_TIMESTAMP = 2**48 - 1
_NEW_STREAM_TICKS = 60 * TICKS_PER_S
_OWN_AHEAD = 5 * TICKS_PER_S
_SPARE = TICKS_PER_S // 10
_STEPS_AHEAD = 4
_LONGEST_STEP = TICKS_PER_S

UNSIGNED_ALLOWED = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_RADIO})
"""What telemetry radios say of themselves; they know no key, and ArduPilot too takes it from them."""

Stream = tuple[int, int, int]
"""Link id, system, component: each has timestamps of its own."""


class KeyFormatError(ValueError):
    """The content of a key file is no key; says why, and never what it is."""


class KeyFileError(ValueError):
    """There is no usable key in the file; says why, never what is in it."""


class SigningKey:
    """A secret of 32 bytes, which neither `repr` nor `pickle` tells."""

    __slots__ = ("_secret",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_BYTES:
            raise KeyFormatError(f"a key has {KEY_BYTES} bytes, not {len(secret)}")
        self._secret = bytes(secret)

    @classmethod
    def from_file_content(cls, content: bytes, form: str) -> "SigningKey":
        """The key in a file.

        Args:
            content: of the file; one line end at its end does not count.
            form: `passphrase`, whose SHA-256 is the key, as Mission Planner, QGroundControl and MAVProxy make it, or
                `key`: 32 bytes, or 64 hexadecimal digits.

        Raises:
            KeyFormatError: it is nothing of the kind.
        """
        line = re.sub(rb"\r?\n\Z", b"", content)
        if form == "passphrase":
            if not line.strip():
                raise KeyFormatError("the passphrase is empty")
            return cls(hashlib.sha256(line).digest())
        if len(content) == KEY_BYTES:
            return cls(content)
        if re.fullmatch(rb"[0-9A-Fa-f]{64}", line):
            return cls(bytes.fromhex(line.decode()))
        raise KeyFormatError(f"holds {len(content)} bytes, no key: 32 bytes, or 64 hexadecimal digits")

    def __reduce__(self) -> tuple[object, ...]:
        raise TypeError("a signing key is not to be written anywhere")

    def signature(self, signed: bytes) -> bytes:
        """The six bytes that end a packet; `signed` is all before them, from the marker to the timestamp."""
        return hashlib.sha256(self._secret + signed).digest()[:6]


def read_key(section: SigningSection, environment: Mapping[str, str]) -> SigningKey | None:
    """The key that the configuration names; None if it names none.

    Raises:
        KeyFileError: the file can't be read, others may read it, or it holds no key.
    """
    if section.key_file is None:
        return None
    try:
        return SigningKey.from_file_content(read_private(section.key_file, environment), section.form)
    except PrivateFileError as error:
        raise KeyFileError(str(error)) from None
    except KeyFormatError as error:
        raise KeyFileError(f"{str(section.key_file)!a}: {error}") from None


class Refusal(Enum):
    """Why a packet is not accepted; the value is how it is said to a person."""

    UNSIGNED = "unsigned"
    WRONG = "wrongly signed"
    REPLAYED = "replayed"
    STALE = "of a clock more than a minute behind"
    CROWDED = "of too many senders"


@dataclass(frozen=True)
class Pledge:
    """What is kept for the next run, so that it neither uses a timestamp again nor takes a packet again.

    Attributes:
        timestamp: no packet of ours has had a larger one.
        streams: none of another's that was accepted has, by its stream.
    """

    timestamp: int = 0
    streams: Mapping[Stream, int] = field(default_factory=dict)


@dataclass
class _Heard:
    """One stream: its last timestamp, the one at the last pledge (None: there was none), and what was pledged."""

    last: int
    before: int | None
    pledged: int

    def renew(self) -> None:
        """Pledge some steps ahead: a sender may count packets or ten microseconds."""
        step = 1 if self.before is None else min(max(1, self.last - self.before), _LONGEST_STEP)
        if self.last + step > self.pledged:
            self.pledged = min(self.last + _STEPS_AHEAD * step, LARGEST_TIMESTAMP)
        self.before = self.last


class Signing:
    """Signs what we send and checks what we are sent, for one link.

    Args:
        key: shared by all on the link.
        utc_s: the wall clock, seconds since 1970. It may be wrong and may jump: timestamps only grow.
        link_id: of our packets, 0 to 255.
        pledge: what the last run left.
    """

    def __init__(
        self, key: SigningKey, utc_s: Callable[[], float], link_id: int = 0, pledge: Pledge | None = None
    ) -> None:
        if not 0 <= link_id <= 255:
            raise ValueError(f"a link id is from 0 to 255, got {link_id}")
        pledge = Pledge() if pledge is None else pledge
        self.link_id = link_id
        self.refused: Counter[Refusal] = Counter()
        self.exempt = 0
        """Packets accepted without a signature, as from a telemetry radio."""
        self._key = key
        self._utc_s = utc_s
        self._timestamp = max(pledge.timestamp, *pledge.streams.values(), 0)
        self._pledged = 0
        self._outrun = False
        self._own: set[Stream] = set()
        self._streams = {stream: _Heard(last, None, last) for stream, last in pledge.streams.items()}

    @property
    def is_due(self) -> bool:
        """Whether something was used or accepted that the last `pledge` does not cover: make another at once."""
        return self._outrun or self._timestamp > self._pledged

    def sign(self, packet: bytes, crc_extra: int) -> bytes:
        """An unsigned MAVLink 2 packet, signed; `crc_extra` is its message's."""
        self._advance()
        self._timestamp = min(self._timestamp + 1, LARGEST_TIMESTAMP)
        body = packet[1:2] + bytes([packet[2] | mavlink.MAVLINK_IFLAG_SIGNED]) + packet[3:-2]
        crc = mavlink.x25crc(body)
        crc.accumulate(bytes([crc_extra]))
        link_and_time = bytes([self.link_id]) + self._timestamp.to_bytes(6, "little")
        self._own.add((self.link_id, packet[5], packet[6]))
        signed = packet[:1] + body + int(crc.crc).to_bytes(2, "little") + link_and_time
        return signed + self._key.signature(signed)

    def check(self, packet: bytes, system: int, component: int, message_id: int) -> Refusal | None:
        """Why a whole packet of this sender is not accepted, None if it is; counts both."""
        refusal = self._refusal(packet, system, component, message_id)
        if refusal is not None:
            self.refused[refusal] += 1
        return refusal

    def pledge(self) -> Pledge:
        """What is to be kept now, about once a second; it holds until the next is due."""
        self._advance()
        for heard in self._streams.values():
            heard.renew()
        streams = {stream: heard.pledged for stream, heard in self._streams.items()}
        # Ours comes after all of theirs: whoever hears us goes on from there, and is accepted.
        highest = max(self._timestamp, *streams.values(), 0)
        if self._pledged < max(self._now() + _OWN_AHEAD // 2, self._timestamp + _SPARE // 2, highest):
            ahead = max(self._now() + _OWN_AHEAD, self._timestamp + _SPARE, highest)
            self._pledged = min(ahead, LARGEST_TIMESTAMP)
        self._outrun = False
        return Pledge(self._pledged, _newest(streams | dict.fromkeys(self._own, self._pledged)))

    def _refusal(self, packet: bytes, system: int, component: int, message_id: int) -> Refusal | None:
        if packet[0] != mavlink.PROTOCOL_MARKER_V2 or not packet[2] & mavlink.MAVLINK_IFLAG_SIGNED:
            if message_id not in UNSIGNED_ALLOWED:
                return Refusal.UNSIGNED
            self.exempt += 1
            return None
        if not hmac.compare_digest(self._key.signature(packet[:-6]), packet[-6:]):
            return Refusal.WRONG
        stream = (packet[-SIGNATURE_BYTES], system, component)
        return self._late(stream, int.from_bytes(packet[-12:-6], "little"))

    def _late(self, stream: Stream, timestamp: int) -> Refusal | None:
        """Hold a rightly signed packet's timestamp against its stream's last one, and remember it."""
        heard = self._streams.get(stream)
        if stream in self._own or (heard is not None and timestamp <= heard.last):
            return Refusal.REPLAYED  # and so is what we have said ourselves, sent back to us
        if heard is None:
            self._advance()
            if timestamp + _NEW_STREAM_TICKS < self._timestamp:
                return Refusal.STALE
            if len(self._streams) >= MAXIMUM_STREAMS:
                return Refusal.CROWDED
            heard = self._streams[stream] = _Heard(timestamp, None, -1)
        heard.last = timestamp
        self._outrun = self._outrun or timestamp > heard.pledged
        self._timestamp = max(self._timestamp, timestamp)
        return None

    def _advance(self) -> None:
        self._timestamp = max(self._timestamp, self._now())

    def _now(self) -> int:
        ticks = round((self._utc_s() - EPOCH_UTC_S) * TICKS_PER_S)
        return min(max(0, ticks), LARGEST_TIMESTAMP)


def _newest(streams: dict[Stream, int]) -> dict[Stream, int]:
    """As many as a pledge holds. To the next run an older one's sender is new: what it said long before is stale."""
    excess = len(streams) - MAXIMUM_PLEDGED
    for oldest in sorted(streams, key=streams.__getitem__)[: max(0, excess)]:
        del streams[oldest]
    return streams


def told(refused: Mapping[Refusal, int]) -> str:
    """What was refused, for a person: "refused: 12 unsigned, 1 replayed"; empty if nothing was."""
    counts: Iterable[str] = (f"{refused[kind]} {kind.value}" for kind in Refusal if refused.get(kind))
    text = ", ".join(counts)
    return f"refused: {text}" if text else ""
