"""A serial port: `serial:/dev/…:BAUD`."""

import asyncio
import os
import termios
from collections.abc import Hashable
from typing import Any

import serial

from autonomy.shell.transport import WRITE_LIMIT_BYTES, Transport, describe

_READ_BYTES = 65_536


class SerialPort(Transport):
    """`serial`: a port that doesn't take more bytes loses whole messages, never parts of one."""

    _port: serial.Serial | None = None
    _current: "asyncio.Future[str] | None" = None

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._waiting = bytearray()

    async def _connect(self, down: "asyncio.Future[str]") -> None:
        device, baud = self._address
        try:
            self._port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        except (serial.SerialException, termios.error, ValueError) as error:
            raise OSError(str(error)) from error
        self._current = down
        peer = (self.endpoint, self._connections)
        asyncio.get_running_loop().add_reader(self._port.fd, self._readable, down, peer)

    async def _disconnect(self) -> None:
        port = self._port
        if port is None:
            return
        loop = asyncio.get_running_loop()
        loop.remove_reader(port.fd)
        loop.remove_writer(port.fd)
        try:
            termios.tcflush(port.fd, termios.TCIOFLUSH)  # closing would wait for unsent bytes
        except termios.error as error:
            self._fail_if_open(f"flushing failed: {error}")  # an unplugged port has nothing to flush
        port.close()
        self._port = self._current = None
        self._waiting.clear()

    def _fail_if_open(self, reason: str) -> None:
        if self._current is not None:
            self._fail(self._current, reason)

    def _readable(self, down: "asyncio.Future[str]", peer: Hashable) -> None:
        assert self._port is not None
        try:
            data = os.read(self._port.fd, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            data = b""
            self._fail(down, describe(error))
        if data:
            self._on_bytes(data, peer)
            return
        self._fail(down, "the port was hung up")
        asyncio.get_running_loop().remove_reader(self._port.fd)

    def _write(self, data: bytes) -> bool:
        if self._port is None or len(self._waiting) + len(data) > WRITE_LIMIT_BYTES:
            return False
        self._waiting += data
        self._writable()
        return True

    def _writable(self) -> None:
        assert self._port is not None
        try:
            written = os.write(self._port.fd, self._waiting)
        except BlockingIOError:
            written = 0
        except OSError as error:
            self._fail_if_open(describe(error))
            self._waiting.clear()
            written = 0
        del self._waiting[:written]
        loop = asyncio.get_running_loop()
        if self._waiting:
            loop.add_writer(self._port.fd, self._writable)
        else:
            loop.remove_writer(self._port.fd)
