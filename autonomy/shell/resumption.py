"""Going on where an earlier run ended: newest sound checkpoint, the journal's records since, and whatever went wrong.

A record that has crashed the core is tried no second time: it is quarantined, and said to be. If the core crashes
again and again all the same, or does not get as far as to handle a few records, what it knows is to blame: then the
older checkpoint is gone on from, then the journal alone, and in the end nothing. So it is where checkpoints are of
another version of the software: the journal's events outlast it.
"""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from autonomy.config import CheckpointSection, Configuration
from autonomy.core import Core
from autonomy.memory import UnfitMemoryError
from autonomy.planning.survey import SurveyArea
from autonomy.records import Resumed
from autonomy.shell.checkpoint import Checkpoint, fits
from autonomy.shell.checkpoint_keeper import Keeper
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal import Journal
from autonomy.shell.journal_alone import Beginning, beginning
from autonomy.shell.journal_files import JournalError, Position, Recorded, read_from
from autonomy.shell.state_directory import state_directory
from autonomy.shell.trials import JOURNAL, PROVED_BY, Trials

log = logging.getLogger(__name__)

CRASHES_PER_CHECKPOINT = 3
"""So many crashes in a row, none of them after `HEALTHY_S`, and what was gone on from is given up."""

FAILURES_PER_CHECKPOINT = 3
"""The same of runs that have come to nothing: they ended before they had handled a few records."""

POISONED_RECORDS = 3
"""So many records, none of which the core survives as the first that it is told, and they are not to blame."""

HEALTHY_S = 60.0
REPLAY_S = 30.0
"""Longest time spent on the journal's records: the service manager waits for the service, the boat for both."""

SYNC_S = 5.0
"""Longest wait for the journal before a checkpoint: if its disk refuses, the checkpoint is made all the same."""

_QUICK_S = 1.0
_QUARANTINES_PER_START = 20
_LONGEST_AWAY_S = 30 * 86400.0


@dataclass(frozen=True)
class Moment:
    """A time by protocol clock and wall clock, and the boot of the machine in which the former was."""

    now: float
    utc_s: float
    boot: str

    @staticmethod
    def present() -> "Moment":
        """This moment."""
        boot = Path("/proc/sys/kernel/random/boot_id")
        return Moment(time.monotonic(), time.time(), boot.read_text().strip() if boot.exists() else "")

    def since(self, earlier: "Moment") -> float:
        """Seconds since an earlier moment: by the protocol clock if it ran on, else by the wall clock, at least 0."""
        same = self.boot == earlier.boot and self.boot != "" and self.now >= earlier.now
        passed_s = self.now - earlier.now if same else self.utc_s - earlier.utc_s
        return min(max(0.0, passed_s), _LONGEST_AWAY_S)


class _PoisonError(Exception):
    """A record has crashed the core."""

    def __init__(self, at: Position, error: Exception) -> None:
        super().__init__(f"{type(error).__name__}: {error}")
        self.at = at


class _SpoiltError(Exception):
    """What was gone on from is of no use; says why."""


class Continuity:
    """Makes the core of a run, and keeps what it knows for the next one.

    Args:
        make_core: a new core, which knows nothing.
        section: where checkpoints are, and how often they are made.
        store: the checkpoints.
        wanted: what a checkpoint must fit, see `checkpoint.fits`.
        journal_folder: of earlier runs; None: checkpoints alone must do.
    """

    def __init__(
        self,
        make_core: Callable[[], Core],
        section: CheckpointSection,
        store: Store,
        wanted: Mapping[str, str],
        journal_folder: Path | None = None,
    ) -> None:
        self._make_core = make_core
        self._section = section
        self._store = store
        self._wanted = wanted
        self._folder = journal_folder
        self._trials = Trials(store.folder, store.write)
        self._left_out: list[Position] = []
        self._doubtful: list[Position] = []
        self._handled = 0
        self._keeper: Keeper | None = None
        self._number = 0
        self._unmade = ""
        self._began = time.monotonic()
        self._position: Position | None = None
        self._last: Moment | None = None
        self._slow = False
        self.core = self._awaken()

    @property
    def resumed(self) -> Position | None:
        """The journal's record up to which earlier runs have made the core; None if none have."""
        return self._position

    @property
    def left_out(self) -> Sequence[Position]:
        """Just after each record that was left out when the core was made, since it is quarantined."""
        return tuple(self._left_out)

    @property
    def period_s(self) -> float:
        """How often `keep` is to be called."""
        return self._section.period_s

    @property
    def trouble(self) -> str:
        """Why the last checkpoint is not on the disk; empty if it is."""
        return self._unmade or ("" if self._keeper is None else self._keeper.trouble)

    def begin(self, journal: Journal | None) -> None:
        """The run begins now: from here on the core hears of what happens."""
        self._keeper = (
            Keeper(self._store)
            if journal is None
            else Keeper(self._store, lambda position: journal.sync(position, SYNC_S))
        )
        present = Moment.present()
        self._began = present.now
        if self._last is not None:
            away_s = present.since(self._last)
            if journal is not None:
                journal.resumed(present.now, away_s)
            self.core.resume(present.now, away_s)
            log.info("resumed after %.1f s", away_s)
        if journal is None:
            # Then nobody tells which records are handled.
            self._trials.proved()
        # While the core keeps crashing the checkpoints from before it did are not replaced.
        if self._last is None or (self._slow and not self._trials.crashes):
            self.keep(journal)

    def keep(self, journal: Journal | None) -> None:
        """Have written what the core knows, to be called between two events; returns at once."""
        if self._keeper is None:
            return
        present = Moment.present()
        try:
            memory = self.core.checkpoint()
        except Exception:
            # A bug, but none that the survey should end for; the last checkpoint and the journal still hold.
            log.exception("no checkpoint can be made")
            self._unmade = "none can be made, see the log"
            return
        self._unmade = ""
        self._number += 1
        self._keeper.keep(
            Checkpoint(
                number=self._number,
                fits=self._wanted,
                memory=memory,
                now=present.now,
                utc_s=present.utc_s,
                boot=present.boot,
                position=None if journal is None else journal.position,
            )
        )
        if present.now - self._began >= HEALTHY_S:
            self._trials.went_well()

    def handling(self, at: Position | None) -> None:
        """The core is about to be told the record just before `at`; None: it has been."""
        self._trials.mark.set(at)
        if at is None:
            self._count_handled()

    def crashed(self, journal: Journal | None) -> None:
        """The core has raised on the record just written: it is not tried again."""
        self._trials.crashed(None if journal is None else journal.position)

    def close(self, *, in_order: bool) -> None:
        """The run is over; what waits is written."""
        if in_order:
            self._trials.went_well()
        self._trials.mark.close()
        if self._keeper is not None:
            self._keeper.close()

    def _awaken(self) -> Core:
        checkpoints = self._store.load(self._wanted)
        self._number = max((each.number for each in checkpoints), default=0)
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
        self._position = self._last = None
        self._left_out.clear()
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
        if self._handled:
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
        self._position, self._last = position, last
        self._left_out.clear()
        self._handled = 0

    def _count_handled(self) -> None:
        self._handled += 1
        if self._handled == PROVED_BY:
            self._trials.proved()

    def _replay(self, core: Core) -> None:
        """Tell the core what happened since; what it asks for was done, or is too late."""
        if self._folder is None or self._position is None or not self._folder.is_dir():
            return
        began, count = time.monotonic(), 0
        try:
            for recorded in read_from(self._folder, self._position):
                if time.monotonic() - began > REPLAY_S:
                    log.error("%d records were replayed; the rest would take too long and is left out", count)
                    break
                self._position = recorded.position
                if recorded.position in self._doubtful or recorded.position in self._trials.quarantined:
                    log.error("record %d of run %d is quarantined", *_place(recorded.position))
                    self._left_out.append(recorded.position)
                    continue
                self._tell(core, recorded.position, recorded.now, recorded.event)
                count += 1
                self._count_handled()
                self._follow(recorded)
        except (JournalError, OSError) as error:
            log.error("the journal can't be replayed any further: %s", error)
        self._trials.mark.set(None)
        took_s = time.monotonic() - began
        self._slow = took_s > _QUICK_S
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
        assert self._last is not None
        event, now = recorded.event, recorded.now
        passed_s = event.away_s if isinstance(event, Resumed) else max(0.0, now - self._last.now)
        self._last = replace(self._last, now=now, utc_s=self._last.utc_s + passed_s)


def open_continuity(
    configuration: Configuration, survey: SurveyArea, environment: Mapping[str, str], *, afresh: bool = False
) -> tuple[Continuity | None, str]:
    """What an earlier run has left, and room for what this one will leave, where configuration or environment say.

    Args:
        configuration: all of it.
        survey: what its files of polygons said.
        environment: of the process.
        afresh: put what was left aside, and begin anew.

    Returns:
        The continuity, and why there is none although the configuration wants it: better a survey that will not
        outlive its process than none.
    """
    section, journal = configuration.checkpoint, configuration.journal
    if not section.enabled:
        log.warning("checkpoint.enabled is false: after a restart nothing will be known")
        return None, ""
    try:
        state = None
        if section.directory is None or (journal.enabled and journal.directory is None):
            state = state_directory(configuration.vehicle.name, environment)
        folder = section.directory or _within(state, "checkpoint")
        records = (journal.directory or _within(state, "journal")) if journal.enabled else None
        store = Store(folder)
        if afresh:
            store.begin_anew()
    except BlockingIOError:
        problem = f"another service keeps its checkpoints in {folder}"
    except OSError as error:
        problem = f"{error.filename}: {error.strerror}"
    except ValueError as error:
        problem = str(error)
    else:
        wanted = fits(configuration, survey)
        return Continuity(lambda: Core(configuration, survey), section, store, wanted, records), ""
    log.error("checkpoint: %s: after a restart nothing will be known", problem)
    return None, f"{problem}: no checkpoints"


def _within(state: Path | None, name: str) -> Path:
    assert state is not None
    return state / name


def _place(position: Position) -> tuple[int, int]:
    return position.sequence, position.run
