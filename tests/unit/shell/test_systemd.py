"""sd_notify against a real datagram socket."""

import logging
import socket

import pytest

from autonomy.shell.systemd import Notifier


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    listener.settimeout(5.0)
    name = str(tmp_path / "notify")
    listener.bind(name if request.param == "path" else "\0" + name)
    yield listener, name if request.param == "path" else "@" + name
    listener.close()


def test_tells_the_manager(manager):
    listener, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address})
    assert all([notifier.ready(), notifier.watchdog(), notifier.status("two\nlines"), notifier.stopping()])
    received = [listener.recv(200) for _ in range(4)]
    assert received == [b"READY=1", b"WATCHDOG=1", b"STATUS=two lines", b"STOPPING=1"]
    assert notifier.send("READY=1", "STATUS=up")
    assert listener.recv(200) == b"READY=1\nSTATUS=up"
    notifier.close()


def test_nothing_is_sent_without_a_manager():
    notifier = Notifier({})
    assert not notifier.ready()
    assert notifier.watchdog_period_s is None


def test_a_full_or_absent_socket_is_no_reason_to_stop(manager, tmp_path, caplog):
    _, address = manager
    notifier = Notifier({"NOTIFY_SOCKET": address})
    with caplog.at_level(logging.WARNING):
        sent = [notifier.watchdog() for _ in range(3000)]
    assert sent[0]
    assert not sent[-1]
    assert len(caplog.records) == 1
    notifier.close()
    lost = Notifier({"NOTIFY_SOCKET": str(tmp_path / "nobody")})
    assert not lost.ready()
    lost.close()


def test_watchdog_period_is_half_of_what_systemd_waits():
    assert Notifier({"WATCHDOG_USEC": "3000000"}).watchdog_period_s == 1.5
    assert Notifier({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "7"}, pid=7).watchdog_period_s == 1.5
    assert Notifier({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "8"}, pid=7).watchdog_period_s is None


@pytest.mark.parametrize(
    "environ", [{"WATCHDOG_USEC": "soon"}, {"WATCHDOG_USEC": "0"}, {"NOTIFY_SOCKET": "relative"}]
)
def test_a_broken_environment_is_named(environ):
    with pytest.raises(ValueError, match=next(iter(environ))):
        Notifier(environ)
