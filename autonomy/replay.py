"""A recorded run again: the same core, driven from its journal, held against what it asked for then.

Jobs are not run: what the worker answered is in the journal. To check the worker too, its jobs are recomputed
and compared.
"""

import math
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pydantic import ValidationError
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from autonomy import jobs, structure
from autonomy.config import Configuration
from autonomy.core import Core
from autonomy.effects import Effect, StartJob
from autonomy.events import JobFinished
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea
from autonomy.records import Asked, Gist, Happened, Resumed, gist
from autonomy.shell.journal_files import (
    SHAPES,
    Entry,
    JournalError,
    Position,
    Trouble,
    journal_files,
    read_entries,
    read_header,
)

JOB_TOLERANCE = 1e-6
"""Recomputed jobs may differ by this, relative to the largest number of an array: other processors round otherwise."""


class CoreRaisedError(RuntimeError):
    """The core raised an exception, its cause, on a record of the journal; says which record."""


@dataclass(frozen=True)
class Difference:
    """An effect that is not what it was: where, when (seconds from the run's start), and both of them."""

    position: Position
    elapsed_s: float
    recorded: str
    replayed: str

    def __str__(self) -> str:
        where = f"record {self.position.sequence} of run {self.position.run}, {self.elapsed_s:.3f} s"
        return f"{where}: recorded {self.recorded}; replayed {self.replayed}"


@dataclass(frozen=True)
class JobCheck:
    """A job recomputed: the largest deviation of its numbers from the recorded result, infinite if it is another."""

    job_id: int
    name: str
    deviation: float


@dataclass
class Outcome:
    """What came of a replay.

    Attributes:
        core: as it was at the end.
        events: how many were replayed.
        effects: how many were compared.
        close: how many of these were equal only within the tolerance.
        recorded_s: protocol time from first to last event, pauses between runs left out.
        took_s: what the replay took.
        differences: effects that are not what they were.
        troubles: what could not be read, for a person.
        lost: whether records are missing: what comes after them may differ for that reason alone.
        jobs: those recomputed.
    """

    core: Core
    events: int = 0
    effects: int = 0
    close: int = 0
    recorded_s: float = 0.0
    took_s: float = 0.0
    differences: list[Difference] = field(default_factory=list)
    troubles: list[str] = field(default_factory=list)
    lost: bool = False
    jobs: list[JobCheck] = field(default_factory=list)


def replay(
    folder: Path,
    run: int,
    until_s: float = math.inf,
    tolerance: float = 0.0,
    *,
    recompute: bool = False,
    heard: Callable[[float, Sequence[Effect]], None] | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> Outcome:
    """Replay a run, and before it the runs that it went on from.

    Args:
        folder: the journal.
        run: number of the run.
        until_s: stop at this protocol time, seconds from that run's start.
        tolerance: by how much an effect's numbers may differ, relatively: 0 on the computer that recorded them.
        recompute: whether to run the jobs again too.
        heard: is told what the core asks for at each event, and when that was by the wall clock on board.
        clock: seconds, for `took_s`.

    Raises:
        JournalError: the run can't be replayed: it isn't there, its beginning was removed, or it is of another version.
        CoreRaisedError: the core raised.
        OSError: a file can't be read.
    """
    begun = clock()
    header = run_header(folder, run)
    chain, left_out = _chain(folder, run, header)
    configuration, survey = read_configuration(header), read_survey_area(header)
    repeat = _Replay(
        Core(configuration, survey), survey, tolerance, left_out, recompute=recompute, heard=heard
    )
    for number, last in chain:
        began = header if number == run else run_header(folder, number)
        offset_s = _utc_offset_s(began)
        end = float(header["now"]) + until_s if number == run else math.inf
        repeat.take(_sound(folder, number, last), end, offset_s)
    repeat.outcome.took_s = clock() - begun
    return repeat.outcome


def run_header(folder: Path, run: int) -> dict[str, Any]:
    """What the files of a run begin with.

    Raises:
        JournalError: there is no such run, or no file of it has a sound header.
        OSError: a file can't be read.
    """
    files = [file for file in journal_files(folder) if file.run == run]
    if not files:
        raise JournalError(f"{folder}: there is no run {run}")
    for file in files[:-1]:
        try:
            return read_header(file.path)
        except JournalError:
            continue
    return read_header(files[-1].path)


def _utc_offset_s(header: dict[str, Any]) -> float:
    """The wall clock on board minus protocol time when a run began. JournalError if its header does not say."""
    match header.get("utc_s"), header.get("now"):
        case (float() as utc_s, float() as now):
            return utc_s - now
    raise JournalError("its header does not say when it began")


def read_configuration(header: dict[str, Any]) -> Configuration:
    """The configuration of a run. Raises JournalError if this software's has other keys or ranges."""
    try:
        return Configuration.model_validate(header.get("configuration"))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise JournalError(
            f"its configuration is not one of this software ({key}: {first['msg']}); "
            f"it was recorded by halocline {header.get('software')}"
        ) from None


def read_survey_area(header: dict[str, Any]) -> SurveyArea:
    """The survey area of a run. Raises JournalError if the header has none that is whole."""
    try:
        survey = header["survey"]
        shapes = {name: _shape(name, survey[name]) for name in SHAPES}
        frame = LocalFrame(float(survey["origin_lat_deg"]), float(survey["origin_lon_deg"]))
        return SurveyArea(
            frame,
            standoff_m=float(survey["standoff_m"]),
            passage_cells=int(survey["passage_cells"]),
            **shapes,
        )
    except (KeyError, TypeError, ValueError, OverflowError, shapely.errors.ShapelyError) as error:
        raise JournalError(f"its survey area can't be read: {error}") from None


def _shape(name: str, wkb: bytes) -> BaseGeometry:
    """One part of the survey area. Raises ValueError, ShapelyError or TypeError if it is none."""
    with np.errstate(invalid="ignore"):
        shape = shapely.from_wkb(wkb)
    if not isinstance(shape, Polygon | MultiPolygon) or not np.isfinite(shapely.get_coordinates(shape)).all():
        raise ValueError(f"{name} is no polygon")
    return shape


def _chain(
    folder: Path, run: int, header: dict[str, Any]
) -> tuple[list[tuple[int, float]], frozenset[Position]]:
    """The runs to replay and the last record of each, oldest first; and what none of them was told. JournalError."""
    chain: list[tuple[int, float]] = [(run, math.inf)]
    left_out: set[Position] = set()
    while header.get("resumed") is not None:
        left_out |= _left_out(header, chain[0][0])
        match header["resumed"]:
            case [int() as before, int() as last] if before < chain[0][0]:
                chain.insert(0, (before, last))
                header = run_header(folder, before)
            case other:
                raise JournalError(f"run {chain[0][0]} says that it went on from {str(other)[:80]}")
    return chain, frozenset(left_out)


def _left_out(header: dict[str, Any], run: int) -> set[Position]:
    """The records of earlier runs that were quarantined when a run began."""
    match header.get("left_out", []):
        case [*rows] if all(isinstance(row, list) and list(map(type, row)) == [int, int] for row in rows):
            return {Position(before, sequence) for before, sequence in rows}
        case other:
            raise JournalError(f"run {run} says that it has left out {str(other)[:80]}")


def _sound(folder: Path, run: int, last: float) -> Iterator[Entry | Trouble]:
    """The records of a run up to one. Raises JournalError if the first is not there any more."""
    begun, reached = False, 0
    for part in read_entries(folder, Position(run, 0), run):
        if isinstance(part, Entry):
            if part.position.sequence > last:
                return
            begun, reached = True, part.position.sequence
        elif not begun and part.lost and not part.torn:
            raise JournalError(f"run {run} can't be replayed, its beginning is gone: {part.text}")
        yield part
    if reached < last < math.inf:
        missing = int(last) - reached
        yield Trouble(f"run {run} ends with record {reached}: {missing} records are missing", missing, False)


class _Replay:
    """One core, its recorded events, and what it asks for."""

    def __init__(
        self,
        core: Core,
        survey: SurveyArea,
        tolerance: float,
        left_out: frozenset[Position],
        *,
        recompute: bool,
        heard: Callable[[float, Sequence[Effect]], None] | None,
    ) -> None:
        self.outcome = Outcome(core)
        self._left_out = left_out
        self._survey = survey
        self._tolerance = tolerance
        self._recompute = recompute
        self._heard = heard
        self._utc_offset_s = 0.0
        self._computed: dict[int, tuple[str, Any]] = {}
        self._effects: list[Effect] = []
        self._position = Position(0, 0)
        self._start = self._now = 0.0

    def take(self, parts: Iterator[Entry | Trouble], end: float, utc_offset_s: float) -> None:
        """Replay one run's records until protocol time `end`; the offset makes it the wall clock on board."""
        self._utc_offset_s = utc_offset_s
        self._effects, first, told = [], True, True
        for part in parts:
            if isinstance(part, Trouble):
                self._regret(part)
                continue
            record = part.record
            if isinstance(record, Asked):
                if told:
                    self._compare(record.effects)
                continue
            if not isinstance(record, Happened | Resumed):
                continue
            if record.now > end:
                break
            if first:
                self._start, first = record.now, False
            self._compare(())
            self._position, self._now = part.position, record.now
            told = part.position not in self._left_out
            if told:
                self._repeat(record)
            else:
                where = f"record {part.position.sequence} of run {part.position.run}"
                self.outcome.troubles.append(f"{where} is quarantined: left out, as it was then")
        # The effects of the last event may not have been written any more.
        self._effects = []
        self.outcome.recorded_s += self._now - self._start

    def _repeat(self, record: Happened | Resumed) -> None:
        if isinstance(record, Happened):
            self.outcome.events += 1
            if isinstance(record.event, JobFinished):
                self._check(record.event)
        try:
            self._effects = self._tell(record)
        except Exception as error:
            where = f"record {self._position.sequence} of run {self._position.run}"
            what = f"{type(error).__name__}: {error}"
            raise CoreRaisedError(f"{where} makes the core raise {what}") from error
        if isinstance(record, Resumed):
            return
        if self._heard is not None:
            self._heard(record.now + self._utc_offset_s, self._effects)
        if self._recompute:
            for effect in self._effects:
                if isinstance(effect, StartJob):
                    self._run(effect)

    def _tell(self, record: Happened | Resumed) -> list[Effect]:
        if isinstance(record, Resumed):
            self.outcome.core.resume(record.now, record.away_s)
            return []
        return self.outcome.core.handle(record.now, record.event)

    def _regret(self, trouble: Trouble) -> None:
        if not trouble.torn:
            self.outcome.lost = True
            self.outcome.troubles.append(trouble.text)
            # Whether their record is among the lost ones is not known.
            self._effects = []

    def _compare(self, recorded: tuple[Gist, ...]) -> None:
        """Hold what the last event brought about against what it brought about then."""
        replayed = [gist(effect) for effect in self._effects]
        self._effects = []
        for i in range(max(len(recorded), len(replayed))):
            then = recorded[i] if i < len(recorded) else None
            now = replayed[i] if i < len(replayed) else None
            self.outcome.effects += 1
            if then == now:
                continue
            if then is not None and now is not None and is_close(then, now, self._tolerance):
                self.outcome.close += 1
                continue
            elapsed_s = self._now - self._start
            self.outcome.differences.append(Difference(self._position, elapsed_s, *_told(then, now)))

    def _run(self, effect: StartJob) -> None:
        # As the worker gets it: the core goes on changing what the request refers to.
        request = pickle.loads(pickle.dumps(effect.request))
        try:
            result = jobs.run(effect.name, request, self._survey)
        except Exception as error:  # noqa: BLE001 -- as in the worker: whatever a job raises is its answer
            result = error
        self._computed[effect.job_id] = (effect.name, result)

    def _check(self, event: JobFinished) -> None:
        if event.job_id in self._computed:
            name, result = self._computed.pop(event.job_id)
            apart = math.inf if isinstance(result, Exception) else structure.deviation(event.result, result)
            self.outcome.jobs.append(JobCheck(event.job_id, name, apart))


def is_close(a: Gist, b: Gist, tolerance: float) -> bool:
    """Whether two effects differ in their numbers alone, and there by no more than a share of the larger one."""
    one, other = a.fingerprint, b.fingerprint
    if (a.kind, a.label, one.outline) != (b.kind, b.label, other.outline):
        return False
    pairs = zip(one.numbers, other.numbers, strict=True)
    return len(one.numbers) == len(other.numbers) and all(
        x == y or (x != x and y != y) or abs(x - y) <= tolerance * max(abs(x), abs(y)) for x, y in pairs
    )


def _told(then: Gist | None, now: Gist | None) -> tuple[str, str]:
    """Both effects for a person; what differs if their names do not."""
    if then is None or now is None:
        return str(then or "nothing"), str(now or "nothing")
    if str(then) != str(now):
        return str(then), str(now)
    a, b = then.fingerprint, now.fingerprint
    if a.outline != b.outline or len(a.numbers) != len(b.numbers):
        return f"{then} ({a.exact.hex()})", f"another ({b.exact.hex()})"
    shares = [abs(x - y) / max(abs(x), abs(y)) for x, y in zip(a.numbers, b.numbers, strict=True) if x != y]
    return str(then), f"the same but for its numbers (by up to {max(shares, default=0.0):.1g} of their size)"
