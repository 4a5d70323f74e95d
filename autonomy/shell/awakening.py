"""The core of a run, made from what earlier ones have left: checkpoint, the journal's records since, or nothing.

A record that has crashed the core is tried no second time: it is quarantined, and said to be. If the core crashes
again and again all the same, or does not get as far as to handle a few records, what it knows is to blame: then the
older checkpoint is gone on from, then the journal alone, and in the end nothing. So it is where checkpoints are of
another version of the software: the journal's events outlast it.
"""

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from autonomy.core import Core
from autonomy.memory import UnfitMemoryError
from autonomy.records import Resumed
from autonomy.shell.checkpoint import Checkpoint
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal_alone import Beginning, beginning
from autonomy.shell.journal_files import JournalError, Position, Recorded, read_from
from autonomy.shell.moment import Moment
from autonomy.shell.trials import JOURNAL, Trials

log = logging.getLogger(__name__)

CRASHES_PER_CHECKPOINT = 3
"""So many crashes in a row, none of them after a healthy while, and what was gone on from is given up."""

FAILURES_PER_CHECKPOINT = 3
"""The same of runs that have come to nothing: they ended before they had handled a few records."""

POISONED_RECORDS = 3
"""So many records, none of which the core survives as the first that it is told, and they are not to blame."""

REPLAY_S = 30.0
"""Longest time spent on the journal's records: the service manager waits for the service, the boat for both."""

_QUICK_S = 1.0
_QUARANTINES_PER_START = 20


class _PoisonError(Exception):
    """A record has crashed the core."""

    def __init__(self, at: Position, error: Exception) -> None:
        super().__init__(f"{type(error).__name__}: {error}")
        self.at = at


class _SpoiltError(Exception):
    """What was gone on from is of no use; says why."""


class Awakening:
    """See the module's description.

    Args:
        make_core: a new core, which knows nothing.
        store: the checkpoints.
        wanted: what a checkpoint must fit, see `checkpoint.fits`.
        journal_folder: of earlier runs; None: checkpoints alone must do.
        trials: what went wrong in earlier runs.

    Raises:
        KeyboardInterrupt: somebody wants the service to stop, which is nobody's fault.

    Attributes:
        core: what was made.
        position: the journal's record up to which earlier runs have made the core; None if none have.
        last: when that was; None if none have.
        left_out: just after each record that was left out, since it is quarantined.
        was_slow: whether the replay took so long that the next start should not have to do it again.
    """

    def __init__(
        self,
        make_core: Callable[[], Core],
        store: Store,
        wanted: Mapping[str, str],
        journal_folder: Path | None,
        trials: Trials,
    ) -> None:
        self._make_core = make_core
        self._store = store
        self._wanted = wanted
        self._folder = journal_folder
        self._trials = trials
        self._doubtful: list[Position] = []
        self.position: Position | None = None
        self.last: Moment | None = None
        self.left_out: list[Position] = []
        self.was_slow = False
        try:
            self.core = self._awaken()
        except KeyboardInterrupt:
            trials.stopped_early()
            raise

    def _awaken(self) -> Core:
        checkpoints = self._store.load(self._wanted)
        spoilt = self._trials.source == JOURNAL or self._store.is_spoilt
        for i, checkpoint in enumerate(checkpoints):
            try:
                core = self._gone_on(f"checkpoint {checkpoint.number}", partial(self._restored, checkpoint))
            except UnfitMemoryError as error:
                self._store.reject(checkpoint, f"it does not fit this software: {error}")
                spoilt = True
                continue
            except _SpoiltError as error:
                self._store.reject(checkpoint, str(error))
                self._trials.gave_up()
                spoilt = True
                continue
            if i:
                log.error("went on from the older of two checkpoints")
            return core
        taught = self._from_journal() if spoilt else None
        return self._anew() if taught is None else taught

    def _from_journal(self) -> Core | None:
        """A new core, told what the journal has; None if that is nothing, or has been tried in vain."""
        if self._folder is None or not self._folder.is_dir():
            log.error("there is no journal to go on from either")
            return None
        if self._trials.journal_tried and self._trials.source != JOURNAL:
            log.error("the journal alone is not gone on from again: what it led to was of no use either")
            return None
        start = beginning(self._folder, self._wanted)
        if start is None:
            log.error("the journal has no run that fits: it is not gone on from")
            return None
        try:
            core = self._gone_on(JOURNAL, partial(self._untaught, start))
        except _SpoiltError as error:
            log.error("%s is not gone on from; it is kept: %s", JOURNAL, error)
            return None
        log.error("went on from %s: what was learnt before it begins is lost", JOURNAL)
        return core

    def _anew(self) -> Core:
        self._trials.began_anew()
        self._trials.proved()
        self.position = self.last = None
        self.left_out.clear()
        log.info("no earlier run is gone on from: nothing is known yet")
        return self._make_core()

    def _gone_on(self, source: str, make: Callable[[], Core]) -> Core:
        """The core that `make` makes, after all records since; what crashes it is quarantined on the way.

        Raises:
            _SpoiltError: it is not this or that record which crashes it, now or in the last runs.
            UnfitMemoryError: from `make`.
        """
        trials = self._trials
        if trials.crashes >= CRASHES_PER_CHECKPOINT:
            raise _SpoiltError(f"the service has crashed {trials.crashes} times in a row")
        if trials.source == source and trials.failures >= FAILURES_PER_CHECKPOINT:
            raise _SpoiltError(f"going on from it has come to nothing {trials.failures} times in a row")
        trials.going_on(source)
        for _ in range(_QUARANTINES_PER_START):
            core = self._made(make)
            try:
                self._replay(core)
            except _PoisonError as poison:
                self._doubt(poison)
            else:
                self._quarantine_doubtful()
                return core
        log.error("too many records crash the core: all since the checkpoint are left out")
        return self._made(make)

    def _made(self, make: Callable[[], Core]) -> Core:
        try:
            return make()
        except UnfitMemoryError:
            raise
        except Exception as error:
            raise _SpoiltError(f"it crashes the core: {type(error).__name__}: {error}") from error

    def _doubt(self, poison: _PoisonError) -> None:
        """A record has crashed the core: it is to blame, unless the core survives no record at all."""
        log.error(
            "record %d of run %d crashes the core and is left out from now on: %s", *_place(poison.at), poison
        )
        self._doubtful.append(poison.at)
        if self._trials.handled:
            self._quarantine_doubtful()
        elif len(self._doubtful) >= POISONED_RECORDS:
            count = len(self._doubtful)
            self._doubtful.clear()
            raise _SpoiltError(
                f"the next {count} records crash the core each, and are not to blame: {poison}"
            )

    def _quarantine_doubtful(self) -> None:
        for at in self._doubtful:
            self._trials.quarantine(at)
        self._doubtful.clear()

    def _restored(self, checkpoint: Checkpoint) -> Core:
        core = self._make_core()
        core.restore(checkpoint.memory)
        self._from(checkpoint.position, Moment(checkpoint.now, checkpoint.utc_s, checkpoint.boot))
        return core

    def _untaught(self, start: Beginning) -> Core:
        self._from(start.position, Moment(start.now, start.utc_s, ""))
        return self._make_core()

    def _from(self, position: Position | None, last: Moment) -> None:
        self.position, self.last = position, last
        self.left_out.clear()
        self._trials.handled = 0

    def _replay(self, core: Core) -> None:
        """Tell the core what happened since; what it asks for was done, or is too late."""
        if self._folder is None or self.position is None or not self._folder.is_dir():
            return
        began, count = time.monotonic(), 0
        try:
            for recorded in read_from(self._folder, self.position):
                if time.monotonic() - began > REPLAY_S:
                    log.error("%d records were replayed; the rest would take too long and is left out", count)
                    break
                self.position = recorded.position
                if recorded.position in self._doubtful or recorded.position in self._trials.quarantined:
                    log.error("record %d of run %d is quarantined", *_place(recorded.position))
                    self.left_out.append(recorded.position)
                    continue
                self._tell(core, recorded.position, recorded.now, recorded.event)
                count += 1
                self._trials.handled_one()
                self._follow(recorded)
        except (JournalError, OSError) as error:
            log.error("the journal can't be replayed any further: %s", error)
        self._trials.mark.set(None)
        took_s = time.monotonic() - began
        self.was_slow = took_s > _QUICK_S
        log.info("replayed %d records in %.1f s", count, took_s)

    def _tell(self, core: Core, at: Position, now: float, event: object) -> None:
        self._trials.mark.set(at)
        try:
            if isinstance(event, Resumed):
                core.resume(event.now, event.away_s)
            else:
                core.handle(now, event)  # type: ignore[arg-type]
        except Exception as error:
            raise _PoisonError(at, error) from error

    def _follow(self, recorded: Recorded) -> None:
        """This is the last event that the core has heard of."""
        assert self.last is not None
        event, now = recorded.event, recorded.now
        passed_s = event.away_s if isinstance(event, Resumed) else max(0.0, now - self.last.now)
        self.last = replace(self.last, now=now, utc_s=self.last.utc_s + passed_s)


def _place(position: Position) -> tuple[int, int]:
    return position.sequence, position.run
