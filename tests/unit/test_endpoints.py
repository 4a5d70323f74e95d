"""Addresses as people write them."""

import pytest

from autonomy.endpoints import LinkEndpoint, parse_link


@pytest.mark.parametrize(
    ("text", "kind", "host", "number"),
    [
        ("udpin:0.0.0.0:14551", "udpin", "0.0.0.0", 14551),
        ("udpout:boat.local:14550", "udpout", "boat.local", 14550),
        ("tcp:localhost:5760", "tcp", "localhost", 5760),
        ("tcp:[::1]:5760", "tcp", "::1", 5760),
        ("udpin:[fe80::1%eth0]:1", "udpin", "fe80::1%eth0", 1),
        ("serial:/dev/ttyAMA0:921600", "serial", "/dev/ttyAMA0", 921600),
    ],
)
def test_links_are_read(text, kind, host, number):
    assert parse_link(text) == LinkEndpoint(kind, host, number)


@pytest.mark.parametrize(
    "text",
    [
        *("", "udp", "tcp:a..b:5760", "tcp:.a:1", "tcp:::1:5760", "tcp:[::1:5760", "tcp:host", "tcp:host:"),
        *("tcp:ho st:1", "udpin:host:0", "udpin:host:65536", "serial:/dev/x:0", "serial::9600"),
        *("tcp/host:5760", "http:host:80"),
    ],
)
def test_what_is_no_link_is_refused_with_the_forms_that_are(text):
    with pytest.raises(ValueError, match="must be"):
        parse_link(text)
