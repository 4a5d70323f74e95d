"""A conversation with a vehicle over a real link, for a while."""

import asyncio
import os
import time
from collections.abc import Callable, Hashable
from dataclasses import dataclass

from autonomy.config import MavlinkSection
from autonomy.mavlink.codec import Codec, DecodingCounters
from autonomy.mavlink.signing import Signing, read_key, told
from autonomy.preflight.conversation import Conversation
from autonomy.shell.transports import open_transport

_STEP_S = 0.05
_PROVISIONAL_SYSTEM_ID = 1


@dataclass(frozen=True)
class Heard:
    """How the link was.

    Attributes:
        trouble: why it could not be opened, or was lost; empty if it was open to the end.
        bytes_in: that arrived.
        counters: of what was decoded.
        refused: what signing refused, in words; empty if nothing.
        began_s, ended_s: protocol time.
        utc_s: the computer's clock at `ended_s`.
    """

    trouble: str
    bytes_in: int
    counters: DecodingCounters
    refused: str
    began_s: float
    ended_s: float
    utc_s: float


async def listen(
    section: MavlinkSection,
    conversation: Conversation,
    seconds: float,
    until: Callable[[], bool] = lambda: False,
) -> Heard:
    """Hold a conversation for so many seconds, or until `until()`.

    Raises:
        KeyFileError: the section names a signing key that can't be used.
    """
    key = read_key(section.signing, os.environ)
    signing = None if key is None else Signing(key, time.time, section.signing.link_id)
    codec = Codec(_PROVISIONAL_SYSTEM_ID, section.component_id, signing)
    loop = asyncio.get_running_loop()
    trouble, bytes_in = ["not open yet"], [0]

    def received(data: bytes, peer: Hashable) -> None:
        bytes_in[0] += len(data)
        for message in codec.decode(data, peer, stream=transport.is_stream):
            send(conversation.handle(loop.time(), message))

    def send(messages: list[object]) -> None:
        if conversation.state is not None:
            codec.system_id = conversation.state.system_id
        for message in messages:
            transport.send(codec.encode(message))

    def became(text: str) -> None:
        trouble[0] = text

    began_s = loop.time()
    transport = open_transport(section.endpoint, received, on_up=lambda: became(""), on_down=became)
    try:
        while loop.time() < began_s + seconds and not until():
            await asyncio.sleep(_STEP_S)
            if transport.is_up:
                send(conversation.step(loop.time()))
    finally:
        await transport.close()
    refused = "" if signing is None else told(signing.refused)
    return Heard(trouble[0], bytes_in[0], codec.counters, refused, began_s, loop.time(), time.time())
