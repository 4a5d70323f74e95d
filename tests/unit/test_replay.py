"""A recorded run again: the same effects, or the difference is told."""

import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "replays"))
import golden

from autonomy import cli
from autonomy.core import Core
from autonomy.effects import SendMessage
from autonomy.events import Event, StopRequested
from autonomy.frames import Frame, pack, scan
from autonomy.records import Asked, Happened, encode_effects
from autonomy.replay import CoreRaisedError, read_configuration, replay, run_header
from autonomy.shell.journal import Journal, make_header
from autonomy.shell.journal_files import Entry, JournalError, Position, journal_files, read_entries

GOLDEN = Path(__file__).parents[1] / "replays"


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """A run with a crashed job, a link that goes, and an operator who takes the boat: its folder, and the run."""
    folder = tmp_path_factory.mktemp("journal")

    def course(run: Any) -> None:
        run.advance(200.0)
        golden.operator(run)
        run.cut_link()
        run.advance(10.0)
        run.restore_link()
        run.advance(60.0)
        run.happened(StopRequested())

    return folder, golden.sail(folder, course, golden.BrokenWorker())


@pytest.fixture
def copy(recorded: tuple[Path, Any], tmp_path: Path) -> Path:
    folder = tmp_path / "copy"
    shutil.copytree(recorded[0], folder)
    return folder


def told(capsys: pytest.CaptureFixture[str], *words: str | Path) -> tuple[int, str, str]:
    """Exit code, standard output and error of `autonomy replay`."""
    code = cli.main(["replay", *map(str, words)])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def rewrite(folder: Path, change: Callable[[int, bytes], bytes | None]) -> None:
    """Write the run's only file anew, each payload changed, or left out where None comes back."""
    (file,) = journal_files(folder)
    with file.path.open("rb") as opened:
        frames = [part for part in scan(opened) if isinstance(part, Frame)]
    content = b""
    for i, frame in enumerate(frames):
        payload = frame.payload if i == 0 else change(frame.sequence, frame.payload)
        if payload is not None:
            content += pack(len(content), frame.sequence, payload)
    file.path.write_bytes(content)


def records(folder: Path) -> Iterator[Entry]:
    return (part for part in read_entries(folder, Position(1, 0)) if isinstance(part, Entry))


def test_every_effect_of_a_run_with_faults_is_reproduced(recorded: tuple[Path, Any]) -> None:
    folder, run = recorded
    outcome = replay(folder, 1)
    assert outcome.differences == []
    assert not outcome.lost
    assert outcome.close == 0
    assert outcome.effects > len(run.sent) + len(run.log)
    assert outcome.recorded_s == pytest.approx(run.now - 1000.0, abs=1.0)
    # The core that comes out is the one that went in.
    theirs, ours = run.core._learner.model(0.0), outcome.core._learner.model(0.0)
    assert (theirs.whitened_covariance == ours.whitened_covariance).all()
    assert (theirs.basis == ours.basis).all()
    # And there was something to reproduce.
    said = " ".join(text for _, text in run.log)
    for word in ("the planning job failed", "yielded", "link to the vehicle is gone", "stopping"):
        assert word in said


def test_recorded_are_all_messages_sent_in_order(recorded: tuple[Path, Any]) -> None:
    """The journal's own account against the driver's."""
    folder, run = recorded
    gists = [
        each for part in records(folder) if isinstance(part.record, Asked) for each in part.record.effects
    ]
    assert [each.label for each in gists if each.kind == "send"] == [m.get_type() for _, m in run.sent]


def test_jobs_are_recomputed_and_compared(recorded: tuple[Path, Any]) -> None:
    outcome = replay(recorded[0], 1, recompute=True)
    assert outcome.differences == []
    assert len(outcome.jobs) >= 2
    assert all(job.deviation <= 1e-6 for job in outcome.jobs)


def test_a_job_with_another_result_is_told(
    recorded: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = golden.jobs.run

    def other(name: str, request: Any, survey: Any) -> Any:
        result = run(name, request, survey)
        result.plan.route_m[0, 0] += 0.5
        return result

    monkeypatch.setattr(golden.jobs, "run", other)
    code, out, _ = told(capsys, recorded[0], "--diff")
    assert code == 1
    assert "effects, 0 differ" in out
    assert "job 1 explore: the same within" in out


def test_it_stops_where_it_is_told_to(recorded: tuple[Path, Any], capsys: pytest.CaptureFixture[str]) -> None:
    outcome = replay(recorded[0], 1, until_s=50.0)
    assert 45.0 < outcome.recorded_s <= 50.0
    assert outcome.differences == []
    seconds, moment = (
        told(capsys, recorded[0], "--until", word)[1].split(" replayed")[0]
        for word in ("50", "2025-06-15T15:07:30")
    )
    assert seconds == moment
    assert replay(recorded[0], 1, until_s=0.0).events >= 1


def test_a_core_that_does_something_else_is_told(
    recorded: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    handle = Core.handle

    def changed(self: Core, now: float, event: Event) -> list[Any]:
        effects = handle(self, now, event)
        for effect in effects:
            if isinstance(effect, SendMessage) and effect.message.get_type() == "MISSION_ITEM_INT":
                effect.message.x += effect.message.seq == 3
        return [
            e for e in effects if not (isinstance(e, SendMessage) and e.message.get_type() == "STATUSTEXT")
        ]

    monkeypatch.setattr(Core, "handle", changed)
    code, out, _ = told(capsys, recorded[0])
    assert code == 1
    assert "recorded send STATUSTEXT; replayed " in out
    assert "recorded send MISSION_ITEM_INT" in out


def test_numbers_may_differ_within_the_tolerance(
    recorded: tuple[Path, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another computer adds in another order; it does not decide otherwise."""
    handle = Core.handle

    def nearly(self: Core, now: float, event: Event) -> list[Any]:
        effects = handle(self, now, event)
        for effect in effects:
            if isinstance(effect, SendMessage) and effect.message.get_type() == "MISSION_ITEM_INT":
                effect.message.param2 *= 1.0 + 1e-9
        return effects

    monkeypatch.setattr(Core, "handle", nearly)
    strict, lenient = replay(recorded[0], 1), replay(recorded[0], 1, tolerance=1e-6)
    assert len(strict.differences) > 5
    assert all("but for its numbers" in each.replayed for each in strict.differences)
    assert lenient.differences == []
    assert lenient.close == len(strict.differences)


def test_a_core_that_raises_is_told_with_its_record(
    copy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    handle = Core.handle

    def raising(self: Core, now: float, event: Event) -> list[Any]:
        if now > 1020.0:
            raise ZeroDivisionError("a bug")
        return handle(self, now, event)

    monkeypatch.setattr(Core, "handle", raising)
    with pytest.raises(
        CoreRaisedError, match=r"record [0-9]+ of run 1 makes the core raise ZeroDivisionError: a bug"
    ):
        replay(copy, 1)
    code, _, err = told(capsys, copy)
    assert code == 70
    assert "Traceback" in err


def test_a_core_that_raises_when_it_goes_on_is_told_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    settings, area = golden.configuration(), golden.survey()
    journal = Journal.open(tmp_path, settings.journal, make_header(settings, area, now=5.0, utc_s=0.0))
    journal.event(5.0, StopRequested())
    journal.resumed(6.0, 1.0)
    journal.close()

    def raising(self: Core, now: float, away_s: float) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(Core, "resume", raising)
    code, _, err = told(capsys, tmp_path)
    assert code == 70
    assert "record 2 of run 1 makes the core raise ZeroDivisionError: a bug" in err


# Damaged, foreign, newer -------------------------------------------------------------------------------------


def test_a_lost_event_is_told_before_its_consequences(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    victim = next(part.position.sequence for part in records(copy) if isinstance(part.record, Happened)) + 40
    rewrite(copy, lambda number, payload: None if number == victim else payload)
    code, out, _ = told(capsys, copy)
    assert code == 65
    assert out.startswith(f"{copy}/run000001-0001.journal byte ")
    assert "1 records before it are missing" in out
    assert "records are missing" in out.splitlines()[-1]


def test_a_torn_end_is_no_damage(copy: Path) -> None:
    (file,) = journal_files(copy)
    content = file.path.read_bytes()
    file.path.write_bytes(content[: len(content) // 2])
    outcome = replay(copy, 1)
    assert outcome.differences == []
    assert not outcome.lost
    assert outcome.events > 100


def test_effects_missing_at_the_very_end_are_none(copy: Path) -> None:
    """The service was killed between an event's record and that of its effects."""
    last = max(part.position.sequence for part in records(copy) if isinstance(part.record, Asked))
    rewrite(copy, lambda number, payload: None if number >= last else payload)
    assert replay(copy, 1).differences == []


def test_invented_effects_are_differences(copy: Path) -> None:
    first = next(part for part in records(copy) if isinstance(part.record, Asked)).position.sequence
    rewrite(copy, lambda number, payload: encode_effects([]) if number == first else payload)
    assert [each.recorded for each in replay(copy, 1).differences[:1]] == ["nothing"]


def test_a_run_without_its_beginning_is_refused(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rewrite(copy, lambda number, payload: None if number < 50 else payload)
    code, _, err = told(capsys, copy)
    assert code == 65
    assert "run 1 can't be replayed, its beginning is gone" in err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"version": 2}, "is of a newer version, 2; this software reads 1"),
        ({"schema": "other"}, "is no journal of this software"),
        ({"configuration": {"survey": {}}}, "its configuration is not one of this software (survey.area"),
        ({"survey": {}}, "its survey area can't be read"),
        ({"survey": {"ground": b"no polygon"}}, "its survey area can't be read"),
        ({"now": None}, "its header does not say when it began"),
        ({"resumed": [7, 1]}, "run 1 says that it went on from [7, 1]"),
    ],
)
def test_foreign_headers_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, Any], said: str
) -> None:
    settings = golden.configuration()
    header = {**make_header(settings, golden.survey(), now=0.0, utc_s=0.0), **change}
    journal = Journal.open(tmp_path, settings.journal, header)
    journal.event(0.0, StopRequested())
    journal.close()
    # A run is never numbered below the one that it went on from; a file can be.
    next(tmp_path.glob("*.journal")).rename(tmp_path / "run000001-0001.journal")
    code, _, err = told(capsys, tmp_path)
    assert code == 65
    assert said in err


def test_what_is_no_journal_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert told(capsys, tmp_path / "nowhere" / "x.journal")[0] == 66
    code, _, err = told(capsys, tmp_path)
    assert (code, err) == (66, f"autonomy replay: {tmp_path}: holds no journal\n")
    other = tmp_path / "boat.tlog"
    other.write_bytes(b"")
    assert "is no file of a journal" in told(capsys, other)[2]
    empty = tmp_path / "run000001-0001.journal"
    empty.write_bytes(b"")
    code, _, err = told(capsys, empty)
    assert code == 65
    assert "is no journal, or its header is damaged" in err


def test_other_software_is_told(
    copy: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("autonomy.commands.replay.__version__", "99.0")
    code, _, err = told(capsys, copy, "--until", "5")
    assert code == 0
    assert "this is 99.0 with" in err


@pytest.mark.parametrize("words", [["--until", "-1"], ["--until", "noon"], ["--tolerance", "2"], []])
def test_usage(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["replay", *(["somewhere", *words] if words else [])])
    assert ended.value.code == 2


# Across runs -------------------------------------------------------------------------------------------------


def test_a_run_that_went_on_begins_with_the_one_before(tmp_path: Path) -> None:
    """The first run's core is taken over by a second one after its 300th record, as a restart would."""
    golden.sail(tmp_path, golden.worker)
    settings, area = golden.configuration(), golden.survey()
    happened = [
        part
        for part in records(tmp_path)
        if isinstance(part.record, Happened) and part.position.sequence <= 300
    ]
    core = Core(settings, area)
    for part in happened:
        core.handle(part.record.now, part.record.event)
    resumed = Position(1, 300)
    journal = Journal.open(
        tmp_path, settings.journal, make_header(settings, area, now=5.0, utc_s=0.0, resumed=resumed)
    )
    journal.resumed(5.0, 7.5)
    core.resume(5.0, 7.5)
    for i in range(20):
        event = happened[-1].record.event
        journal.event(6.0 + i, event)
        journal.effects(core.handle(6.0 + i, event))
    journal.close()
    outcome = replay(tmp_path, 2)
    assert outcome.differences == []
    assert outcome.events == len(happened) + 20
    with pytest.raises(JournalError, match="there is no run 3"):
        replay(tmp_path, 3)


# Golden ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(golden.COURSES))
def test_golden(name: str) -> None:
    """What is sent to the vehicle stays what it was; see golden.py for when it may change."""
    try:
        outcome = replay(GOLDEN / name, 1, tolerance=1e-6)
    except (CoreRaisedError, JournalError) as error:
        # The recorded results of jobs hold the model's state as it was made up then.
        pytest.fail(f"{error}; if this is meant: python tests/replays/golden.py")
    assert not outcome.lost
    assert outcome.events > 1000
    sent = [each for each in outcome.differences if "send " in f"{each.recorded} {each.replayed}"]
    assert sent == [], "if this is meant: python tests/replays/golden.py"


def test_the_golden_configuration_is_that_of_their_headers() -> None:
    assert read_configuration(run_header(GOLDEN / "operator", 1)) == golden.configuration()
