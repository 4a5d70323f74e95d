"""How the server itself is."""

import asyncio
import os
import resource
import sys
import threading
import time
from collections import deque
from pathlib import Path

_LOOK_S = 0.5
_MEMORY_S = 60.0


class Lag:
    """The longest of the last minute that news, or the event loop, had to wait."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._seen: deque[tuple[float, float]] = deque()

    def note(self, lag_s: float) -> None:
        """Something has waited so long; from any thread."""
        now_s = time.monotonic()
        with self._lock:
            # Only what is longer than all that came after it can be the longest some day.
            while self._seen and self._seen[-1][1] <= lag_s:
                self._seen.pop()
            self._seen.append((now_s, lag_s))
            self._forget(now_s)

    @property
    def longest_s(self) -> float:
        """In seconds."""
        with self._lock:
            self._forget(time.monotonic())
            return self._seen[0][1] if self._seen else 0.0

    def _forget(self, now_s: float) -> None:
        while self._seen and self._seen[0][0] < now_s - _MEMORY_S:
            self._seen.popleft()

    async def watch(self) -> None:
        """For ever: note how late the event loop is."""
        loop = asyncio.get_running_loop()
        while True:
            due_s = loop.time() + _LOOK_S
            await asyncio.sleep(_LOOK_S)
            self.note(max(0.0, loop.time() - due_s))


def memory_mb() -> float:
    """What this process has in memory; where the system doesn't say, the most that it ever had."""
    statm = Path("/proc/self/statm")
    if statm.exists():
        return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6
