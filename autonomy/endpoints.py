"""Addresses as people write them, of MAVLink links and zenoh sessions, and the settings made of them. Pure."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

_ENDPOINT = re.compile(
    r"(?P<protocol>tcp|udp|tls|quic|ws)/(?P<host>\[[0-9A-Fa-f:.]+(%\w+)?\]|[^\s/:\[\]?#]+):(?P<port>\d{1,5})(?P<rest>[?#]\S*)?"
)


_LINK = re.compile(
    r"(?P<kind>udpin|udpout|tcp):(?:\[(?P<ip6>[0-9A-Fa-f:.]+(?:%\w+)?)\]|(?P<host>[^\s:/.]+(?:\.[^\s:/.]+)*)):(?P<port>\d{1,5})"
    r"|serial:(?P<device>[^\s:]+):(?P<baud>[1-9]\d{0,7})"
)


@dataclass(frozen=True)
class LinkEndpoint:
    """A MAVLink link: `kind` is udpin, udpout, tcp or serial; `host` may be a device, `number` a baud rate."""

    kind: str
    host: str
    number: int


def parse_link(text: str) -> LinkEndpoint:
    """Read `udpin:HOST:PORT`, `udpout:HOST:PORT`, `tcp:HOST:PORT` or `serial:DEVICE:BAUD`; IPv6 hosts in brackets.

    Raises:
        ValueError: it is none of these; shows how one is written.
    """
    match = _LINK.fullmatch(text)
    if match is None:
        wanted = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE:BAUD"
        raise ValueError(f"endpoint {text!r}: must be {wanted}")
    if match["device"] is not None:
        return LinkEndpoint("serial", match["device"], int(match["baud"]))
    if not 1 <= int(match["port"]) <= 65535:
        raise ValueError(f"endpoint {text!r}: the port must be from 1 to 65535")
    return LinkEndpoint(match["kind"], match["ip6"] or match["host"], int(match["port"]))


def check_endpoint(text: str) -> str:
    """The same address if it is one; raises ValueError that shows how one is written."""
    match = _ENDPOINT.fullmatch(text)
    if match is None or int(match["port"]) > 65535:
        raise ValueError(
            f"not an address: {text!r}: must be protocol/host:port with protocol tcp, udp, tls, quic or ws "
            "and a port up to 65535, such as tcp/192.168.1.10:7447"
        )
    return text


def is_encrypted(text: str) -> bool:
    """Whether this is the address of a way that uses certificates: tls/… or quic/…."""
    return text.startswith(("tls/", "quic/"))


@dataclass(frozen=True)
class Certificates:
    """Names of files in PEM form for ways that are encrypted; None where there is none.

    Attributes:
        root_ca: of the authority that the other side's certificates come from; None: those that browsers trust.
        certificate: what we show of ourselves.
        private_key: of that certificate.
        verify_name: whether the certificate of whom we dial must be for the host that we dial.
    """

    root_ca: Path | None = None
    certificate: Path | None = None
    private_key: Path | None = None
    verify_name: bool = True

    def settings(self, *, listens: bool) -> dict[str, Any]:
        """Settings of a zenoh session that dials, and that listens: then it lets in nobody without a certificate."""
        way = "transport/link/tls"
        files = {
            "root_ca_certificate": self.root_ca,
            "connect_certificate": self.certificate,
            "connect_private_key": self.private_key,
        }
        if listens:
            files |= {"listen_certificate": self.certificate, "listen_private_key": self.private_key}
        settings: dict[str, Any] = {
            f"{way}/{name}": str(file) for name, file in files.items() if file is not None
        }
        mutual = listens or self.certificate is not None
        return {
            **settings,
            f"{way}/enable_mtls": mutual,
            f"{way}/verify_name_on_connect": self.verify_name,
            f"{way}/close_link_on_expiration": True,
        }


THIN_LINK_SETTINGS: dict[str, Any] = {
    "transport/link/tx/batch_size": 1024,
    "transport/link/tx/queue/size/data_low": 16,
    "transport/link/tx/lease": 60_000,
    "transport/link/tx/keep_alive": 4,
    "transport/unicast/open_timeout": 60_000,
}
"""For a session whose link takes hundreds of bytes per second: what is urgent gets between the pieces of what is large,
the other side waits a minute to hear anything, and a handshake with certificates may take as long."""


def session_settings(
    mode: Literal["peer", "client", "router"],
    connect: Sequence[str] = (),
    listen: Sequence[str] = (),
    certificates: Certificates | None = None,
) -> dict[str, Any]:
    """Settings of a zenoh session: path in zenoh's configuration to value.

    A session finds only whom it is told of (no scouting), dials for ever, and is back within a second or two
    after its router is. Opening a client's fails after a few seconds without a router (waiting for one could
    not be interrupted); once open it dials for ever too. Shared memory stays off: it leaves files behind when
    a process is killed. Not being able to listen is an error at once.

    Raises:
        ValueError: an address isn't one.
    """
    return {
        "mode": mode,
        "connect/endpoints": [check_endpoint(text) for text in connect],
        "connect/timeout_ms": 4000 if mode == "client" else -1,
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 250, "period_max_ms": 500, "period_increase_factor": 2},
        "listen/endpoints": [check_endpoint(text) for text in listen],
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        **({} if certificates is None else certificates.settings(listens=bool(listen))),
    }
