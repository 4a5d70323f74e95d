"""Bytes from and to several MAVLink clients of one autopilot, without sockets.

Like ArduPilot, the vessel is also a router: it learns behind which client each component lives, forwards
what is addressed to a component elsewhere, and passes broadcasts on to every client that has spoken.
"""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from autonomy.mavlink.signing import Signing
from sim.autopilot import ALL, COMPONENT_ID, HEARD, Autopilot, Outgoing

Packets = list[tuple[Any, bytes]]  # (client, one packed message)


def _parser() -> Any:
    parser = mav.MAVLink(None)
    parser.robust_parsing = True
    return parser


@dataclass
class _Port:
    parser: Any = field(default_factory=_parser)
    sequence: int = 0
    components: set[tuple[int, int]] = field(default_factory=set)


class Router:
    """The autopilot and its clients; everything it returns is (client, one packed message).

    With `signing` it hears only what is signed with its key, and signs what it says. What it passes on keeps the
    signature of whoever sent it. Like ArduPilot's its words go to whoever speaks, understood or not.
    """

    def __init__(self, autopilot: Autopilot, signing: Signing | None = None) -> None:
        self.autopilot = autopilot
        self._signing = signing
        self._packer = mav.MAVLink(None, autopilot.system_id, COMPONENT_ID)
        probe = autopilot.options.probe_component
        self._probe = None if probe is None else mav.MAVLink(None, autopilot.system_id, probe)
        self._ports: dict[Hashable, _Port] = {}

    def join(self, now: float, client: Hashable) -> None:
        """Start serving a client; joining twice changes nothing."""
        if client not in self._ports:
            self._ports[client] = _Port()
            self.autopilot.join(now, client)

    def leave(self, client: Hashable) -> None:
        """Forget a client that is gone."""
        self._ports.pop(client, None)
        self.autopilot.leave(client)

    def receive(self, now: float, client: Hashable, data: bytes) -> Packets:
        """Take bytes from a client; what cannot be parsed is skipped."""
        self.join(now, client)
        packets: Packets = []
        for message in self._ports[client].parser.parse_buffer(data) or ():
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN"):
                continue
            source = (message.get_srcSystem(), message.get_srcComponent())
            if source == (self.autopilot.system_id, COMPONENT_ID):
                continue  # somebody calls himself by our name
            raw = bytes(message.get_msgbuf())
            if self._signing is not None and self._signing.check(raw, *source, message.get_msgId()):
                continue
            self._ports[client].components.add(source)
            packets += [(other, raw) for other in self._others_for(message, client)]
            packets += self._packed(self.autopilot.handle(now, message, client))
        return packets

    def advance(self, now: float, dt_sim_s: float) -> Packets:
        """Let simulated time pass; see `Autopilot.advance`."""
        return self._packed(self.autopilot.advance(now, dt_sim_s))

    def _others_for(self, message: Any, sender: Hashable) -> Iterator[Hashable]:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        for client, port in self._ports.items():
            if client != sender and any(
                system in (0, known[0]) and (system == 0 or component in (0, known[1]))
                for known in port.components
            ):
                yield client

    def _packed(self, outgoing: list[Outgoing]) -> Packets:
        packets: Packets = []
        packed: dict[int, bytes] = {}
        for target, message in outgoing:
            packet = packed.get(id(message))
            if packet is None:
                packer = self._probe if target is HEARD and self._probe is not None else self._packer
                packet = packed[id(message)] = bytes(message.pack(packer))
            for client in self._receivers(target):
                port = self._ports.get(client)
                if port is not None:
                    numbered = _numbered(packet, port.sequence, message.crc_extra)
                    if self._signing is not None:
                        numbered = self._signing.sign(numbered, message.crc_extra)
                    packets.append((client, numbered))
                    port.sequence = (port.sequence + 1) & 0xFF
        return packets

    def _receivers(self, target: Any) -> list[Hashable]:
        if target is HEARD:
            return [client for client, port in self._ports.items() if port.components]
        return list(self._ports) if target is ALL else [target]


def _numbered(packet: bytes, sequence: int, crc_extra: int) -> bytes:
    """A MAVLink 2 packet with another sequence number.

    Each client must see gapless numbers, or its statistics tell of losses that never were; renumbering is
    several times cheaper than packing a message once per client.
    """
    body = packet[1:4] + bytes((sequence,)) + packet[5:-2]
    crc = mav.x25crc(body)
    crc.accumulate(bytes((crc_extra,)))
    return packet[:1] + body + int(crc.crc).to_bytes(2, "little")
