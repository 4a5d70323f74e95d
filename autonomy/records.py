"""What a journal holds, as bytes: what happened to the core and when, and the gist of what the core asked for.

A message is kept as the MAVLink frame that brought it, everything else as `autonomy.structure` writes it.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cbor2

from autonomy import structure
from autonomy.effects import Answer, Effect, Log, Publish, SendMessage, StartJob
from autonomy.events import Event, MessageReceived
from autonomy.mavlink.codec import Codec
from autonomy.structure import Fingerprint, StructureError

_HEADER, _MESSAGE, _EVENT, _EFFECTS, _RESUMED = range(5)
_MAXIMUM_LABEL = 200


class RecordError(ValueError):
    """A record's payload is not one of ours; says why."""


@dataclass(frozen=True)
class Happened:
    """One event of the core at protocol time `now`."""

    now: float
    event: Event


@dataclass(frozen=True)
class Gist:
    """What identifies an effect: its kind and label, for a person, and the fingerprint of all else."""

    kind: str
    label: str
    fingerprint: Fingerprint

    def __str__(self) -> str:
        return f"{self.kind} {self.label}".strip()


@dataclass(frozen=True)
class Asked:
    """What the core asked for when the event recorded before it happened."""

    effects: tuple[Gist, ...]


@dataclass(frozen=True)
class Resumed:
    """The core, known from an earlier run, goes on at protocol time `now` after `away_s` seconds without events."""

    now: float
    away_s: float


@dataclass(frozen=True)
class Header:
    """How a file begins; `content` as in docs/journal.md."""

    content: dict[str, Any]


Record = Happened | Asked | Resumed | Header


def encode_header(content: dict[str, Any]) -> bytes:
    """The record that begins a file."""
    return cbor2.dumps([_HEADER, content])


def encode_event(now: float, event: Event) -> bytes:
    """The record of an event. TypeError for a message that was not received as bytes."""
    if isinstance(event, MessageReceived):
        raw = event.message.get_msgbuf()
        if not raw:
            raise TypeError(f"{event.message.get_type()} came without its bytes")
        return cbor2.dumps([_MESSAGE, float(now), bytes(raw)])
    return cbor2.dumps([_EVENT, float(now), structure.encode(event)])


def encode_effects(effects: Sequence[Effect]) -> bytes:
    """The record of what the core asked for."""
    return cbor2.dumps([_EFFECTS, [_row(gist(effect)) for effect in effects]])


def encode_resumed(now: float, away_s: float) -> bytes:
    """The record of a core that goes on after a restart."""
    return cbor2.dumps([_RESUMED, float(now), float(away_s)])


class RecordDecoder:
    """Payloads to records; it parses messages as the codec does that received them."""

    def __init__(self) -> None:
        self._codec = Codec(1, 1)

    def decode(self, payload: bytes) -> Record:
        """The record in a payload.

        Raises:
            RecordError: it is none of ours.
        """
        try:
            match structure.load_plain(payload):
                case [0, dict() as content]:
                    return Header(content)
                case [1, float() as now, bytes() as frame]:
                    return Happened(now, self._message(frame))
                case [2, float() as now, bytes() as event]:
                    return Happened(now, _event(event))
                case [3, list() as rows]:
                    return Asked(tuple(map(_gist, rows)))
                case [4, float() as now, float() as away_s]:
                    return Resumed(now, away_s)
                case _:
                    raise RecordError("is of no known kind")
        except StructureError as error:
            raise RecordError(str(error)) from None

    def _message(self, frame: bytes) -> MessageReceived:
        messages = self._codec.decode(frame, frame[:1])
        if len(messages) != 1:
            raise RecordError("holds no sound MAVLink message")
        return MessageReceived(messages[0])


def _event(data: bytes) -> Event:
    event = structure.decode(data)
    if not isinstance(event, Event):
        raise RecordError(f"a {type(event).__name__} is no event")
    return event


def gist(effect: Effect) -> Gist:
    """What identifies an effect. TypeError if something in it has no form."""
    match effect:
        case SendMessage(message):
            fields = {name: getattr(message, name) for name in message.get_fieldnames()}
            return _of("send", message.get_type(), fields)
        case StartJob(job_id, name, request, deadline_s):
            return _of("job", f"{job_id} {name}", (request, deadline_s))
        case Publish(topic, payload):
            return _of("publish", topic.value, payload)
        case Log(level, text):
            return _of("log", f"{level.name.lower()} {text}", None)
        case Answer(_, verb, outcome, text):
            return _of("answer", f"{verb} {outcome.value}: {text}", effect)


def _of(kind: str, label: str, value: Any) -> Gist:
    return Gist(kind, label[:_MAXIMUM_LABEL], structure.fingerprint(value))


def _row(each: Gist) -> list[Any]:
    print_ = each.fingerprint
    numbers = struct.pack(f"<{len(print_.numbers)}d", *print_.numbers)
    return [each.kind, each.label, print_.exact, print_.outline, numbers]


def _gist(row: Any) -> Gist:
    match row:
        case [str() as kind, str() as label, bytes() as exact, bytes() as outline, bytes() as numbers]:
            if len(numbers) % 8 == 0:
                unpacked = struct.unpack(f"<{len(numbers) // 8}d", numbers)
                return Gist(kind, label, Fingerprint(exact, outline, unpacked))
    raise RecordError("an effect of no known form")
