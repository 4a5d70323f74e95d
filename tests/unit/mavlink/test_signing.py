"""Signing held against pymavlink's own, against forgers and against replays, over restarts too."""

import copy
import hashlib
import pickle
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.events import MessageReceived
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import (
    MAXIMUM_STREAMS,
    TICKS_PER_S,
    KeyFormatError,
    Pledge,
    Refusal,
    Signing,
    SigningKey,
    told,
)
from autonomy.records import Happened, RecordDecoder, encode_event

NOW_S = 1_750_000_000.0
SECRET = hashlib.sha256(b"correct horse").digest()
KEY = SigningKey(SECRET)
OTHER = SigningKey(hashlib.sha256(b"battery staple").digest())


def signing(key: SigningKey = KEY, behind_s: float = 0.0, **more: Any) -> Signing:
    return Signing(key, lambda: NOW_S - behind_s, **more)


def heartbeat(mode: int = 10) -> Any:
    return mavlink.MAVLink_heartbeat_message(11, 3, 81, mode, 4, 3)


def ticks(packet: bytes) -> int:
    return int.from_bytes(packet[-12:-6], "little")


def stranger(secret: bytes = SECRET, timestamp: int | None = None, link_id: int = 3) -> Any:
    """pymavlink's own signing, as a ground station in Python does it."""
    mav = mavlink.MAVLink(None, 255, 190)
    mav.signing.secret_key = secret
    mav.signing.sign_outgoing = True
    mav.signing.link_id = link_id
    mav.signing.timestamp = round((NOW_S - 1_420_070_400) * TICKS_PER_S) if timestamp is None else timestamp
    return mav


def receiver(**more: Any) -> tuple[Codec, Signing]:
    checks = signing(**more)
    return Codec(1, 191, checks), checks


# What others sign, and what others check --------------------------------------------------------------------------


def test_what_we_sign_pymavlink_accepts_and_the_other_way_round() -> None:
    ours, theirs = Codec(1, 191, signing(link_id=7)), stranger()
    theirs.robust_parsing = True
    codec, checks = receiver()
    for mode in range(5):
        heard = theirs.parse_buffer(ours.encode(heartbeat(mode)))[0]
        assert (heard.get_type(), heard.custom_mode, heard.get_signed()) == ("HEARTBEAT", mode, True)
        assert heard.get_link_id() == 7
        (heard,) = codec.decode(heartbeat(mode).pack(theirs))
        assert heard.custom_mode == mode
    assert theirs.signing.goodsig_count == 5
    assert not checks.refused


def test_pymavlink_refuses_ours_under_another_key() -> None:
    theirs = stranger(hashlib.sha256(b"battery staple").digest())
    with pytest.raises(mavlink.MAVError, match="Invalid signature"):
        theirs.parse_buffer(Codec(1, 191, signing()).encode(heartbeat()))


@given(st.integers(0, 255), st.integers(0, 2**32 - 1), st.integers(0, 255))
def test_a_signature_is_pymavlinks_bit_for_bit(link_id: int, mode: int, sequence: int) -> None:
    ours = signing(link_id=link_id)
    plain = mavlink.MAVLink(None, 1, 191)
    plain.seq = sequence
    packet = ours.sign(heartbeat(mode).pack(plain), heartbeat().crc_extra)
    theirs = stranger(timestamp=ticks(packet), link_id=link_id)
    theirs.srcSystem, theirs.srcComponent, theirs.seq = 1, 191, sequence
    assert packet == heartbeat(mode).pack(theirs)


# Who is refused ---------------------------------------------------------------------------------------------------


def refused(codec: Codec, checks: Signing, packet: bytes) -> Refusal:
    before = checks.refused.copy()
    assert codec.decode(packet) == []
    (kind,) = (checks.refused - before).elements()
    return kind


def test_unsigned_packets_of_either_version_are_refused() -> None:
    codec, checks = receiver()
    plain = mavlink.MAVLink(None, 1, 1)
    assert refused(codec, checks, heartbeat().pack(plain)) is Refusal.UNSIGNED
    assert refused(codec, checks, heartbeat().pack(plain, force_mavlink1=True)) is Refusal.UNSIGNED


def test_wrongly_signed_packets_are_refused() -> None:
    codec, checks = receiver()
    assert refused(codec, checks, Codec(1, 1, signing(OTHER)).encode(heartbeat())) is Refusal.WRONG


@given(st.integers(0, 6 * 8 - 1))
def test_a_signature_that_is_wrong_in_one_bit_is_wrong(bit: int) -> None:
    codec, checks = receiver()
    packet = bytearray(Codec(1, 1, signing()).encode(heartbeat()))
    packet[-6 + bit // 8] ^= 1 << bit % 8
    assert refused(codec, checks, bytes(packet)) is Refusal.WRONG


@given(st.integers(0, 6), st.integers(0, 7))
def test_link_and_timestamp_are_signed_too(byte: int, bit: int) -> None:
    codec, checks = receiver()
    packet = bytearray(Codec(1, 1, signing()).encode(heartbeat()))
    packet[-13 + byte] ^= 1 << bit
    assert refused(codec, checks, bytes(packet)) is Refusal.WRONG


def test_a_packet_is_accepted_once() -> None:
    codec, checks = receiver()
    sender = Codec(1, 1, signing())
    packets = [sender.encode(heartbeat(mode)) for mode in range(3)]
    assert [message.custom_mode for message in codec.decode(b"".join(packets), "a")] == [0, 1, 2]
    for packet in packets:
        assert refused(codec, checks, packet) is Refusal.REPLAYED
        assert codec.decode(packet, "another way round") == []
    assert codec.decode(sender.encode(heartbeat())) != []


def test_what_we_have_said_is_not_taken_from_others_and_by_the_next_run_neither() -> None:
    codec, checks = receiver()
    said = [codec.encode(heartbeat()) for _ in range(3)]
    codec.system_id = 7  # the vehicle's is known now
    said += [codec.encode(heartbeat()) for _ in range(3)]
    for packet in said:
        assert refused(codec, checks, packet) is Refusal.REPLAYED
    again = Signing(KEY, lambda: NOW_S - 1e6, pledge=checks.pledge())
    later = Codec(1, 191, again)
    assert [message for packet in said for message in later.decode(packet)] == []
    assert len(later.decode(Codec(1, 1, signing()).encode(heartbeat()))) == 1


def test_each_stream_has_timestamps_of_its_own() -> None:
    codec, _ = receiver()
    quick, slow = Codec(1, 1, signing()), Codec(1, 1, signing(behind_s=20.0, link_id=1))
    probe = Codec(1, 200, signing(behind_s=30.0))
    for _ in range(3):
        for sender in (quick, slow, probe):
            assert len(codec.decode(sender.encode(heartbeat()))) == 1


def test_a_sender_whose_clock_is_two_minutes_slow_is_refused_and_one_half_a_minute_slow_is_not() -> None:
    codec, checks = receiver()
    assert refused(codec, checks, Codec(1, 1, signing(behind_s=120.0)).encode(heartbeat())) is Refusal.STALE
    assert codec.decode(Codec(1, 1, signing(behind_s=30.0)).encode(heartbeat())) != []


def test_a_slow_sender_that_hears_us_is_accepted_from_then_on() -> None:
    """As the guide has it: whoever accepts a packet does not use older timestamps than its."""
    codec, checks = receiver()
    slow = signing(behind_s=86_400.0)
    sender = Codec(1, 1, slow)
    assert refused(codec, checks, sender.encode(heartbeat())) is Refusal.STALE
    assert sender.decode(codec.encode(heartbeat())) != []
    assert codec.decode(sender.encode(heartbeat())) != []


def test_a_forger_can_not_silence_an_honest_sender() -> None:
    """pymavlink's check takes a timestamp for the stream's before it has looked at the signature."""
    forged = Codec(255, 190, signing(OTHER, behind_s=-1e8, link_id=3)).encode(heartbeat())
    theirs, honest = stranger(), stranger()
    theirs.robust_parsing = True
    theirs.parse_buffer(forged)
    (silenced,) = theirs.parse_buffer(heartbeat().pack(honest))
    assert silenced.get_type() == "BAD_DATA"  # if this fails, pymavlink's check has become fit for use

    codec, checks = receiver()
    assert refused(codec, checks, forged) is Refusal.WRONG
    assert codec.decode(heartbeat().pack(stranger())) != []


def test_forgers_take_no_memory() -> None:
    codec, checks = receiver()
    for system in range(1, 256):
        codec.decode(Codec(system, 1, signing(OTHER)).encode(heartbeat()))
    assert checks.pledge().streams == {}
    for number in range(MAXIMUM_STREAMS + 5):
        codec.decode(Codec(1 + number % 250, 1 + number // 250, signing()).encode(heartbeat()))
    assert len(checks.pledge().streams) == MAXIMUM_STREAMS
    assert checks.refused[Refusal.CROWDED] == 5


def test_a_radio_without_a_key_is_heard_and_nobody_else() -> None:
    codec, checks = receiver()
    status = mavlink.MAVLink_radio_status_message(200, 190, 100, 40, 40, 0, 0)
    (heard,) = codec.decode(Codec(51, 68).encode(status))
    assert heard.get_type() == "RADIO_STATUS"
    assert checks.exempt == 1
    assert refused(codec, checks, Codec(51, 68, signing(OTHER)).encode(status)) is Refusal.WRONG
    assert refused(codec, checks, Codec(51, 68).encode(heartbeat())) is Refusal.UNSIGNED


@pytest.mark.parametrize("with_key", [False, True])
def test_nobody_gets_to_see_a_message_that_brings_a_key(with_key: bool) -> None:
    """It would be recorded in the journal, key and all."""
    checks = signing() if with_key else None
    codec = Codec(1, 191, checks)
    message = mavlink.MAVLink_setup_signing_message(1, 191, list(SECRET), 0)
    assert codec.decode(Codec(255, 190, signing()).encode(message)) == []
    assert codec.counters.keys == 1


@given(st.binary(max_size=400), st.integers(0, 3))
def test_no_bytes_raise_and_none_without_the_key_are_accepted(data: bytes, cut: int) -> None:
    codec, checks = receiver()
    good = Codec(1, 1, signing()).encode(heartbeat())
    assert codec.decode(data) == []
    assert codec.decode(good[: len(good) - cut - 1], "cut") == []
    assert codec.decode(good, "whole") != []
    assert sum(checks.refused.values()) <= 1 + len(data)


def test_a_journal_gives_back_what_was_signed() -> None:
    """It holds packets as they came; they were checked then, and need no key now."""
    codec, _ = receiver()
    (heard,) = codec.decode(Codec(7, 1, signing()).encode(heartbeat(15)))
    record = RecordDecoder().decode(encode_event(1.0, MessageReceived(heard)))
    assert isinstance(record, Happened)
    assert isinstance(record.event, MessageReceived)
    assert record.event.message.custom_mode == 15
    assert record.event.message.get_msgbuf() == heard.get_msgbuf()


# Timestamps over restarts -----------------------------------------------------------------------------------------


def test_timestamps_grow_whatever_the_clock_does() -> None:
    clock = iter([NOW_S, NOW_S, NOW_S - 1e6, 0.0, NOW_S + 5, NOW_S + 4] + [NOW_S] * 10)
    ours = Signing(KEY, lambda: next(clock))
    seen = [ticks(ours.sign(heartbeat().pack(mavlink.MAVLink(None, 1, 1)), 50)) for _ in range(6)]
    assert seen == sorted(set(seen))
    assert seen[0] == round((NOW_S - 1_420_070_400) * TICKS_PER_S) + 1


def test_a_run_after_the_clock_was_lost_uses_no_timestamp_again() -> None:
    first = signing()
    pledge = first.pledge()
    plain = heartbeat().pack(mavlink.MAVLink(None, 1, 1))
    used = [ticks(first.sign(plain, 50)) for _ in range(1000)]
    again = Signing(KEY, lambda: 0.0, pledge=pledge)
    assert ticks(again.sign(plain, 50)) > max(used)


def test_restarts_do_not_run_away_from_the_clock() -> None:
    """A vehicle more than a minute ahead would have to be heard before it accepts anybody new."""
    clock = [NOW_S]
    pledge = None
    for _ in range(1000):
        run = Signing(KEY, lambda: clock[0], pledge=pledge)
        run.pledge()
        for _ in range(20):
            last = ticks(run.sign(heartbeat().pack(mavlink.MAVLink(None, 1, 1)), 50))
        pledge = run.pledge()
        clock[0] += 0.5
    assert last / TICKS_PER_S - (clock[0] - 1_420_070_400) < 10.0


def steps() -> Iterator[int]:
    yield from (1, 3, 900, TICKS_PER_S // 25, TICKS_PER_S)


@given(
    st.lists(st.integers(1, 3 * TICKS_PER_S), min_size=1, max_size=60),
    st.sampled_from([1, 3, 900, TICKS_PER_S // 25, TICKS_PER_S]),
    st.data(),
)
def test_what_was_accepted_before_a_restart_is_not_accepted_after_it(
    jumps: list[int], step: int, data: st.DataObject
) -> None:
    """Whenever the run ends, as long as every pledge that was due was kept; whatever the clock says then."""
    start = round((NOW_S - 1_420_070_400) * TICKS_PER_S)
    checks = signing()
    codec, kept = Codec(1, 191, checks), checks.pledge()
    packets, timestamp = [], start
    for jump in jumps:
        timestamp += jump if jump % 7 == 0 else step
        packets.append(heartbeat().pack(stranger(timestamp=timestamp)))
        assert len(codec.decode(packets[-1])) == 1
        if checks.is_due or data.draw(st.booleans()):
            kept = checks.pledge()
        assert not checks.is_due
    clock_s = data.draw(st.sampled_from([0.0, NOW_S, NOW_S + 100]))
    again = Signing(KEY, lambda: clock_s, pledge=kept)
    later = Codec(1, 191, again)
    assert [message for packet in packets for message in later.decode(packet)] == []
    # Who hears us again is heard again, whether its clock is right or not.
    sender = stranger(timestamp=timestamp)
    sender.parse_buffer(later.encode(heartbeat()))
    sender.signing.timestamp += 1
    assert len(later.decode(heartbeat().pack(sender))) == 1


@pytest.mark.parametrize("step", list(steps()))
def test_a_steady_sender_is_pledged_for_ahead_and_not_too_far(step: int) -> None:
    """At most some seconds of its packets are lost to a restart, and the disk is not written for each of them."""
    checks = signing()
    codec, due = Codec(1, 191, checks), 0
    sender = stranger()
    for _ in range(200):
        sender.signing.timestamp += step - 1
        assert len(codec.decode(heartbeat().pack(sender))) == 1
        due += checks.is_due
        pledge = checks.pledge() if checks.is_due else None
    pledge = checks.pledge()
    (floor,) = pledge.streams.values()
    assert 0 <= floor - sender.signing.timestamp <= 6 * TICKS_PER_S
    assert due <= 100


# Keys -------------------------------------------------------------------------------------------------------------


def test_a_passphrase_makes_the_key_that_ground_stations_make() -> None:
    for content in (b"correct horse", b"correct horse\n", b"correct horse\r\n"):
        made = SigningKey.from_file_content(content, "passphrase")
        assert made.signature(b"x") == KEY.signature(b"x")
    spaced = SigningKey.from_file_content(b" correct horse", "passphrase")
    assert spaced.signature(b"x") != KEY.signature(b"x")


def test_a_key_is_32_bytes_or_64_digits() -> None:
    for content in (SECRET, SECRET.hex().encode(), SECRET.hex().upper().encode() + b"\n"):
        assert SigningKey.from_file_content(content, "key").signature(b"x") == KEY.signature(b"x")


@pytest.mark.parametrize(
    ("content", "form"),
    [
        (b"", "passphrase"),
        (b" \n", "passphrase"),
        (b"", "key"),
        (b"f" * 63, "key"),
        (b"g" * 64, "key"),
        (SECRET + b"\n", "key"),
    ],
)
def test_what_is_no_key_is_told_without_telling_it(content: bytes, form: str) -> None:
    with pytest.raises(KeyFormatError) as error:
        SigningKey.from_file_content(content, form)
    if len(content) > 8:
        assert content.decode(errors="replace")[:8] not in str(error.value)


def test_a_key_does_not_get_out() -> None:
    for text in (repr(KEY), str(KEY), repr(vars(signing())), repr(signing()), told(signing().refused)):
        assert SECRET.hex() not in text
        assert repr(SECRET) not in text
    for way in (pickle.dumps, copy.copy, copy.deepcopy):
        with pytest.raises(TypeError, match="not to be written"):
            way(KEY)  # type: ignore[operator]


def test_what_was_refused_in_words() -> None:
    assert told({}) == ""
    counts = {Refusal.REPLAYED: 2, Refusal.UNSIGNED: 12}
    assert told(counts) == "refused: 12 unsigned, 2 replayed"


def test_a_pledge_of_nothing_is_nothing() -> None:
    assert Pledge() == Pledge(0, {})
    with pytest.raises(ValueError, match="0 to 255"):
        signing(link_id=256)
