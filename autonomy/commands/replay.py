"""`autonomy replay RUN`: a recorded run again, its effects held against the recorded ones."""

import argparse
import math
import sys
import traceback
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from autonomy import __version__
from autonomy.commands.run import EXIT_SOFTWARE
from autonomy.shell.journal_files import SUFFIX, JournalError, JournalFile, journal_files

if TYPE_CHECKING:
    from autonomy.replay import Outcome

EXIT_DIFFERENT = 1
EXIT_DATA = 65
"""EX_DATAERR of sysexits.h."""

EXIT_NO_INPUT = 66
"""EX_NOINPUT of sysexits.h."""

_SHOWN = 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "run",
        type=Path,
        metavar="RUN",
        help="folder of a journal, for its newest run, or a file of the run",
    )
    parser.add_argument(
        "--until",
        type=_moment,
        metavar="TIME",
        help="stop there: seconds from the run's start, or UTC such as 2026-05-01T12:30:00",
    )
    parser.add_argument(
        "--diff", action="store_true", help="recompute the jobs too, and compare their results"
    )
    parser.add_argument(
        "--tolerance",
        type=_tolerance,
        default=0.0,
        metavar="SHARE",
        help="by how much the numbers of an effect may differ, relatively; 0 on the computer that recorded it (0)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Replay and report.

    Exit codes: 0 every effect is equal, 1 some differ, 65 it can't be replayed or records are missing, 66 there is no
    such journal, 70 the core raised.
    """
    try:
        folder, number = find_run(arguments.run)
    except OSError as error:
        return _failed(f"{arguments.run}: {error.strerror}", EXIT_NO_INPUT)
    except JournalError as error:
        return _failed(error, EXIT_NO_INPUT)
    # The learner takes a while to import.
    from autonomy import replay

    try:
        header = replay.run_header(folder, number)
        _doubt(header)
        until_s = _seconds(arguments.until, header)
        outcome = replay.replay(folder, number, until_s, arguments.tolerance, recompute=arguments.diff)
    except JournalError as error:
        return _failed(error, EXIT_DATA)
    except replay.CoreRaisedError as error:
        traceback.print_exception(error.__cause__)
        return _failed(error, EXIT_SOFTWARE)
    except OSError as error:
        return _failed(f"{error.filename}: {error.strerror}", EXIT_NO_INPUT)
    return _report(outcome, number, replay.JOB_TOLERANCE)


def find_run(path: Path) -> tuple[Path, int]:
    """Folder and number of the run that a path means.

    Raises:
        JournalError: there is none.
        OSError: the folder can't be read.
    """
    folder = path if path.is_dir() else path.parent
    wanted = None if path.is_dir() else path.with_suffix(SUFFIX).name
    files: list[JournalFile] = journal_files(folder)
    named = [file for file in files if wanted is None or file.path.name == wanted]
    if not named:
        what = "holds no journal" if wanted is None else "is no file of a journal (run000001-0001.journal)"
        raise JournalError(f"{path}: {what}")
    return folder, named[-1].run


def _doubt(header: dict[str, object]) -> None:
    """Say so if other software recorded the run: it need not have done the same."""
    there, here = (header.get("software"), header.get("numpy")), (__version__, np.__version__)
    if there != here:
        sys.stderr.write(
            f"recorded by halocline {there[0]} with numpy {there[1]}; "
            f"this is {here[0]} with {here[1]}: differences may come from that\n"
        )


def _report(outcome: "Outcome", number: int, job_tolerance: float) -> int:
    say = sys.stdout.write
    for text in outcome.troubles[:_SHOWN]:
        say(f"{text}\n")
    for difference in outcome.differences[:_SHOWN]:
        say(f"{difference}\n")
    if len(outcome.differences) > _SHOWN:
        say(f"… and {len(outcome.differences) - _SHOWN} more\n")
    for job in outcome.jobs:
        say(f"job {job.job_id} {job.name}: {_apart(job.deviation)}\n")
    wrong_jobs = [job for job in outcome.jobs if not job.deviation <= job_tolerance]
    speed = outcome.recorded_s / outcome.took_s if outcome.took_s > 0 else math.inf
    say(
        f"run {number}: {outcome.events} events of {outcome.recorded_s:.0f} s replayed in {outcome.took_s:.1f} s "
        f"({speed:.0f} times as fast as life); {outcome.effects} effects, {len(outcome.differences)} differ"
        + (f", {outcome.close} within the tolerance" if outcome.close else "")
        + (f"; {len(outcome.jobs)} jobs recomputed, {len(wrong_jobs)} differ" if outcome.jobs else "")
        + ("; records are missing" if outcome.lost else "")
        + "\n"
    )
    if outcome.lost:
        return EXIT_DATA
    return EXIT_DIFFERENT if outcome.differences or wrong_jobs else 0


def _apart(deviation: float) -> str:
    if deviation == 0.0:
        return "the same result"
    return "another result" if math.isinf(deviation) else f"the same within {deviation:.1g}"


def _failed(why: object, code: int) -> int:
    sys.stderr.write(f"autonomy replay: {why}\n")
    return code


def _seconds(until: float | datetime | None, header: dict[str, object]) -> float:
    """Seconds from the run's start to a moment."""
    if until is None:
        return math.inf
    if isinstance(until, datetime):
        start = header.get("utc_s")
        if not isinstance(start, float):
            raise JournalError("its header does not say when it began")
        return until.timestamp() - start
    return until


def _moment(text: str) -> float | datetime:
    try:
        seconds = float(text)
    except ValueError:
        try:
            moment = datetime.fromisoformat(text)
        except ValueError:
            raise argparse.ArgumentTypeError(
                f"must be seconds or a time such as 2026-05-01T12:30:00, got {text}"
            ) from None
        return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    if not seconds >= 0.0:
        raise argparse.ArgumentTypeError(f"must be zero or more seconds, got {text}")
    return seconds


def _tolerance(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < 1.0:
        raise argparse.ArgumentTypeError(f"must be from 0 to 1, got {text}")
    return value
