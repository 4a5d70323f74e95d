"""Checkpoints on their way to the disk, which the control loop does not wait for."""

import logging
from collections.abc import Callable
from dataclasses import replace

from autonomy.shell.checkpoint import Checkpoint
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal_files import Position
from autonomy.shell.latest import Latest

log = logging.getLogger(__name__)


class Keeper:
    """Writes checkpoints in a thread of its own; one that is not written yet gives way to a newer one.

    They are numbered as they are written: one that gave way, or that the disk refused, has no number. Else the next
    would have replaced the newest of the two generations, not the older.

    Before one is written, `sync` has the journal put on the disk up to its position: or after a power cut the
    checkpoint would know what the journal does not, and no replay could come to the same.

    To be used from one thread.

    Args:
        store: where to.
        sync: see above.
    """

    def __init__(self, store: Store, sync: Callable[[Position], object] = lambda position: None) -> None:
        self._store = store
        self._sync = sync
        self._latest = Latest("checkpoint", self._write, store.folder, "no checkpoint could be written")

    @property
    def trouble(self) -> str:
        """Why the last one could not be written, empty if it was."""
        return self._latest.trouble

    def keep(self, checkpoint: Checkpoint) -> None:
        """Have it written, with a number; returns at once."""
        self._latest.put(checkpoint)

    @property
    def is_settled(self) -> bool:
        """Whether all are written, have given way or were refused."""
        return self._latest.is_settled

    def close(self) -> None:
        """Write what waits, and end."""
        self._latest.close()

    def _write(self, checkpoint: Checkpoint) -> None:
        if checkpoint.position is not None:
            self._sync(checkpoint.position)
        numbered = replace(checkpoint, number=self._store.newest + 1)
        size = self._store.save(numbered)
        log.debug("checkpoint %d: %d bytes", numbered.number, size)
