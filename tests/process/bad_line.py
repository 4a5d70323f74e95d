"""A TCP line that can be cut, silenced and made thin: between a zenoh session and its router."""

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable

_PIECE = 256


class BadLine:
    """Listens at `endpoint` and passes everything on to `target`; use it as a context manager.

    Args:
        target: zenoh's address of the router.
        bytes_per_s: in each direction, at most; None: as fast as it goes.
        delay_s: in each direction.
        buffer_bytes: of the line, beside what the kernels at both ends hold.
    """

    def __init__(
        self,
        target: str,
        bytes_per_s: float | None = None,
        delay_s: float = 0.0,
        buffer_bytes: int = 4096,
    ) -> None:
        host, _, port = target.removeprefix("tcp/").rpartition(":")
        self._target = (host, int(port))
        self._bytes_per_s = bytes_per_s
        self._delay_s = delay_s
        self._buffer_bytes = buffer_bytes
        self._loop = asyncio.new_event_loop()
        self._open = asyncio.Event()
        self._refused = False
        self._ends: set[asyncio.StreamWriter] = set()
        self._socket = socket.socket()
        self._socket.bind(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._socket.getsockname()[1]}"
        self.passed = [0, 0]
        """Bytes that went towards the target, and back."""
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "BadLine":
        self._open.set()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    def cut(self) -> None:
        """Connections end, and new ones end at once."""
        self._do(self._cut)

    def silence(self) -> None:
        """Nothing passes any more, and nobody is told."""
        self._do(self._open.clear)

    def mend(self) -> None:
        """As it was before."""
        self._do(self._mend)

    def _do(self, what: Callable[[], None]) -> None:
        done = threading.Event()
        self._loop.call_soon_threadsafe(lambda: (what(), done.set()))
        done.wait(10.0)

    def _cut(self) -> None:
        self._refused = True
        for end in self._ends:
            end.transport.abort()

    def _mend(self) -> None:
        self._refused = False
        self._open.set()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        server = self._loop.run_until_complete(
            asyncio.start_server(self._accepted, sock=self._socket, limit=self._buffer_bytes)
        )
        self._loop.run_forever()
        server.close()
        self._cut()
        tasks = asyncio.all_tasks(self._loop)
        for task in tasks:
            task.cancel()
        self._loop.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self._loop.close()

    async def _accepted(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._refused:
            writer.transport.abort()
            return
        try:
            onward, back = await asyncio.open_connection(*self._target, limit=self._buffer_bytes)
        except OSError:
            writer.transport.abort()
            return
        self._ends |= {writer, back}
        with contextlib.suppress(OSError):
            await asyncio.gather(self._pass(reader, back, 0), self._pass(onward, writer, 1))
        for end in (writer, back):
            end.transport.abort()
        self._ends -= {writer, back}

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, way: int) -> None:
        """Pieces of what comes, each as long after the one before as it takes, all `delay_s` later."""
        due = self._loop.time()
        on_its_way: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(64)
        arriving = self._loop.create_task(self._arrive(on_its_way, writer, way))
        try:
            while data := await reader.read(_PIECE):
                await self._open.wait()
                if self._bytes_per_s is not None:
                    due = max(due, self._loop.time()) + len(data) / self._bytes_per_s
                    await asyncio.sleep(due - self._loop.time())
                await on_its_way.put((self._loop.time() + self._delay_s, data))
        finally:
            arriving.cancel()
            writer.transport.abort()

    async def _arrive(
        self, on_its_way: "asyncio.Queue[tuple[float, bytes]]", writer: asyncio.StreamWriter, way: int
    ) -> None:
        while True:
            when, data = await on_its_way.get()
            await asyncio.sleep(max(0.0, when - self._loop.time()))
            await self._open.wait()
            writer.write(data)
            await writer.drain()
            self.passed[way] += len(data)
