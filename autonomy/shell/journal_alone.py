"""Where to begin when there is no checkpoint to go on from, but a journal that fits."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from autonomy.config import Configuration
from autonomy.shell.checkpoint import FITTING_SHAPES, digests
from autonomy.shell.journal_files import JournalError, JournalFile, Position, journal_files, read_header

log = logging.getLogger(__name__)

MOST_BYTES = 2**24
"""Of journal files, but for the newest, which is taken whatever its size: what half a minute's replay has time for."""


@dataclass(frozen=True)
class Beginning:
    """A place in a journal from which a new core may be told everything: when, by both clocks, its run began."""

    position: Position
    now: float
    utc_s: float


def beginning(folder: Path, wanted: Mapping[str, str]) -> Beginning | None:
    """The earliest place from which every run went on from the one before it, all of them fitting.

    Args:
        folder: the journal.
        wanted: see `checkpoint.fits`.

    Returns:
        The place; None if not even the newest run fits, or nothing can be read.
    """
    found: Beginning | None = None
    complete, total = False, 0
    try:
        files = journal_files(folder)
    except OSError as error:
        log.error("%s can't be read: %s", folder, error)
        return None
    for file in reversed(files):
        total += _size(file)
        if found is not None and ((complete and file.run < found.position.run) or total > MOST_BYTES):
            break
        try:
            header = read_header(file.path)
            if _fits(header) != wanted:
                break
            found, complete = _beginning(file, header), header.get("resumed") is None
        except (JournalError, OSError) as error:
            log.error("%s", error)
            if found is not None:
                break
    return found


def _size(file: JournalFile) -> int:
    try:
        return file.path.stat().st_size
    except OSError:
        return 0


def _beginning(file: JournalFile, header: Mapping[str, object]) -> Beginning:
    match header.get("first_record"), header.get("now"), header.get("utc_s"):
        case (int() as first, float() as now, float() as utc_s) if first >= 1:
            return Beginning(Position(file.run, first - 1), now, utc_s)
    raise JournalError(f"{file.path}: its header does not say where and when it begins")


def _fits(header: Mapping[str, object]) -> dict[str, str]:
    """What a core made by the run's events would depend on. JournalError if the header does not tell."""
    try:
        configuration = Configuration.model_validate(header["configuration"])
        survey = header["survey"]
        shapes = {name: bytes(survey[name]) for name in FITTING_SHAPES}  # type: ignore[index]
        latitude, longitude = survey["origin_lat_deg"], survey["origin_lon_deg"]  # type: ignore[index]
        return digests(configuration, shapes, float(latitude), float(longitude))
    except (ValidationError, LookupError, TypeError, ValueError, OverflowError) as error:
        raise JournalError(
            f"the header of a run tells no survey or configuration of this software: {error}"
        ) from None
