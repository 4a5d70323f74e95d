"""One link to the vehicle that is opened again for ever, of whatever kind it is."""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable
from dataclasses import dataclass

Address = tuple[str, int]
OnBytes = Callable[[bytes, Hashable], None]
OnUp = Callable[[], None]
OnDown = Callable[[str], None]

WRITE_LIMIT_BYTES = 65_536
"""What may wait for a peer or a port that takes nothing."""


@dataclass(frozen=True)
class Backoff:
    """Pauses between attempts to open the link, in seconds: from `first_s`, doubling, to `longest_s`."""

    first_s: float = 0.5
    longest_s: float = 10.0

    def pause(self, failures: int) -> float:
        """The pause after so many failures in a row (1, 2, …)."""
        return float(min(self.longest_s, self.first_s * 2.0 ** min(failures - 1, 30)))


class Transport(ABC):
    """One link. Subclasses say how to open it once; this class keeps it open.

    `on_bytes(data, peer)` gets what arrives; `peer` is new for every connection, so that a parser can start
    afresh. `on_up()` and `on_down(reason)` alternate; a link that can't be opened at all reports `on_down`
    once, and again when the reason changes. `send` never waits: what can't be sent is dropped and counted.
    """

    is_stream = True
    """Whether what arrives is cut anywhere; else it is datagrams, which anybody may send."""

    def __init__(
        self,
        endpoint: str,
        address: Address,
        on_bytes: OnBytes,
        on_up: OnUp,
        on_down: OnDown,
        backoff: Backoff,
    ) -> None:
        self.endpoint = endpoint
        self._address = address
        self.dropped_bytes = 0
        self._on_bytes = on_bytes
        self._on_up = on_up
        self._on_down = on_down
        self._backoff = backoff
        self._down: asyncio.Future[str] | None = None
        self._connections = 0
        self._keeper: asyncio.Task[None] | None = None

    def keep_open(self) -> None:
        """Keep the link open from now on, in the running event loop; returns at once."""
        self._keeper = asyncio.get_running_loop().create_task(self._keep_open())

    @property
    def keeper(self) -> "asyncio.Task[None]":
        """The task that keeps the link open; it ends only by `close`, or by a bug."""
        assert self._keeper is not None
        return self._keeper

    @property
    def is_up(self) -> bool:
        """Whether the link is open now."""
        return self._down is not None and not self._down.done()

    def send(self, data: bytes) -> None:
        """Send `data` if the link is open and takes it without waiting; drop it otherwise."""
        if not self.is_up or not self._write(data):
            self.dropped_bytes += len(data)

    def vouch(self, peer: Hashable) -> None:  # noqa: B027 -- only where anybody may speak are places few
        """This peer is known to be one of ours: strangers do not take its place where places are few."""

    async def close(self) -> None:
        """Close the link for good; no callback comes afterwards."""
        if self._keeper is not None:
            self._keeper.cancel()
            await asyncio.gather(self._keeper, return_exceptions=True)

    async def _keep_open(self) -> None:
        failures = 0
        told = ""
        while True:
            opened, reason = await self._one_connection()
            failures = 1 if opened else failures + 1
            if opened or reason != told:
                self._on_down(reason)
            told = reason
            await asyncio.sleep(self._backoff.pause(failures))

    async def _one_connection(self) -> tuple[bool, str]:
        """Open the link and wait until it fails: whether it was open, and why it isn't any more."""
        self._connections += 1
        self._down = None
        down = asyncio.get_running_loop().create_future()
        try:
            await self._connect(down)
            self._down = down
            if not down.done():
                self._on_up()
                return True, await down
            return False, down.result()
        except (OSError, TimeoutError, UnicodeError) as error:
            return False, f"{self.endpoint}: {describe(error)}"
        finally:
            self._down = None
            if not down.done():
                down.cancel()
            await self._disconnect()

    def _fail(self, down: "asyncio.Future[str]", reason: str) -> None:
        if not down.done():
            down.set_result(f"{self.endpoint}: {reason}")

    @abstractmethod
    async def _connect(self, down: "asyncio.Future[str]") -> None:
        """Open the link once; complete `down` with the reason when it fails later. Raises OSError."""

    @abstractmethod
    async def _disconnect(self) -> None:
        """Release whatever `_connect` took, as far as it came."""

    @abstractmethod
    def _write(self, data: bytes) -> bool:
        """Hand `data` to the system; False if it has to be dropped."""


def describe(error: BaseException) -> str:
    """What went wrong, for a person."""
    if isinstance(error, TimeoutError) and not error.args:
        return "timed out"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__
