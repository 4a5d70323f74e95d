"""The link that an endpoint of the configuration names."""

from autonomy.endpoints import parse_link
from autonomy.shell.transport import Backoff, OnBytes, OnDown, OnUp, Transport
from autonomy.shell.transport_serial import SerialPort
from autonomy.shell.transport_tcp import TcpClient
from autonomy.shell.transport_udp import UdpListener, UdpSpeaker

_KINDS: dict[str, type[Transport]] = {
    "udpin": UdpListener,
    "udpout": UdpSpeaker,
    "tcp": TcpClient,
    "serial": SerialPort,
}


def open_transport(
    endpoint: str, on_bytes: OnBytes, on_up: OnUp, on_down: OnDown, backoff: Backoff | None = None
) -> Transport:
    """Keep the link of `endpoint` open from now on, in the running event loop; returns at once.

    Raises ValueError for an endpoint that can't be understood; an address that can't be had is reported
    to `on_down` and tried again.
    """
    parsed = parse_link(endpoint)
    where = (parsed.host, parsed.number)
    transport = _KINDS[parsed.kind](endpoint, where, on_bytes, on_up, on_down, backoff or Backoff())
    transport.keep_open()
    return transport
