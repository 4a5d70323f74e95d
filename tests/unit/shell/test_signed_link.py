"""Timestamps of a signed link, kept over restarts in a file that may be lost or spoilt."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from autonomy.config import Configuration
from autonomy.mavlink.codec import Codec
from autonomy.mavlink.signing import MAXIMUM_PLEDGED, MAXIMUM_STREAMS, KeyFileError, Signing, SigningKey
from autonomy.shell import signed_link as module
from autonomy.shell.signed_link import FILE_NAME, SignedLink, open_signed_link

NOW_S = 1_750_000_000.0
AHEAD_S = 3_000_000_000.0
"""Of a clock that is ahead of any computer's."""
KEY = SigningKey(bytes(32))
AREA: Any = {"area": [[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]]}


def link(folder: Path, utc_s: float = NOW_S) -> SignedLink:
    return SignedLink(KEY, 0, folder / FILE_NAME, utc_s=lambda: utc_s)


def heartbeat() -> Any:
    return mavlink.MAVLink_heartbeat_message(11, 3, 81, 10, 4, 3)


def ticks(packet: bytes) -> int:
    return int.from_bytes(packet[-12:-6], "little")


def configuration(key_file: Path) -> Configuration:
    return Configuration.model_validate({"survey": AREA, "mavlink": {"signing": {"key_file": str(key_file)}}})


def test_the_file_is_there_before_the_first_packet(tmp_path: Path) -> None:
    """A run that is killed at once has used timestamps too."""
    first = link(tmp_path / "state")
    used = ticks(Codec(1, 191, first.signing).encode(heartbeat()))
    again = link(tmp_path / "state", utc_s=0.0)  # killed, and the clock is lost
    assert ticks(Codec(1, 191, again.signing).encode(heartbeat())) > used
    first.close()
    again.close()


def test_what_was_accepted_is_not_accepted_by_the_next_run(tmp_path: Path) -> None:
    first = link(tmp_path)
    sender = Codec(1, 1, Signing(KEY, lambda: NOW_S))
    packets = [sender.encode(heartbeat()) for _ in range(50)]
    codec = Codec(1, 191, first.signing)
    for packet in packets:
        assert len(codec.decode(packet)) == 1
        if first.signing.is_due:
            first.tend()
    first.close()
    again = link(tmp_path, utc_s=0.0)
    codec = Codec(1, 191, again.signing)
    assert [message for packet in packets for message in codec.decode(packet)] == []
    assert again.report == "refused: 50 replayed"
    again.close()


def test_of_as_many_senders_as_are_accepted_none_is_forgotten(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """They and we ourselves: what a run writes the next one reads."""
    first = link(tmp_path)
    codec = Codec(1, 191, first.signing)
    senders = [(2 + number // 200, 1 + number % 200) for number in range(MAXIMUM_STREAMS)]
    packets = [Codec(*sender, Signing(KEY, lambda: NOW_S)).encode(heartbeat()) for sender in senders]
    assert sum(len(codec.decode(packet)) for packet in packets) == MAXIMUM_STREAMS
    codec.encode(heartbeat())
    first.tend()
    first.close()
    again = link(tmp_path)
    codec = Codec(1, 191, again.signing)
    assert [message for packet in packets for message in codec.decode(packet)] == []
    assert again.report == f"refused: {MAXIMUM_STREAMS} replayed"
    again.close()
    assert caplog.text == ""


def test_however_often_our_own_identity_changes_the_file_can_be_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Of what finds no room the oldest goes: from a sender who is not known what was said then is stale."""
    for run in range(30):
        utc_s = NOW_S + 100.0 * run
        signed = SignedLink(KEY, run, tmp_path / FILE_NAME, utc_s=lambda utc_s=utc_s: utc_s)
        codec = Codec(1, 191, signed.signing)
        for number in range(0 if run else MAXIMUM_STREAMS):
            sender = Codec(2 + number // 200, 1 + number % 200, Signing(KEY, lambda: NOW_S))
            codec.decode(sender.encode(heartbeat()))
        used = ticks(codec.encode(heartbeat()))
        signed.tend()
        signed.close()
        kept = module._decode((tmp_path / FILE_NAME).read_bytes())
        assert kept.streams[run, 1, 191] >= used
    assert len(kept.streams) == MAXIMUM_PLEDGED
    assert {link for link, system, _ in kept.streams if system == 1} == set(range(30)), "ours are the newest"
    assert "can't be read" not in caplog.text


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"[]",
        b"{}",
        b"\xff",
        b"[" * 10_000,
        b'{"version": 2, "timestamp": 1, "streams": []}',
        b" " * 2**17,
    ]
    + [
        json.dumps({"version": 1, "timestamp": timestamp, "streams": streams}).encode()
        for timestamp, streams in (
            (-1, []),
            (2**48, []),
            (1.5, []),
            (1, [[1, 2, 3]]),
            (1, [[1, 2, 300, 4]]),
            (1, [[1, 2, 3, -4]]),
            (1, [[i // 250, 1, i % 250, 4] for i in range(300)]),
        )
    ],
)
def test_a_spoilt_file_is_told_and_begun_anew(
    tmp_path: Path, content: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / FILE_NAME).write_bytes(content)
    link(tmp_path).close()
    assert "packets of earlier runs may be replayed" in caplog.text
    caplog.clear()
    link(tmp_path).close()
    assert caplog.text == ""


@given(st.binary(max_size=200))
def test_no_bytes_in_the_file_raise_anything_else(data: bytes) -> None:
    try:
        module._decode(data)
    except ValueError:
        return


def test_a_full_disk_is_told_and_the_link_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    signed = link(tmp_path)
    codec = Codec(1, 191, signed.signing)

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "write_atomically", full)
    assert len(codec.decode(Codec(1, 1, Signing(KEY, lambda: NOW_S)).encode(heartbeat()))) == 1
    signed.tend()
    signed.close()
    assert "No space left" in signed.report
    assert "No space left" in caplog.text


def test_a_disk_that_is_full_at_the_start_costs_nothing_that_was_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """What earlier runs have used and accepted is known; once there is room, what this one has is kept too."""
    file = tmp_path / "key"
    file.write_bytes(bytes(32))
    file.chmod(0o600)
    section = {"key_file": str(file), "form": "key"}
    settings = Configuration.model_validate({"survey": AREA, "mavlink": {"signing": section}})
    sender = Codec(1, 1, Signing(KEY, lambda: AHEAD_S))
    heard = sender.encode(heartbeat())
    first = link(tmp_path, utc_s=AHEAD_S)
    assert len(Codec(1, 191, first.signing).decode(heard)) == 1
    used = ticks(Codec(1, 191, first.signing).encode(heartbeat()))
    first.tend()
    first.close()
    sound = module.write_atomically

    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "write_atomically", full)
    again = open_signed_link(settings, {"STATE_DIRECTORY": str(tmp_path)})
    assert again is not None
    assert "No space left" in again.report
    assert caplog.text.count("No space left") == 1
    codec = Codec(1, 191, again.signing)
    assert ticks(codec.encode(heartbeat())) > used
    assert codec.decode(heard) == []
    monkeypatch.setattr(module, "write_atomically", sound)
    for _ in range(20_000):  # further than the pledge of the run before
        used = ticks(codec.encode(heartbeat()))
    again.tend()
    again.close()
    assert "are not kept" not in again.report
    last = link(tmp_path, utc_s=0.0)
    assert ticks(Codec(1, 191, last.signing).encode(heartbeat())) > used
    last.close()


def test_without_a_place_for_it_the_link_is_signed_and_says_so(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_text("correct horse\n")
    file.chmod(0o600)
    signed = open_signed_link(configuration(file), {})
    assert signed is not None
    assert "are not kept: neither STATE_DIRECTORY nor" in signed.report
    signed.tend()
    signed.close()
    (tmp_path / "no folder").write_text("")
    signed = open_signed_link(configuration(file), {"STATE_DIRECTORY": str(tmp_path / "no folder")})
    assert signed is not None
    assert "no folder" in signed.report
    signed.close()


def test_no_key_no_signing(tmp_path: Path) -> None:
    assert open_signed_link(Configuration.model_validate({"survey": AREA}), {}) is None
    with pytest.raises(KeyFileError, match="No such file"):
        open_signed_link(configuration(tmp_path / "key"), {})


def test_refusals_are_told_at_first_and_then_by_tens(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.WARNING)
    signed = link(tmp_path)
    codec, stranger = Codec(1, 191, signed.signing), Codec(1, 1)
    for _ in range(1000):
        codec.decode(stranger.encode(heartbeat()))
        signed.tend()
    signed.close()
    assert [record.getMessage().rpartition(" refused: ")[2] for record in caplog.records] == [
        f"{count} unsigned" for count in (1, 10, 100, 1000)
    ]
