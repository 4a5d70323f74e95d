"""Going on where an earlier run ended, and keeping what this one knows for the next."""

import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from autonomy.config import CheckpointSection, Configuration
from autonomy.core import Core
from autonomy.planning.survey import SurveyArea
from autonomy.shell.awakening import Awakening
from autonomy.shell.checkpoint import Checkpoint, fits
from autonomy.shell.checkpoint_keeper import Keeper
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.files import cause
from autonomy.shell.journal import Journal
from autonomy.shell.journal_files import Position
from autonomy.shell.moment import Moment
from autonomy.shell.state_directory import state_directory
from autonomy.shell.trials import Trials

log = logging.getLogger(__name__)

HEALTHY_S = 60.0
"""A run that has lasted so long has gone well."""

SYNC_S = 5.0
"""Longest wait for the journal before a checkpoint: if its disk refuses, the checkpoint is made all the same."""


class AlreadyRunningError(Exception):
    """Another service has the state that this one would go on from; says so, and where."""


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
        self._section = section
        self._store = store
        self._wanted = wanted
        self._trials = Trials(store.folder, store.write)
        self._past = Awakening(make_core, store, wanted, journal_folder, self._trials)
        self._keeper: Keeper | None = None
        self._unmade = ""
        self._began = time.monotonic()
        self.core = self._past.core

    @property
    def resumed(self) -> Position | None:
        """The journal's record up to which earlier runs have made the core; None if none have."""
        return self._past.position

    @property
    def left_out(self) -> Sequence[Position]:
        """Just after each record that was left out when the core was made, since it is quarantined."""
        return tuple(self._past.left_out)

    @property
    def period_s(self) -> float:
        """How often `keep` is to be called."""
        return self._section.period_s

    @property
    def trouble(self) -> str:
        """Why the last checkpoint is not on the disk; empty if it is."""
        return self._unmade or ("" if self._keeper is None else self._keeper.trouble)

    def stopped_early(self) -> None:
        """Somebody has stopped the service before it began."""
        self._trials.stopped_early()
        self._trials.mark.close()

    def begin(self, journal: Journal | None) -> None:
        """The run begins now: from here on the core hears of what happens."""
        self._keeper = (
            Keeper(self._store)
            if journal is None
            else Keeper(self._store, lambda position: journal.sync(position, SYNC_S))
        )
        present = Moment.present()
        self._began = present.now
        if self._past.last is not None:
            away_s = present.since(self._past.last)
            if journal is not None:
                journal.resumed(present.now, away_s)
            self.core.resume(present.now, away_s)
            log.info("resumed after %.1f s", away_s)
        if journal is None:
            # Then nobody tells which records are handled.
            self._trials.proved()
        # While the core keeps crashing the checkpoints from before it did are not replaced.
        if self._past.last is None or (self._past.was_slow and not self._trials.crashes):
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
        self._keeper.keep(
            Checkpoint(
                number=0,  # it gets one when it is written
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

    @property
    def is_settled(self) -> bool:
        """Whether what `keep` has had written is on the disk, or was refused."""
        return self._keeper is None or self._keeper.is_settled

    def handling(self, at: Position | None) -> None:
        """The core is about to be told the record just before `at`; None: it has been."""
        self._trials.mark.set(at)
        if at is None:
            self._trials.handled_one()

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

    Raises:
        AlreadyRunningError: another process has it.
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
        raise AlreadyRunningError(
            f"another service runs, and keeps its checkpoints in {folder}: two would fight over the boat. Stop that "
            "one first; or, if it is another boat's, give each a checkpoint.directory of its own"
        ) from None
    except OSError as error:
        problem = cause(error, folder)
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
