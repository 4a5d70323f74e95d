"""Runs of a service that crash, are killed and lose checkpoints: the next one knows all that these were told, once.

The model is what each run was told, and which records have crashed the core. Runs are short, so that each has records
of the same numbers. HALOCLINE_EXAMPLES: how many sequences; without it 12.
"""

import os
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import shapely
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from autonomy.config import CheckpointSection, Configuration, JournalSection
from autonomy.core import Core
from autonomy.effects import Effect
from autonomy.events import Event, LinkDown
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from autonomy.shell.awakening import CRASHES_PER_CHECKPOINT, FAILURES_PER_CHECKPOINT
from autonomy.shell.checkpoint import decode, fits
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal import Journal, make_header
from autonomy.shell.journal_files import Position
from autonomy.shell.moment import Moment
from autonomy.shell.resumption import Continuity

CONFIGURATION = Configuration.model_validate(
    {"survey": {"area": [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]}}
)
SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0, 0, 3000, 2000), passage_cells=20)
WANTED = fits(CONFIGURATION, SURVEY)
FEW = min(CRASHES_PER_CHECKPOINT, FAILURES_PER_CHECKPOINT) - 1
"""Bad ends in a row, of runs that have hardly begun, after which nothing is given up yet."""
_CRASHES = "crashes"


def new() -> Core:
    return Core(CONFIGURATION, SURVEY)


def breaking(
    sound: Callable[[Core, float, Event], list[Effect]], tried: Counter[str]
) -> Callable[..., list[Effect]]:
    """A core that remembers why links were lost, and what it was told twice, and does not survive some reasons."""

    def handle(core: Core, now: float, event: Event) -> list[Effect]:
        if isinstance(event, LinkDown):
            if event.reason.startswith(_CRASHES):
                tried[event.reason] += 1
                raise ZeroDivisionError("a bug")
            again = event.reason in core._explained
            core._explained.add(f"{event.reason} again" if again else event.reason)
        return sound(core, now, event)

    return handle


class Services(RuleBasedStateMachine):
    """One folder, and the runs of a service over what the last one has left there."""

    @initialize()
    def begin(self) -> None:
        self.tried: Counter[str] = Counter()
        self.patch = pytest.MonkeyPatch()
        self.patch.setattr(Core, "handle", breaking(Core.handle, self.tried))
        self.folder = Path(tempfile.mkdtemp(prefix="runs-"))
        self.told: set[str] = set()
        self.crashed: set[Position] = set()
        self.bad_ends = self.unsaid = 0
        self.awake = False
        self.start()

    def teardown(self) -> None:
        if self.awake:
            self.leave(in_order=False)
        self.patch.undo()
        shutil.rmtree(self.folder)

    def start(self) -> None:
        self.store = Store(self.folder / "kept")
        journals = self.folder / "journal"
        self.continuity = Continuity(new, CheckpointSection(), self.store, WANTED, journals)
        self.core: Any = self.continuity.core
        past = {"resumed": self.continuity.resumed, "left_out": self.continuity.left_out}
        header = make_header(CONFIGURATION, SURVEY, now=0.0, utc_s=0.0, **past)
        self.journal = Journal.open(journals, JournalSection(), header)
        self.continuity.begin(self.journal)
        self.awake = True

    def leave(self, *, in_order: bool) -> None:
        self.continuity.close(in_order=in_order)
        self.journal.close()
        self.store.close()
        self.awake = False

    def hear(self, event: Event) -> None:
        now = Moment.present().now
        self.journal.event(now, event)
        self.continuity.handling(self.journal.position)
        self.core.handle(now, event)
        self.continuity.handling(None)

    @rule(count=st.integers(1, 3))
    def hears(self, count: int) -> None:
        for _ in range(count):
            reason = f"record {self.journal.position}"
            self.told.add(reason)
            self.hear(LinkDown(reason))

    @rule()
    def keeps(self) -> None:
        self.continuity.keep(self.journal)

    @precondition(lambda self: self.bad_ends < FEW)
    @rule(says_so=st.booleans())
    def crashes_and_starts(self, says_so: bool) -> None:
        """If it has no time to say so, the next run tries the record once more, and none after that."""
        with pytest.raises(ZeroDivisionError):
            self.hear(LinkDown(f"{_CRASHES} {self.journal.position}"))
        self.crashed.add(self.journal.position)
        self.bad_ends += 1
        if says_so:
            self.continuity.crashed(self.journal)
        else:
            self.unsaid += 1
        self.leave(in_order=False)
        self.starts_again()

    @rule(keeps=st.booleans())
    def is_stopped_and_starts(self, keeps: bool) -> None:
        if keeps:
            self.keeps()
        self.leave(in_order=True)
        self.bad_ends = 0
        self.starts_again()

    @precondition(lambda self: self.bad_ends < FEW)
    @rule(loses_newest=st.booleans())
    def is_killed_and_starts(self, loses_newest: bool) -> None:
        self.bad_ends += 1
        self.leave(in_order=False)
        kept = list(self.store.folder.glob("*.checkpoint"))
        if loses_newest and kept:
            max(kept, key=lambda path: decode(path.read_bytes()).number).write_bytes(b"damaged")
        self.starts_again()

    def starts_again(self) -> None:
        self.start()
        assert self.core._explained == self.told
        assert set(self.continuity.left_out) <= self.crashed
        assert self.tried.total() <= len(self.crashed) + self.unsaid


TestServices = Services.TestCase
TestServices.settings = settings(
    max_examples=int(os.environ.get("HALOCLINE_EXAMPLES", "12")),
    stateful_step_count=12,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
