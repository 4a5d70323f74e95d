"""Work that the control loop does not wait for, and of which only the newest piece matters."""

import logging
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from autonomy.shell.files import cause

log = logging.getLogger(__name__)

T = TypeVar("T")


class Latest(Generic[T]):
    """Gives `work` each value in a thread of its own; one that is not taken yet gives way to a newer one.

    To be used from one thread. `trouble` is why the last piece of work failed, empty if it did not; whatever it
    raised, the next is tried.

    Args:
        name: of the thread.
        work: what is done with a value; it may wait for the disk.
        place: where it writes; named in errors of the system that name no file themselves.
        complaint: what the log says before the reason when the work begins to fail.
    """

    def __init__(self, name: str, work: Callable[[T], object], place: Path, complaint: str) -> None:
        self._do = work
        self._place = place
        self._complaint = complaint
        self._waiting: T | None = None
        self._closing = self._busy = False
        self._changed = threading.Condition()
        self.trouble = ""
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self._thread.start()

    def put(self, value: T) -> None:
        """Have it worked on; returns at once."""
        with self._changed:
            self._waiting = value
            self._changed.notify_all()

    @property
    def is_settled(self) -> bool:
        """Whether nothing waits or is being worked on."""
        with self._changed:
            return self._waiting is None and not self._busy

    def close(self) -> None:
        """Work on what waits, and end."""
        with self._changed:
            self._closing = True
            self._changed.notify_all()
        self._thread.join()

    def at_once(self, value: T) -> None:
        """Work on it here and now, before anything was put."""
        try:
            self._do(value)
        except OSError as error:
            self._complain(cause(error, self._place))
        except Exception as error:  # noqa: BLE001 -- nobody else would notice that the thread has ended
            # A bug, or no memory left: the next may go better.
            self._complain(f"{type(error).__name__}: {error}", error)
        else:
            self.trouble = ""

    def _complain(self, why: str, error: Exception | None = None) -> None:
        if why != self.trouble:
            log.error("%s: %s", self._complaint, why, exc_info=error)
        self.trouble = why

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._closing)
                value, self._waiting = self._waiting, None
                self._busy = value is not None
            if value is None:
                return
            self.at_once(value)
            with self._changed:
                self._busy = False
