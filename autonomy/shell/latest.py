"""Work that the control loop does not wait for, and of which only the newest piece matters."""

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Gives `work` each value in a thread of its own; one that is not taken yet gives way to a newer one.

    To be used from one thread. `work` must not raise.
    """

    def __init__(self, name: str, work: Callable[[T], object]) -> None:
        self._do = work
        self._waiting: T | None = None
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def put(self, value: T) -> None:
        """Have it worked on; returns at once."""
        with self._changed:
            self._waiting = value
            self._changed.notify_all()

    def close(self) -> None:
        """Work on what waits, and end."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._closing)
                value, self._waiting = self._waiting, None
            if value is None:
                return
            self._do(value)
