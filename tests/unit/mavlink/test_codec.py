"""The codec on whole, split, corrupt and hostile bytes."""

import random
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.mavlink.codec import Codec

BYTES_WITH_MARKERS = st.binary(max_size=300) | st.lists(
    st.sampled_from([b"\xfd", b"\xfe", b"\x00", b"\x01", b"\x09", b"\xff", b"\xfd\x09\x00\x00"]), max_size=60
).map(b"".join)


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(11, 3, 81, 10, 4, 3)


def reading(value: float) -> Any:
    return mavlink.MAVLink_named_value_float_message(1234, b"SALT", value)


def values(messages: list[Any]) -> list[float]:
    return [message.value for message in messages]


def test_a_message_comes_back_with_its_sender_and_sequence_number() -> None:
    sender, receiver = Codec(7, 1), Codec(1, 191)
    first, second = receiver.decode(sender.encode(heartbeat()) + sender.encode(reading(33.5)))
    assert (first.get_type(), first.custom_mode) == ("HEARTBEAT", 10)
    assert (second.get_srcSystem(), second.get_srcComponent(), second.get_seq()) == (7, 1, 1)
    assert second.value == 33.5


def test_sequence_numbers_wrap() -> None:
    codec = Codec(1, 191)
    numbers = [Codec(1, 1).decode(codec.encode(heartbeat()))[0].get_seq() for _ in range(258)]
    assert numbers[-3:] == [255, 0, 1]


def test_the_system_id_can_follow_the_vehicle() -> None:
    codec = Codec(1, 191)
    codec.system_id = 42
    assert Codec(1, 1).decode(codec.encode(heartbeat()))[0].get_srcSystem() == 42
    with pytest.raises(ValueError, match="1 to 255"):
        codec.system_id = 256


@given(data=BYTES_WITH_MARKERS, peer=st.integers(0, 2))
def test_no_bytes_raise_and_a_good_message_gets_through(data: bytes, peer: int) -> None:
    codec = Codec(1, 191)
    codec.decode(data, peer)
    # A frame may have begun at any byte of the rubbish and claim up to 293 bytes.
    good = [Codec(7, 1).encode(reading(value)) for value in (1.0, 2.0)]
    received = [message for packet in good for message in codec.decode(packet, peer)]
    assert values([each for each in received if each.get_type() == "NAMED_VALUE_FLOAT"])[-2:] == [1.0, 2.0]


@given(st.lists(st.integers(1, 40), min_size=1, max_size=30))
def test_any_chopping_of_a_stream_gives_the_same_messages(sizes: list[int]) -> None:
    sender, receiver = Codec(7, 1), Codec(1, 191)
    stream = b"".join(sender.encode(reading(float(number))) for number in range(8))
    received, position = [], 0
    for size in sizes:
        received += receiver.decode(stream[position : position + size])
        position += size
    received += receiver.decode(stream[position:])
    assert values(received) == [float(number) for number in range(8)]


@given(position=st.integers(0, 59), bit=st.integers(0, 7))
def test_a_flipped_bit_costs_one_message(position: int, bit: int) -> None:
    sender = Codec(7, 1)
    packets = [sender.encode(reading(float(number))) for number in range(3)]
    length = len(packets[0])
    damaged = bytearray(b"".join(packets))
    damaged[position % len(damaged)] ^= 1 << bit
    receiver = Codec(1, 191)
    # What follows lets a frame end whose length was made longer.
    received = receiver.decode(bytes(damaged) + sender.encode(reading(9.0)) * 12)
    hit = (position % len(damaged)) // length
    assert [value for value in values(received) if value != 9.0] == [
        float(number) for number in range(3) if number != hit
    ]


def test_a_broken_tail_of_one_peer_spoils_neither_another_nor_its_own_next_datagram() -> None:
    sender, receiver = Codec(7, 1), Codec(1, 191)
    packet = sender.encode(reading(1.0))
    assert receiver.decode(packet[:-4], "boat") == []
    assert values(receiver.decode(packet, "station")) == [1.0]
    assert values(receiver.decode(packet, "boat")) == [1.0]


def test_unknown_messages_are_counted_and_left_out() -> None:
    sender, receiver = Codec(7, 1), Codec(1, 191)
    packet = bytearray(sender.encode(heartbeat()))
    packet[7:10] = (13_000_000).to_bytes(3, "little")
    received = receiver.decode(bytes(packet) + sender.encode(reading(2.0)))
    assert values(received) == [2.0]
    assert receiver.counters.unknown_messages == 1
    assert receiver.counters.messages == 1


def test_corrupt_frames_are_counted() -> None:
    packet = bytearray(Codec(7, 1).encode(heartbeat()))
    packet[-1] ^= 0xFF
    receiver = Codec(1, 191)
    assert receiver.decode(bytes(packet)) == []
    assert receiver.counters.bad_frames == 1


def attempts(codec: Codec, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Gets an item for each frame that the codec tries to decode from now on."""
    made: list[int] = []
    sound = codec._message

    def counted(frame: bytes) -> Any:
        made.append(len(frame))
        return sound(frame)

    monkeypatch.setattr(codec, "_message", counted)
    return made


@pytest.mark.parametrize("pattern", [b"\xfe\xfb", b"\xfe\x00", b"\xfd", b"\xfe"])
@pytest.mark.parametrize(("stream", "most"), [(False, 65), (True, 512 + 65_000 // 16 + 1)])
def test_bytes_made_of_markers_are_not_decoded_one_by_one(
    pattern: bytes, stream: bool, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """32 000 candidates in one datagram, each with a checksum over 259 bytes, hold the control loop up."""
    receiver = Codec(1, 191)
    made = attempts(receiver, monkeypatch)
    hostile = (pattern * 65_000)[:65_000]
    assert receiver.decode(hostile, "peer", stream=stream) == []
    assert 0 < len(made) <= most
    counters = receiver.counters
    assert counters.bad_frames + counters.skipped_bytes == len(hostile), "what is dropped is counted"
    packets = [Codec(7, 1).encode(reading(value)) for value in (1.0, 2.0)]
    received = [message for packet in packets for message in receiver.decode(packet, "peer", stream=stream)]
    assert values(received) == [1.0, 2.0], "the next ones are heard"


def test_good_frames_before_many_bad_ones_are_heard() -> None:
    receiver = Codec(1, 191)
    (message,) = receiver.decode(Codec(7, 1).encode(reading(1.0)) + b"\xfe\xfb" * 5000)
    assert message.value == 1.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("values_of_a_byte", "size"), [(range(256), 60_000), (b"\0\x80\xf8\xfc\xfe\xff", 2000)]
)
def test_of_a_stream_no_frame_behind_a_disturbed_line_is_lost(
    values_of_a_byte: Sequence[int], size: int, seed: int
) -> None:
    """A read after the loop was held up: all of the noise, random or of glitches, and what followed it."""
    noise = bytes(random.Random(seed).choices(values_of_a_byte, k=size))
    sender, receiver = Codec(7, 1), Codec(1, 191)
    # A frame of another kind that begins with the noise's end may take the first nine with it.
    good = b"".join(sender.encode(reading(float(number))) for number in range(40))
    received = receiver.decode(noise + good, stream=True)
    heard = [each for each in received if each.get_type() == "NAMED_VALUE_FLOAT"]
    assert values(heard)[-30:] == [float(number) for number in range(10, 40)]


def test_mavlink_1_is_understood() -> None:
    mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    (message,) = Codec(1, 191).decode(heartbeat().pack(mav, force_mavlink1=True))
    assert message.get_type() == "HEARTBEAT"


def test_tails_of_many_peers_stay_bounded() -> None:
    receiver = Codec(1, 191)
    packet = Codec(7, 1).encode(heartbeat())
    for peer in range(1000):
        receiver.decode(packet[:-1], peer)
    assert receiver.decode(packet[-1:], 999)[0].get_type() == "HEARTBEAT"
    assert receiver.decode(packet[-1:], 0) == []
