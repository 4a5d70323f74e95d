"""Where maps are made: threads beside the event loop, with what they have made kept for the next who asks."""

import asyncio
from collections import OrderedDict
from collections.abc import Callable, Hashable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from autonomy.shore.server.allowance import BusyError

T = TypeVar("T")

_THREADS = 2
_MAXIMUM_WAITING = 32


class Atelier:
    """Makes things in threads, each once for all who ask for it meanwhile or soon after.

    Args:
        maximum_bytes: of what is kept.
    """

    def __init__(self, maximum_bytes: int = 48 * 2**20) -> None:
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="map")
        self._maximum_bytes = maximum_bytes
        self._kept: OrderedDict[Hashable, tuple[Any, int]] = OrderedDict()
        self._bytes = 0
        self._making: dict[Hashable, asyncio.Future[Any]] = {}

    async def make(self, key: Hashable, recipe: Callable[[], T], size: Callable[[T], int]) -> T:
        """The result of `recipe`, by its key made only once; `size` in bytes of what is kept of it.

        Raises:
            BusyError: too many wait already.
        """
        if key in self._kept:
            self._kept.move_to_end(key)
            kept: T = self._kept[key][0]
            return kept
        if key not in self._making:
            if len(self._making) >= _MAXIMUM_WAITING:
                raise BusyError
            future = asyncio.get_running_loop().run_in_executor(self._pool, recipe)
            self._making[key] = future
            future.add_done_callback(lambda done: self._made(key, done, size))
        # Somebody who goes away must not take the map from the others who wait for it.
        made: T = await asyncio.shield(self._making[key])
        return made

    def _made(self, key: Hashable, done: "asyncio.Future[Any]", size: Callable[[Any], int]) -> None:
        del self._making[key]
        if done.cancelled() or done.exception() is not None:
            return
        self._kept[key] = (done.result(), size(done.result()))
        self._bytes += self._kept[key][1]
        while self._bytes > self._maximum_bytes:
            _, (_, freed) = self._kept.popitem(last=False)
            self._bytes -= freed

    def close(self) -> None:
        """Make nothing more."""
        self._pool.shutdown(wait=False, cancel_futures=True)
