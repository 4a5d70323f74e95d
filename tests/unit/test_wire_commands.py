"""Commands and their answers as bytes: what is sealed, what is refused, and that the token is told to nobody."""

import hashlib
import hmac
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import cbor2
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy import wire_commands as wire
from autonomy.effects import Answer, Outcome
from autonomy.wire import VERSION, VersionError, WireError

SECRET = b"0123456789abcdefghij"
TOKEN, OTHER = wire.Token(SECRET), wire.Token(b"another secret altogether")
REQUEST = wire.Request(bytes(range(16)), "boat1", "pause", 1.7e9, 30.0)
ANSWER = Answer(bytes(16), "pause", Outcome.DONE, "it is", "paused", "why", "AUTO", armed=True, utc_s=1.7e9)


def message(content: dict[str, Any], token: wire.Token | None = None, **outer: Any) -> bytes:
    inner = cbor2.dumps(content)
    sealed = {} if token is None else {"mac": token.code("command", inner)}
    return bytes(cbor2.dumps({"v": VERSION, "command": inner, **sealed, **outer}))


def fields(**changes: Any) -> dict[str, Any]:
    sound = {"id": bytes(16), "vehicle": "boat1", "verb": "pause", "issued_utc_s": 1.7e9, "valid_s": 30.0}
    return {name: value for name, value in (sound | changes).items() if value is not ...}


@pytest.mark.parametrize("token", [None, TOKEN])
def test_what_is_written_is_read(token: wire.Token | None) -> None:
    assert wire.decode_request(wire.encode_request(REQUEST, token), "boat1", token) == REQUEST
    data = wire.encode_answer(ANSWER, recorded=True, token=token)
    assert wire.decode_answer(data, token) == (ANSWER, True)


def test_the_seal_is_hmac_sha256_as_the_documentation_has_it() -> None:
    message = cbor2.loads(wire.encode_request(REQUEST, TOKEN))
    signed = b"halocline/command/3\0" + message["command"]
    assert message["mac"] == hmac.digest(SECRET, signed, hashlib.sha256)


@pytest.mark.parametrize(
    ("data", "token", "says"),
    [
        (wire.encode_request(REQUEST, None), TOKEN, "not sealed with the vehicle's token"),
        (wire.encode_request(REQUEST, OTHER), TOKEN, "sealed with another token"),
        (message(fields(), mac=b""), TOKEN, "sealed with another token"),
        (message(fields(), mac="x"), TOKEN, "sealed with another token"),
        # An answer's seal is none of a command's, though the key is the same.
        (message(fields(), mac=TOKEN.code("answer", cbor2.dumps(fields()))), TOKEN, "another token"),
    ],
)
def test_who_has_not_the_token_is_no_operator(data: bytes, token: wire.Token, says: str) -> None:
    with pytest.raises(wire.UnauthorisedError, match=says):
        wire.decode_request(data, "boat1", token)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "command: is not CBOR"),
        (b"\xff" * 50, "command: is not CBOR"),
        (cbor2.dumps([1]), "command: must be a map"),
        (b"\x00" * 5000, "command: must have at most 4096 bytes"),
        (cbor2.dumps({"v": VERSION}), "command: command: must be a byte string"),
        (cbor2.dumps({"v": VERSION, "command": b"\x00"}), "command: must be a map"),
        (message(fields(), v=2), "command: v: must be 3"),
        (message(fields(id=bytes(15))), "command: id: must be 16 bytes"),
        (message(fields(id=...)), "command: id: is missing"),
        (message(fields(verb="arm")), "command: verb: must be one of start, pause"),
        (message(fields(vehicle="boat2")), "command: vehicle: must be boat1 .got boat2"),
        (message(fields(vehicle="boat1/*")), "command: vehicle: must match"),
        (message(fields(issued_utc_s=float("nan"))), "command: issued_utc_s: must be a number"),
        (message(fields(valid_s=601.0)), "command: valid_s: must be a number from 1 to 600"),
        (message(fields(valid_s=0.0)), "command: valid_s: must be a number from 1 to 600"),
        (message(fields(valid_s=True)), "command: valid_s: must be a number"),
    ],
)
def test_what_is_no_command_is_told_why(data: bytes, says: str) -> None:
    with pytest.raises(WireError, match=says):
        wire.decode_request(data, "boat1", None)


def test_another_version_is_called_that() -> None:
    with pytest.raises(VersionError):
        wire.decode_request(message(fields(), v=2), "boat1", None)


@given(st.data())
def test_no_bit_of_a_sealed_command_can_be_changed(data: st.DataObject) -> None:
    sound = wire.encode_request(REQUEST, TOKEN)
    place = data.draw(st.integers(0, 8 * len(sound) - 1))
    changed = bytearray(sound)
    changed[place // 8] ^= 1 << place % 8
    try:
        read = wire.decode_request(bytes(changed), "boat1", TOKEN)
    except WireError:
        return
    assert read == REQUEST, "nothing but how its bytes are written may differ"


def test_sentences_are_cut_and_bounds_are_kept_when_writing() -> None:
    long = replace(ANSWER, text="x" * 1000, reason="y" * 1000)
    data = wire.encode_answer(long, recorded=False, token=TOKEN)
    assert len(data) < wire.MAXIMUM_BYTES
    assert wire.decode_answer(data, TOKEN)[0].text == "x" * 400
    with pytest.raises(WireError, match="verb: must be one of"):
        wire.encode_request(replace(REQUEST, verb="arm"), None)


def test_the_token_is_told_to_nobody(tmp_path: Path) -> None:
    assert SECRET.decode() not in repr(TOKEN)
    with pytest.raises(TypeError):
        pickle.dumps(TOKEN)
    file = tmp_path / "boat1.token"
    file.write_bytes(SECRET + b"\n")
    file.chmod(0o640)
    with pytest.raises(wire.TokenError, match="others may read"):
        wire.read_token(file, {})
    file.chmod(0o600)
    assert wire.read_token(file, {}).code("x", b"y") == TOKEN.code("x", b"y")
    file.write_bytes(b"short\n")
    with pytest.raises(wire.TokenError, match=r"at least 16 bytes, not 5") as error:
        wire.read_token(file, {})
    assert "short" not in str(error.value)
