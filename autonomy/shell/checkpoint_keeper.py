"""Checkpoints on their way to the disk, which the control loop does not wait for."""

import logging
from collections.abc import Callable

from autonomy.shell.checkpoint import Checkpoint
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.files import cause
from autonomy.shell.journal_files import Position
from autonomy.shell.latest import Latest

log = logging.getLogger(__name__)


class Keeper:
    """Writes checkpoints in a thread of its own; one that is not written yet gives way to a newer one.

    Before one is written, `sync` has the journal put on the disk up to its position: or after a power cut the
    checkpoint would know what the journal does not, and no replay could come to the same.

    To be used from one thread. `trouble` is why the last one could not be written, empty if it was.
    """

    def __init__(self, store: Store, sync: Callable[[Position], object] = lambda position: None) -> None:
        self._store = store
        self._sync = sync
        self.trouble = ""
        self.written = 0
        self._latest = Latest("checkpoint", self._write)

    def keep(self, checkpoint: Checkpoint) -> None:
        """Have it written; returns at once."""
        self._latest.put(checkpoint)

    def close(self) -> None:
        """Write what waits, and end."""
        self._latest.close()

    def _write(self, checkpoint: Checkpoint) -> None:
        if checkpoint.position is not None:
            self._sync(checkpoint.position)
        try:
            size = self._store.save(checkpoint)
        except (OSError, TypeError, ValueError) as error:
            why = cause(error, self._store.folder) if isinstance(error, OSError) else str(error)
            if why != self.trouble:
                log.error("no checkpoint could be written: %s", why)
            self.trouble = why
            return
        self.trouble = ""
        self.written += 1
        log.debug("checkpoint %d: %d bytes", checkpoint.number, size)
