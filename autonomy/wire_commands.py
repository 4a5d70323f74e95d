"""What may be asked of a vehicle to do, `usv/<vehicle>/command`, and its answers, as bytes. See docs/wire.md.

Both are sealed: the content is a byte string within a map, and a code that only who has the vehicle's token can make
(HMAC-SHA256) stands beside it. It covers the very bytes, the kind of message and, within them, vehicle, id and time:
what was overheard cannot be changed, told another vehicle, or told again when its time is over.
"""

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cbor2

from autonomy import wire_kinds as kinds
from autonomy.config.private import PrivateFileError, read_private
from autonomy.effects import Answer, Outcome
from autonomy.wire import VERSION
from autonomy.wire_kinds import Rule, VersionError, WireError, brief
from autonomy.wire_rules import MAXIMUM_REASON, VEHICLE_NAME

VERBS = ("start", "pause", "resume", "replan", "finish", "return")
"""What changes something."""
STATUS = "status"
"""What only asks."""

MAXIMUM_BYTES = 4096
"""Of a command and of an answer."""
ID_BYTES = 16
LONGEST_VALID_S = 600.0
SHORTEST_TOKEN = 16
"""Bytes: what a person thinks up in a minute is guessed in one."""

_COMMAND, _ANSWER = "command", "answer"


class UnauthorisedError(WireError):
    """The message does not come from who has the token."""


class TokenError(ValueError):
    """There is no usable token in a file; says why, never what is in it."""


class Token:
    """The secret that vehicle and operator share; neither `repr` nor `pickle` tells it.

    Args:
        secret: at least `SHORTEST_TOKEN` bytes; blanks and line ends around it do not count.

    Raises:
        TokenError: it is too short.
    """

    __slots__ = ("_secret",)

    def __init__(self, secret: bytes) -> None:
        self._secret = secret.strip()
        if len(self._secret) < SHORTEST_TOKEN:
            raise TokenError(f"a token has at least {SHORTEST_TOKEN} bytes, not {len(self._secret)}")

    def __reduce__(self) -> tuple[object, ...]:
        raise TypeError("a token is not to be written anywhere")

    def code(self, kind: str, content: bytes) -> bytes:
        """What only who has the token can make of a message's content."""
        signed = f"halocline/{kind}/{VERSION}".encode() + b"\0" + content
        return hmac.new(self._secret, signed, hashlib.sha256).digest()


def read_token(file: Path, environment: Mapping[str, str]) -> Token:
    """The token in a file.

    Raises:
        TokenError: it can't be read, others may read it, or it is too short.
    """
    try:
        return Token(read_private(file, environment))
    except PrivateFileError as error:
        raise TokenError(str(error)) from None
    except TokenError as error:
        raise TokenError(f"{str(file)!a}: {error}") from None


@dataclass(frozen=True)
class Request:
    """What somebody ashore wants done.

    Attributes:
        command_id: 16 bytes, made anew for each command, and the same when it is repeated.
        vehicle: for which it is.
        verb: one of `VERBS`, or `STATUS`.
        issued_utc_s: when it was issued, seconds since 1970, by the vehicle's clock as far as it is known ashore.
        valid_s: it is carried out within so many seconds, or not at all.
    """

    command_id: bytes
    vehicle: str
    verb: str
    issued_utc_s: float
    valid_s: float


def command_key(vehicle: str) -> str:
    """The key under which a vehicle takes commands."""
    return f"usv/{vehicle}/command"


def command_schema() -> str:
    """Name of the schema of command and answer."""
    return f"halocline/command/{VERSION}"


def encode_request(request: Request, token: Token | None) -> bytes:
    """The bytes of a command, sealed if there is a token. WireError if a field is outside the bounds of `decode`."""
    content = {
        "id": request.command_id,
        "vehicle": request.vehicle,
        "verb": request.verb,
        "issued_utc_s": request.issued_utc_s,
        "valid_s": request.valid_s,
    }
    kinds.each(content, _REQUEST)
    return _sealed(_COMMAND, content, token)


def decode_request(data: bytes, vehicle: str, token: Token | None) -> Request:
    """The command in received bytes, which may come from anybody.

    Args:
        data: the payload of the query.
        vehicle: who we are.
        token: that it must be sealed with; None: it need not be, and a seal is not looked at.

    Raises:
        UnauthorisedError: it is not sealed with this token.
        VersionError: it is of another version.
        WireError: it is no command, or for another vehicle.
    """
    values = _opened(_COMMAND, data, token, _REQUEST)
    values["command_id"] = values.pop("id")
    request = Request(**values)
    if request.vehicle != vehicle:
        raise WireError(f"command: vehicle: must be {vehicle} (got {request.vehicle})")
    return request


def encode_answer(answer: Answer, *, recorded: bool, token: Token | None) -> bytes:
    """The bytes of an answer, sealed if there is a token.

    Args:
        answer: what became of the command; words that are too long are cut.
        recorded: whether command and answer are on the vehicle's disk.
        token: the vehicle's.
    """
    content = {
        "id": answer.command_id,
        "verb": answer.verb,
        "outcome": answer.outcome.value,
        "text": answer.text[:MAXIMUM_REASON],
        "state": answer.state,
        "reason": answer.reason[:MAXIMUM_REASON],
        "mode": answer.mode,
        "armed": answer.armed,
        "utc_s": answer.utc_s,
        "recorded": recorded,
    }
    kinds.each(content, _REPLY)
    return _sealed(_ANSWER, content, token)


def decode_answer(data: bytes, token: Token | None) -> tuple[Answer, bool]:
    """The answer in received bytes, which may come from anybody, and whether it is recorded. Raises as above."""
    values = _opened(_ANSWER, data, token, _REPLY)
    values["command_id"], values["outcome"] = values.pop("id"), Outcome(values["outcome"])
    recorded = bool(values.pop("recorded"))
    return Answer(**values), recorded


def _sealed(kind: str, content: dict[str, Any], token: Token | None) -> bytes:
    inner = cbor2.dumps(content)
    message = {"v": VERSION, kind: inner}
    if token is not None:
        message["mac"] = token.code(kind, inner)
    return cbor2.dumps(message)


def _opened(kind: str, data: bytes, token: Token | None, rules: dict[str, Rule]) -> dict[str, Any]:
    """The fields of a sealed message. Raises as `decode_request`."""
    message = _map(kind, data)
    if message.get("v") != VERSION:
        raise VersionError(
            f"{kind}: v: must be {VERSION} (got {brief(message.get('v'))}): "
            "the software on board and ashore must be of the same version; update the older"
        )
    inner = message.get(kind)
    if not isinstance(inner, bytes):
        raise WireError(f"{kind}: {kind}: must be a byte string (got {brief(inner)})")
    if token is not None:
        code = message.get("mac")
        if code is None:
            raise UnauthorisedError(f"{kind}: it is not sealed with the vehicle's token")
        if not isinstance(code, bytes) or not hmac.compare_digest(code, token.code(kind, inner)):
            raise UnauthorisedError(f"{kind}: it is sealed with another token than the vehicle's")
    try:
        return kinds.each(_map(kind, inner), rules)
    except WireError as error:
        raise WireError(f"{kind}: {error}") from None


def _map(kind: str, data: bytes) -> dict[str, Any]:
    return kinds.opened(kind, data, maximum_bytes=MAXIMUM_BYTES, maximum_items=50, maximum_depth=2)


def _id(value: Any) -> bytes:
    if not isinstance(value, bytes) or len(value) != ID_BYTES:
        raise WireError(f"must be {ID_BYTES} bytes (got {brief(value)})")
    return value


_utc_s = kinds.number(0, 1e11)
_REQUEST: dict[str, Rule] = {
    "id": _id,
    "vehicle": kinds.text(32, VEHICLE_NAME),
    "verb": kinds.one_of((*VERBS, STATUS)),
    "issued_utc_s": _utc_s,
    "valid_s": kinds.number(1, LONGEST_VALID_S),
}
_REPLY: dict[str, Rule] = {
    "id": _id,
    "verb": kinds.one_of((*VERBS, STATUS)),
    "outcome": kinds.one_of([outcome.value for outcome in Outcome]),
    "text": kinds.text(MAXIMUM_REASON),
    "state": kinds.text(40),
    "reason": kinds.text(MAXIMUM_REASON),
    "mode": kinds.text(40),
    "armed": kinds.flag,
    "utc_s": _utc_s,
    "recorded": kinds.flag,
}
