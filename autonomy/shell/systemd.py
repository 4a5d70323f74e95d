"""Talking to systemd: sd_notify(3) in a few lines. Without NOTIFY_SOCKET nothing is sent."""

import logging
import os
import socket
from collections.abc import Mapping

log = logging.getLogger(__name__)


class Notifier:
    """Tells the service manager how we are; see sd_notify(3) and sd_watchdog_enabled(3).

    Args:
        environ: the process's environment (NOTIFY_SOCKET, WATCHDOG_USEC, WATCHDOG_PID).
        pid: this process, to which WATCHDOG_PID must belong.

    Raises:
        ValueError: WATCHDOG_USEC isn't a positive whole number, or NOTIFY_SOCKET neither a path nor abstract.
    """

    def __init__(self, environ: Mapping[str, str], pid: int | None = None) -> None:
        self._address = _address(environ.get("NOTIFY_SOCKET", ""))
        self._watchdog_s = _watchdog_s(environ, os.getpid() if pid is None else pid)
        self._socket: socket.socket | None = None
        self._complained = False

    @property
    def watchdog_period_s(self) -> float | None:
        """How often to call `watchdog`: half of the time systemd waits; None if it doesn't watch us."""
        return None if self._watchdog_s is None else self._watchdog_s / 2.0

    def ready(self) -> bool:
        """Start-up is over."""
        return self.send("READY=1")

    def watchdog(self) -> bool:
        """The control loop is alive: to be called by the loop, nowhere else."""
        return self.send("WATCHDOG=1")

    def stopping(self) -> bool:
        """The clean stop has begun."""
        return self.send("STOPPING=1")

    def status(self, text: str) -> bool:
        """One line for `systemctl status`."""
        return self.send("STATUS=" + " ".join(text.split()))

    def send(self, *assignments: str) -> bool:
        """Send assignments as one datagram without waiting; False, with a warning once, if that failed."""
        if self._address is None:
            return False
        try:
            if self._socket is None:
                self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
                self._socket.setblocking(False)
            self._socket.sendto("\n".join(assignments).encode(), self._address)
        except OSError as error:
            if not self._complained:
                log.warning("systemd doesn't hear us: %s", error)
            self._complained = True
            return False
        self._complained = False
        return True

    def close(self) -> None:
        """Close the socket; a later `send` opens it again."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _address(text: str) -> str | None:
    if not text:
        return None
    if text[0] == "@":
        return "\0" + text[1:]
    if text[0] != "/":
        raise ValueError(f"NOTIFY_SOCKET: must be an absolute path or start with @ (got {text!r})")
    return text


def _watchdog_s(environ: Mapping[str, str], pid: int) -> float | None:
    text = environ.get("WATCHDOG_USEC", "")
    if not text or environ.get("WATCHDOG_PID", str(pid)) != str(pid):
        return None
    if not text.isdecimal() or int(text) == 0:
        raise ValueError(f"WATCHDOG_USEC: must be a positive whole number of microseconds (got {text!r})")
    return int(text) / 1e6
