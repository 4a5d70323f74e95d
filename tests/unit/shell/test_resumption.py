"""Going on from what an earlier run left: checkpoints of two generations, the journal's tail, crashes."""

import errno
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import shapely

from autonomy.config import CheckpointSection, Configuration, JournalSection
from autonomy.core import Core
from autonomy.effects import Effect
from autonomy.events import DeadlineReached, Event, LinkDown, LinkUp
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from autonomy.replay import CoreRaisedError, replay
from autonomy.shell import checkpoint_store as files
from autonomy.shell.awakening import CRASHES_PER_CHECKPOINT, FAILURES_PER_CHECKPOINT
from autonomy.shell.checkpoint import Checkpoint, CheckpointError, decode, encode, fits
from autonomy.shell.checkpoint_store import Store
from autonomy.shell.journal import Journal, make_header
from autonomy.shell.journal_alone import Beginning, beginning
from autonomy.shell.journal_files import Position
from autonomy.shell.moment import Moment
from autonomy.shell.resumption import Continuity
from autonomy.shell.trials import PROVED_BY, Trials

SETTINGS: dict[str, Any] = {
    "survey": {"area": [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]}
}
CONFIGURATION = Configuration.model_validate(SETTINGS)
SURVEY = SurveyArea.from_geometry(LocalFrame(33.5, -118.5), shapely.box(0, 0, 3000, 2000), passage_cells=20)
WANTED = fits(CONFIGURATION, SURVEY)


BREAKS_OVER: list[str] = []
ENDS_OVER: list[str] = []
ROTTEN: list[str] = []
"""What a core must not know: then it breaks over whatever it is told."""

ENDS_WITH: list[str] = []
"""What a core must not remember: then the process ends when it is restored."""


class EndError(BaseException):
    """The process is gone, without a chance to say a word."""


STOPPED_WITH: list[str] = []
"""The same of what somebody stops the service in the midst of."""


@pytest.fixture(autouse=True)
def breakable(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Cores that remember why links were lost, among what they have explained, and break over some reasons."""
    sound, sound_restore = Core.handle, Core.restore

    def restore(core: Core, memory: Any) -> None:
        sound_restore(core, memory)
        if not core._explained.isdisjoint(ENDS_WITH):
            raise EndError
        if not core._explained.isdisjoint(STOPPED_WITH):
            raise KeyboardInterrupt

    def handle(core: Core, now: float, event: Event) -> list[Effect]:
        if not core._explained.isdisjoint(ROTTEN):
            raise ZeroDivisionError("a bug")
        if isinstance(event, LinkDown):
            core._explained.add(event.reason)
            if event.reason in BREAKS_OVER:
                raise ZeroDivisionError("a bug")
            if event.reason in ENDS_OVER:
                raise EndError
        return sound(core, now, event)

    monkeypatch.setattr(Core, "handle", handle)
    monkeypatch.setattr(Core, "restore", restore)
    yield
    for each in (BREAKS_OVER, ENDS_OVER, ROTTEN, ENDS_WITH, STOPPED_WITH):
        each.clear()


def new() -> Core:
    return Core(CONFIGURATION, SURVEY)


class Run:
    """One run of the service over what the last one left."""

    def __init__(self, folder: Path, *, recorded: bool = True) -> None:
        self.store = Store(folder / "kept")
        journals = folder / "journal" if recorded else None
        try:
            self.continuity = Continuity(new, CheckpointSection(), self.store, WANTED, journals)
        except (EndError, KeyboardInterrupt):
            self.store.close()  # as the kernel does for a process that is gone
            raise
        self.core: Any = self.continuity.core
        past = {"resumed": self.continuity.resumed, "left_out": self.continuity.left_out}
        header = make_header(CONFIGURATION, SURVEY, now=0.0, utc_s=0.0, **past)
        self.journal = Journal.open(folder / "journal", JournalSection(), header) if recorded else None
        self.continuity.begin(self.journal)

    @property
    def lost(self) -> set[str]:
        return set(self.core._explained)

    def hears(self, event: Event, now: float | None = None) -> None:
        now = Moment.present().now if now is None else now
        if self.journal is not None:
            self.journal.event(now, event)
            self.continuity.handling(self.journal.position)
        try:
            effects = self.core.handle(now, event)
            self.continuity.handling(None)
            if self.journal is not None:
                self.journal.effects(effects)
        except ZeroDivisionError:
            self.continuity.crashed(self.journal)
            raise

    def keeps_two(self) -> None:
        """Have that of the beginning written, and another: one that still waits gives way to the next."""
        for _ in range(2):
            self.continuity.close(in_order=False)
            self.continuity.begin(self.journal)

    def ends(self, *, in_order: bool = False, keep: bool = False) -> None:
        if keep:
            self.continuity.keep(self.journal)
        self.continuity.close(in_order=in_order)
        if self.journal is not None:
            self.journal.close()
        self.store.close()


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Callable[..., Run]]:
    runs: list[Run] = []

    def begin(**options: Any) -> Run:
        runs.append(Run(tmp_path, **options))
        return runs[-1]

    yield begin
    for each in runs:
        each.ends()


def test_what_was_kept_and_what_came_after_are_known_again(run: Callable[..., Run]) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.continuity.keep(first.journal)
    first.hears(LinkDown("two"))
    first.ends()
    second = run()
    assert second.lost == {"one", "two"}
    second.hears(LinkDown("three"))
    second.ends()
    assert run().lost == {"one", "two", "three"}


def test_without_a_journal_the_checkpoint_alone_does(run: Callable[..., Run]) -> None:
    first = run(recorded=False)
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    second = run(recorded=False)
    second.hears(LinkDown("two"))
    second.ends()
    assert run(recorded=False).lost == {"one"}


def test_of_a_damaged_checkpoint_the_older_one_is_taken(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.keeps_two()
    first.hears(LinkDown("two"))
    first.ends(keep=True)
    newest = max((tmp_path / "kept").glob("*.checkpoint"), key=lambda path: decode(path.read_bytes()).number)
    newest.write_bytes(newest.read_bytes()[:-1])
    second = run()
    assert second.lost == {"one", "two"}
    assert "it is damaged or not whole" in caplog.text
    assert list((tmp_path / "kept").glob("*.damaged-1.aside"))


def test_when_both_checkpoints_are_damaged_the_journal_teaches_it(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    kept = list((tmp_path / "kept").glob("*.checkpoint"))
    for path in kept:
        path.write_bytes(path.read_bytes()[:-1])
    assert run().lost == {"one"}
    assert "went on from the journal alone" in caplog.text
    assert len(list((tmp_path / "kept").glob("*.damaged-1.aside"))) == len(kept)


def test_what_is_on_a_disk_that_has_become_read_only_is_gone_on_from(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    first = run(recorded=False)
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    sound = Path.open

    def refuse(path: Path, mode: str = "r", *rest: Any, **named: Any) -> Any:
        if "w" in mode or "a" in mode:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return sound(path, mode, *rest, **named)

    sound_open = os.open

    def refuse_too(path: Path, flags: int, *rest: Any, **named: Any) -> int:
        if flags & os.O_RDWR:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        return sound_open(path, flags, *rest, **named)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", refuse)
        patch.setattr(os, "open", refuse_too)
        second = run(recorded=False)
        assert second.lost == {"one"}
        second.hears(LinkDown("two"))
        with pytest.raises(BlockingIOError):
            Store(second.store.folder)
        second.ends(keep=True)
    assert "is read-only: what is learnt from now on will not outlive this run" in caplog.text
    assert "Read-only file system" in second.continuity.trouble


def test_a_record_that_crashed_the_core_is_not_tried_again(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    BREAKS_OVER.append("two")
    with pytest.raises(ZeroDivisionError):
        first.hears(LinkDown("two"))
    first.ends()
    second = run()
    assert second.lost == {"one"}
    assert "is quarantined" in caplog.text
    second.hears(LinkDown("three"))
    second.ends()
    assert run().lost == {"one", "three"}


def test_a_record_that_crashes_the_replay_is_tried_once(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture
) -> None:
    """The process was killed before it could say so, or the software is another one."""
    first = run()
    for reason in ("one", "two", "three"):
        first.hears(LinkDown(reason))
    first.ends()
    BREAKS_OVER.append("two")
    second = run()
    assert second.lost == {"one", "three"}
    assert "crashes the core and is left out from now on: ZeroDivisionError: a bug" in caplog.text
    second.ends()
    caplog.clear()
    assert run().lost == {"one", "three"}
    assert "is quarantined" in caplog.text
    assert "crashes the core" not in caplog.text


def test_a_record_that_ends_the_process_without_a_word_is_tried_once_more(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture
) -> None:
    """It hangs until the watchdog strikes, or breaks the interpreter: nobody can catch and tell that."""
    first = run()
    first.hears(LinkDown("one"))
    ENDS_OVER.append("two")
    with pytest.raises(EndError):
        first.hears(LinkDown("two"))
    first.ends()
    with pytest.raises(EndError):
        run()
    assert "quarantine" not in caplog.text
    third = run()
    assert third.lost == {"one"}
    assert "ended twice in the midst of record 3 of run 1" in caplog.text
    third.hears(LinkDown("three"))
    third.ends()
    assert run().lost == {"one", "three"}


def test_a_service_killed_at_work_and_then_at_its_start_has_quarantined_nothing(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The second time the record was not under way: the replay had not come to it."""
    first = run()
    first.hears(LinkDown("one"))
    ENDS_OVER.append("two")
    with pytest.raises(EndError):
        first.hears(LinkDown("two"))
    first.ends()
    ENDS_OVER.clear()
    killed = Store(tmp_path / "kept")
    Trials(killed.folder, killed.write)
    killed.close()
    assert run().lost == {"one", "two"}
    assert "quarantine" not in caplog.text


def test_a_service_killed_at_work_twice_has_quarantined_nothing(run: Callable[..., Run]) -> None:
    """Whatever it was at: the next time it was at something else."""
    for reason in ("one", "two", "three"):
        again = run()
        again.hears(LinkDown("sound"))
        ENDS_OVER.append(reason)
        with pytest.raises(EndError):
            again.hears(LinkDown(reason))
        again.ends()
        ENDS_OVER.clear()
    assert run().lost == {"sound", "one", "two", "three"}


def test_a_quarantined_record_is_left_out_of_the_replay_too(run: Callable[..., Run], tmp_path: Path) -> None:
    first = run()
    first.hears(LinkDown("one"))
    BREAKS_OVER.append("two")
    with pytest.raises(ZeroDivisionError):
        first.hears(LinkDown("two"))
    first.ends()
    second = run()
    second.hears(LinkDown("three"))
    second.ends(keep=True)
    third = run()
    third.hears(LinkDown("four"))
    third.ends()
    for number, known in ((2, {"one", "three"}), (3, {"one", "three", "four"})):
        outcome = replay(tmp_path / "journal", number)
        assert outcome.differences == []
        assert not outcome.lost
        assert outcome.troubles == ["record 3 of run 1 is quarantined: left out, as it was then"]
        assert outcome.core._explained == known
    # Of the run itself, which it ended, it is the point.
    with pytest.raises(CoreRaisedError, match="record 3 of run 1"):
        replay(tmp_path / "journal", 1)


def test_what_crashes_again_and_again_is_given_up(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    """Newest checkpoint, older checkpoint, the journal alone, nothing: each has its trials."""
    first = run()
    first.hears(LinkDown("one"))
    first.keeps_two()
    first.ends(keep=True)
    BREAKS_OVER.append("poison")
    known, aside = [], []
    for _ in range(3 * CRASHES_PER_CHECKPOINT + 1):
        again = run()
        known.append(again.lost == {"one"})
        aside.append(len(list((tmp_path / "kept").glob("*.aside"))))
        with pytest.raises(ZeroDivisionError):
            again.hears(LinkDown("poison"))
        again.ends()
    assert known == [True] * 3 * CRASHES_PER_CHECKPOINT + [False]
    assert aside == [0, 0, 0, 1, 1, 1, 2, 2, 2, 2]
    assert caplog.text.count("is not used: the service has crashed 3 times in a row") == 2
    assert "went on from the journal alone" in caplog.text
    assert "the journal alone is not gone on from; it is kept: the service has crashed 3 times" in caplog.text
    assert len(list((tmp_path / "journal").glob("*.journal"))) == 11


def test_a_memory_that_survives_no_record_is_to_blame_not_the_records(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.core._explained.add("rotten")
    first.continuity.keep(first.journal)
    for reason in ("two", "three", "four", "five"):
        first.hears(LinkDown(reason))
    first.ends()
    ROTTEN.append("rotten")
    again = run()
    assert again.lost == {"one", "two", "three", "four", "five"}, "of the older checkpoint and the journal"
    assert "odd.checkpoint" in caplog.text or "even.checkpoint" in caplog.text
    assert "is not used: the next 3 records crash the core each, and are not to blame" in caplog.text
    assert again.continuity.left_out == ()
    assert len(list((tmp_path / "kept").glob("*.aside"))) == 1
    again.hears(LinkDown("six"))
    again.ends()


def test_a_memory_that_ends_the_process_is_given_up_after_three_runs(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture, tmp_path: Path
) -> None:
    """Hung until it is killed, or killed for want of memory: nobody is left to say so, but the mark."""
    first = run()
    first.core._explained.add("rotten")
    first.continuity.keep(first.journal)
    first.hears(LinkDown("one"))
    first.ends()
    ENDS_WITH.append("rotten")
    for _ in range(FAILURES_PER_CHECKPOINT):
        with pytest.raises(EndError):
            run()
    again = run()
    assert again.lost == {"one"}
    assert "going on from it has come to nothing 3 times in a row" in caplog.text
    again.ends()


def test_who_stops_a_service_again_and_again_while_it_starts_has_lost_nothing(
    run: Callable[..., Run], caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    STOPPED_WITH.append("one")
    for _ in range(2 * FAILURES_PER_CHECKPOINT):
        with pytest.raises(KeyboardInterrupt):
            run()
    STOPPED_WITH.clear()
    for _ in range(2 * FAILURES_PER_CHECKPOINT):
        early = run()
        early.continuity.stopped_early()
        early.ends()
    assert run().lost == {"one"}
    assert "is not used" not in caplog.text
    assert "ended before it had handled" not in caplog.text


def test_a_run_that_handles_records_has_come_to_something(run: Callable[..., Run]) -> None:
    """However often it is killed thereafter: what it has gone on from is not to blame."""
    first = run()
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    for _ in range(2 * FAILURES_PER_CHECKPOINT):
        again = run()
        assert again.lost == {"one"}
        for _ in range(PROVED_BY):
            again.hears(DeadlineReached())
        again.ends()
    assert again.continuity._trials.failures == 0


def test_without_a_journal_beginning_is_enough(run: Callable[..., Run]) -> None:
    first = run(recorded=False)
    first.core._explained.add("one")
    first.ends(keep=True)
    for _ in range(2 * FAILURES_PER_CHECKPOINT):
        again = run(recorded=False)
        assert again.lost == {"one"}
        again.ends()


def test_the_journal_alone_is_gone_on_from_again_until_there_is_a_checkpoint(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.core._explained.add("rotten")
    first.ends(keep=True)
    written = sorted(
        (tmp_path / "kept").glob("*.checkpoint"), key=lambda path: decode(path.read_bytes()).number
    )
    for older in written[:-1]:  # if it did not give way to the second
        older.unlink()
    ENDS_WITH.append("rotten")
    for _ in range(FAILURES_PER_CHECKPOINT):
        with pytest.raises(EndError):
            run()
    for _ in range(2):
        again = run()
        assert again.lost == {"one"}
        for _ in range(PROVED_BY):
            again.hears(DeadlineReached())
        again.ends()
    assert caplog.text.count("went on from the journal alone") == 2
    again = run()
    again.ends(keep=True)
    caplog.clear()
    again = run()
    assert again.lost == {"one"}
    assert "journal alone" not in caplog.text
    again.ends()


def make_foreign(folder: Path) -> None:
    """The checkpoints there become such as software with another attribute in the core would have written."""
    for path in folder.glob("*.checkpoint"):
        checkpoint = decode(path.read_bytes())
        for name, attributes in checkpoint.memory["classes"]:
            if name == "autonomy.core.Core":
                attributes[0] = "_gone"
        path.write_bytes(encode(checkpoint))


def test_after_an_update_that_reads_no_checkpoint_the_journal_teaches_it(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    make_foreign(tmp_path / "kept")
    again = run()
    assert again.lost == {"one"}
    assert "it does not fit this software: Core has other attributes" in caplog.text
    assert "went on from the journal alone: what was learnt before it begins is lost" in caplog.text
    assert list((tmp_path / "kept").glob("*.aside"))
    again.hears(LinkDown("two"))
    again.ends(keep=True)
    caplog.clear()
    assert run().lost == {"one", "two"}
    assert "went on from the journal alone" not in caplog.text


def test_after_an_update_that_means_something_else_by_checkpoints_the_journal_teaches_it(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run()
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    for path in (tmp_path / "kept").glob("*.checkpoint"):
        checkpoint = decode(path.read_bytes())
        path.write_bytes(encode(replace(checkpoint, fits={**checkpoint.fits, "software": "schema 0"})))
    assert run().lost == {"one"}
    assert "what it depends on has changed: software" in caplog.text
    assert "went on from the journal alone" in caplog.text


def test_after_such_an_update_without_a_journal_it_begins_anew(
    run: Callable[..., Run], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    first = run(recorded=False)
    first.hears(LinkDown("one"))
    first.ends(keep=True)
    make_foreign(tmp_path / "kept")
    assert run(recorded=False).lost == set()
    assert "there is no journal to go on from either" in caplog.text


def test_a_journal_of_another_survey_is_not_gone_on_from(tmp_path: Path) -> None:
    header = make_header(CONFIGURATION, SURVEY, now=5.0, utc_s=7.0)
    journal = Journal.open(tmp_path, JournalSection(), header)
    journal.event(6.0, LinkUp())
    journal.close()
    assert beginning(tmp_path, WANTED) == Beginning(Position(1, 0), 5.0, 7.0)
    other = Configuration.model_validate(SETTINGS | {"sensor": {"message_name": "TEMP"}})
    assert beginning(tmp_path, fits(other, SURVEY)) is None
    # Of three runs, the last that began with nothing and the one that went on from it.
    for resumed in (None, Position(2, 1)):
        header = make_header(CONFIGURATION, SURVEY, now=8.0, utc_s=9.0, resumed=resumed)
        journal = Journal.open(tmp_path, JournalSection(), header)
        journal.event(9.0, LinkUp())
        journal.close()
    assert beginning(tmp_path, WANTED) == Beginning(Position(2, 0), 8.0, 9.0)
    assert beginning(tmp_path / "none", WANTED) is None


@pytest.mark.parametrize(
    ("section", "name"),
    [({"sensor": {"message_name": "TEMP"}}, "sensor"), ({"model": {"capacity": 60}}, "model")],
)
def test_what_does_not_fit_is_put_aside(
    tmp_path: Path, section: dict[str, Any], name: str, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(tmp_path)
    store.save(Checkpoint(1, WANTED, Core(CONFIGURATION, SURVEY).checkpoint(), 0.0, 0.0, "", None))
    other = Configuration.model_validate({**SETTINGS, **section})
    assert store.load(fits(other, SURVEY)) == []
    assert f"what it depends on has changed: {name}" in caplog.text
    assert [path.name for path in tmp_path.glob("*.aside")] == ["odd.checkpoint.unfit-1.aside"]
    store.close()


def test_other_keys_may_change_meanwhile() -> None:
    section = {"exploration": {"rho0": 0.3}, "shore": {"model_period_s": 9.0}, "quality": {"spike_fail": 3.0}}
    other = Configuration.model_validate({**SETTINGS, **section})
    assert fits(other, SURVEY) == WANTED
    changed = Core(other, SURVEY)
    changed.restore(decode(encode(sample())).memory)
    assert changed._replanning._exploration._section.rho0 == 0.3
    assert changed._reporter._model_schedule.period_s == 9.0


@pytest.mark.parametrize("makes", [os.mkfifo, os.mkdir, lambda path: path.symlink_to(path)])
def test_what_is_no_file_is_not_waited_for(
    tmp_path: Path, makes: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    """In place of a checkpoint and of what is known of crashes; and where it was put aside, often."""
    (tmp_path / "trials.json").unlink(missing_ok=True)
    makes(tmp_path / "trials.json")
    for _ in range(10):
        makes(tmp_path / "odd.checkpoint")
        store = Store(tmp_path)
        store.save(replace(sample(), number=6))
        assert [each.number for each in store.load(WANTED)] == [6]
        assert store.is_spoilt
        assert not (tmp_path / "odd.checkpoint").is_symlink()
        assert not (tmp_path / "odd.checkpoint").exists()
        store.close()
    Trials(tmp_path, lambda path, data: None)
    assert "odd.checkpoint is not used: " in caplog.text
    assert "trials.json can't be read and is begun anew" in caplog.text


def test_two_services_do_not_share_a_folder(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with pytest.raises(BlockingIOError):
        Store(tmp_path)
    store.close()
    Store(tmp_path).close()


def test_a_full_disk_is_told_and_stops_nothing(
    run: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    first = run()

    def full(path: Path, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "write_atomically", full)
    for _ in range(3):
        first.continuity.keep(first.journal)
        first.hears(LinkUp())
    first.continuity.close(in_order=False)
    assert "No space left" in first.continuity.trouble
    assert caplog.text.count("no checkpoint could be written") == 1


def test_the_reserve_makes_room_for_the_next_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Disks that other writers fill; a small one, really full, is filled in tests/process/test_full_disk.py."""
    store, checkpoint = Store(tmp_path), sample()
    store.save(checkpoint)
    reserve = tmp_path / "reserve"
    assert reserve.stat().st_blocks * 512 >= 2**20
    sound = files.write_atomically

    def full(path: Path, data: bytes) -> None:
        if reserve.exists():
            raise OSError(28, "No space left on device")
        sound(path, data)

    monkeypatch.setattr(files, "write_atomically", full)
    store.save(replace(checkpoint, number=8))
    assert [each.number for each in store.load(WANTED)] == [8, 7]
    assert reserve.exists()
    store.close()


def test_the_time_away_is_known_across_boots() -> None:
    before = Moment(500.0, 1000.0, "a")
    assert Moment(503.0, 9999.0, "a").since(before) == 3.0
    assert Moment(10.0, 1060.0, "b").since(before) == 60.0
    assert Moment(10.0, 900.0, "b").since(before) == 0.0  # the wall clock was set back
    assert Moment(10.0, 1e12, "b").since(before) == 30 * 86400.0


def test_the_boot_is_asked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """It does not change; and where no more files can be opened, plans are still verified and said to be."""
    before = Moment.present()

    def exhausted(*_: object) -> str:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(Path, "read_text", exhausted)
    assert Moment.present().boot == before.boot


def sample() -> Checkpoint:
    core = Core(CONFIGURATION, SURVEY)
    core.handle(5.0, DeadlineReached())
    return Checkpoint(7, WANTED, core.checkpoint(), 5.0, 1e9, "boot", Position(3, 20))


def test_bytes_and_back() -> None:
    there = sample()
    back = decode(encode(there))
    assert replace(back, memory={}).__dict__ == replace(there, memory={}).__dict__
    twin = Core(CONFIGURATION, SURVEY)
    twin.restore(back.memory)
    assert twin.next_deadline() == 6.0


def test_no_checkpoint_at_all() -> None:
    with pytest.raises(CheckpointError, match="no checkpoint"):
        decode(b"%PDF-1.4")
