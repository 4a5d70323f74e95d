"""`autonomy export SOURCE`: a recorded survey as NetCDF, GeoJSON, MCAP and CSV."""

import argparse
import contextlib
import importlib.util
import math
import re
import shlex
import sqlite3
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from autonomy.commands.replay import EXIT_DATA, EXIT_NO_INPUT, find_run
from autonomy.commands.run import EXIT_SOFTWARE
from autonomy.option_types import above_zero, between, vehicle_name
from autonomy.shell.journal_files import JournalError
from autonomy.shore.recording import RecordingError, is_recording

if TYPE_CHECKING:
    from autonomy.export.archive import Archive

EXIT_OK, EXIT_USAGE = 0, 2
EXIT_CANNOT_CREATE = 73
"""EX_CANTCREAT of sysexits.h."""

_FORMATS = {
    "netcdf": "maps of the nowcast over time: NetCDF, CF-1.8 and ACDD-1.3",
    "trajectory": "readings with their quality flags: NetCDF, a CF trajectory",
    "geojson": "track, plans and sampling spots",
    "mcap": "all of it as a log for Foxglove and Lichtblick",
    "csv": "readings as a table",
}
_LIBRARIES = {
    "netcdf": ("netCDF4",),
    "trajectory": ("netCDF4",),
    "mcap": ("foxglove", "matplotlib", "cmocean"),
}
_PACKAGES = {"foxglove": "foxglove-sdk"}
_UNITS_S = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}
_SHOWN = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The verb's arguments."""
    parser.add_argument(
        "source",
        type=Path,
        metavar="SOURCE",
        help="folder of `autonomy shore record`, or of a boat's journal (its newest run), or a file of a run",
    )
    for name, what in _FORMATS.items():
        parser.add_argument(f"--{name}", type=Path, metavar="FILE", help=what)
    parser.add_argument("--vehicle", type=vehicle_name, metavar="V", help="which, where there are several")
    parser.add_argument(
        "--every",
        type=_period,
        default=600.0,
        metavar="TIME",
        help="shortest time between two maps, e.g. 30s, 10min, 1h (10min)",
    )
    parser.add_argument(
        "--resolution",
        type=above_zero("metres"),
        metavar="M",
        help="side of a map's cell, in metres (the area's longer side over 200)",
    )
    parser.add_argument("--from", dest="start", type=_moment, metavar="UTC", help="nothing before that")
    parser.add_argument(
        "--until", type=_moment, metavar="UTC", help="nothing after that, e.g. 2026-05-01T12:30:00"
    )
    parser.add_argument(
        "--depth",
        type=between(0.0, 12_000.0, "metres"),
        metavar="M",
        help="of the probe below the surface, in metres, for NetCDF",
    )
    parser.add_argument(
        "--attributes",
        type=Path,
        metavar="FILE",
        help="YAML with global attributes for NetCDF: creator_name, institution, license, …",
    )
    parser.add_argument(
        "--date-by-arrival",
        action="store_true",
        help="where the vehicle did not know UTC, date by the clock of whoever received it",
    )
    parser.add_argument("--force", action="store_true", help="overwrite files")


def run(arguments: argparse.Namespace) -> int:
    """Export and say what came of it.

    Exit codes: 0; 2 usage, or a library is missing; 65 what there is can't be exported; 66 there is no such source;
    70 the core raised when the journal was replayed; 73 a file can't be written.
    """
    try:
        return _run(arguments)
    except _FailedError as failure:
        sys.stderr.write(f"autonomy export: {failure}\n")
        return failure.code


class _FailedError(Exception):
    """Says why, and with which exit code."""

    def __init__(self, why: object, code: int) -> None:
        super().__init__(str(why))
        self.code = code


def _run(arguments: argparse.Namespace) -> int:
    outputs = _outputs(arguments)
    given = _attributes(arguments.attributes)
    source = _source(arguments.source)
    _require_libraries(outputs)
    # The learner takes a while to import.
    from autonomy.export.outputs import appearing
    from autonomy.export.values import ExportError
    from autonomy.replay import CoreRaisedError

    regrets = _Regrets()
    try:
        with (
            contextlib.closing(regrets),
            tempfile.TemporaryDirectory(prefix="halocline-export-") as work,
            _filled(arguments, source, Path(work), regrets) as (archive, water),
            appearing(outputs) as files,
        ):
            told = list(_write(arguments, archive, water, files, given))
    except (ExportError, RecordingError, JournalError) as error:
        raise _FailedError(error, EXIT_DATA) from None
    except CoreRaisedError as error:
        raise _FailedError(error, EXIT_SOFTWARE) from None
    except sqlite3.OperationalError as error:
        why = f"the temporary folder {tempfile.gettempdir()} takes no more ({error}); TMPDIR names another"
        raise _FailedError(why, EXIT_CANNOT_CREATE) from None
    except OSError as error:
        reading = error.filename is not None and Path(str(error.filename)).is_relative_to(source.folder)
        where = f"{error.filename}: " if error.filename else ""
        code = EXIT_NO_INPUT if reading else EXIT_CANNOT_CREATE
        raise _FailedError(f"{where}{error.strerror or error}", code) from None
    for name, text in told:
        sys.stdout.write(f"{outputs[name]}: {text}\n")
    return EXIT_OK


@dataclass(frozen=True)
class _Source:
    """A recording's folder, or a journal's and the number of a run."""

    folder: Path
    run: int | None


def _source(path: Path) -> _Source:
    if not path.exists():
        raise _FailedError(f"{path}: No such file or directory", EXIT_NO_INPUT)
    try:
        if path.is_dir() and is_recording(path):
            return _Source(path, None)
        if path.suffix == ".recording" and path.is_file():
            raise _FailedError(f"{path}: give the recording's folder, {path.parent}", EXIT_USAGE)
        return _Source(*find_run(path))
    except OSError as error:
        raise _FailedError(f"{path}: {error.strerror}", EXIT_NO_INPUT) from None
    except JournalError:
        why = f"{path}: holds neither a shore recording nor a journal"
        raise _FailedError(why, EXIT_NO_INPUT) from None


@contextlib.contextmanager
def _filled(
    arguments: argparse.Namespace, source: _Source, work: Path, regret: Callable[[str], None]
) -> Iterator[tuple["Archive", Any]]:
    """The archive, and the survey's water in local metres (None if unknown)."""
    from autonomy import replay
    from autonomy.export import grid, sources
    from autonomy.export.intake import Intake
    from autonomy.export.values import ExportError, Window

    area = None
    if source.run is None:
        vehicle = arguments.vehicle or sources.find_vehicle(source.folder)
    else:
        vehicle = replay.read_configuration(replay.run_header(source.folder, source.run)).vehicle.name
        if arguments.vehicle not in (None, vehicle):
            raise ExportError(f"{source.folder}: is the journal of {vehicle}, not of {arguments.vehicle}")
    intake = Intake(work / "archive.sqlite", vehicle, arguments.every, regret)
    with contextlib.closing(intake):
        if source.run is None:
            sources.fill_from_recording(intake, source.folder, regret)
        else:
            area = sources.fill_from_journal(intake, source.folder, source.run, regret)
        start_s = -math.inf if arguments.start is None else arguments.start
        end_s = math.inf if arguments.until is None else arguments.until
        archive = intake.finish(Window(start_s, end_s), date_by_arrival=arguments.date_by_arrival)
        yield archive, grid.told_water(archive.surveys, archive.subject()) if area is None else area.water


def _write(
    arguments: argparse.Namespace,
    archive: "Archive",
    water: Any,
    files: Mapping[str, Path],
    given: Mapping[str, Any],
) -> Iterator[tuple[str, str]]:
    """Write what is asked for; each format, and what to say of it."""
    from autonomy.export.attributes import About
    from autonomy.export.csv_table import write_csv
    from autonomy.export.geojson import write_geojson
    from autonomy.export.grid import map_grid

    subject = archive.subject()
    origin = archive.origin()
    about = About(
        vehicle=archive.vehicle,
        source=arguments.source.resolve().name,
        survey=origin.survey,
        software_version=origin.software_version,
        configuration_hash=origin.configuration_hash,
        created=datetime.now(UTC),
        command=shlex.join(["autonomy", *sys.argv[1:]]),
        dated_by_arrival=archive.dated_by_arrival,
        depth_m=arguments.depth,
        given=given,
    )
    if "netcdf" in files or "mcap" in files:
        archive.newest()
    if "netcdf" in files:
        from autonomy.export.netcdf_map import write_map

        grid = map_grid(subject, water, arguments.resolution)
        count = write_map(files["netcdf"], archive, subject, grid, about)
        land = "" if grid.masked else "; where the land is was not recorded"
        yield "netcdf", f"{count} maps of {len(grid.lat_deg)} × {len(grid.lon_deg)} cells{land}"
    if "trajectory" in files:
        from autonomy.export.netcdf_trajectory import write_trajectory

        count = write_trajectory(files["trajectory"], archive, subject, about)
        yield "trajectory", f"{count} readings"
    if "geojson" in files:
        yield "geojson", f"{write_geojson(files['geojson'], archive)} features"
    if "csv" in files:
        yield "csv", f"{write_csv(files['csv'], archive, subject.variable, subject.units)} readings"
    if "mcap" in files:
        from autonomy.export.mcap_log import write_mcap

        count = write_mcap(files["mcap"], archive, subject, water, arguments.resolution)
        yield "mcap", f"{count} messages"


class _Regrets:
    """What could not be used: the first of it at once, the rest as a number."""

    def __init__(self) -> None:
        self._count = 0

    def __call__(self, text: str) -> None:
        self._count += 1
        if self._count <= _SHOWN:
            sys.stderr.write(
                "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text) + "\n"
            )

    def close(self) -> None:
        """Say how many there were."""
        if self._count > _SHOWN:
            sys.stderr.write(f"… and {self._count - _SHOWN} more\n")


def _outputs(arguments: argparse.Namespace) -> dict[str, Path]:
    """The files that are asked for."""
    outputs = {name: getattr(arguments, name) for name in _FORMATS if getattr(arguments, name) is not None}
    if not outputs:
        options = ", ".join(f"--{name}" for name in _FORMATS)
        raise _FailedError(f"nothing is asked for: give some of {options}", EXIT_USAGE)
    seen: dict[Path, str] = {}
    for name, path in outputs.items():
        other = seen.setdefault(path.absolute(), name)
        if other != name:
            raise _FailedError(f"--{other} and --{name} name the same file, {path}", EXIT_USAGE)
        if path.is_dir() or not path.absolute().parent.is_dir():
            what = "is a folder" if path.is_dir() else f"there is no folder {path.absolute().parent}"
            raise _FailedError(f"--{name}: {path}: {what}", EXIT_CANNOT_CREATE)
        if path.exists() and not arguments.force:
            raise _FailedError(f"--{name}: {path} exists; --force overwrites it", EXIT_CANNOT_CREATE)
    return outputs


def _require_libraries(outputs: Mapping[str, Path]) -> None:
    for name in outputs:
        for library in _LIBRARIES.get(name, ()):
            if importlib.util.find_spec(library) is None:
                what = _PACKAGES.get(library, library)
                raise _FailedError(f"--{name} needs {what}: pip install 'halocline[shore]'", EXIT_USAGE)


def _attributes(path: Path | None) -> dict[str, Any]:
    """Global attributes from a file of the user's."""
    if path is None:
        return {}
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _FailedError(f"--attributes: {path}: {error.strerror}", EXIT_NO_INPUT) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise _FailedError(f"--attributes: {path}: is no YAML: {error}", EXIT_DATA) from None
    if not isinstance(content, dict):
        raise _FailedError(f"--attributes: {path}: must be a map of names to texts or numbers", EXIT_DATA)
    for name, value in content.items():
        if not (isinstance(name, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name)):
            raise _FailedError(f"--attributes: {path}: {name!r} is no name of an attribute", EXIT_DATA)
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise _FailedError(f"--attributes: {path}: {name}: must be a text or a number", EXIT_DATA)
        if isinstance(value, int) and abs(value) >= 2**63:
            raise _FailedError(
                f"--attributes: {path}: {name}: has too many digits; as a text it may", EXIT_DATA
            )
    return content


def _period(text: str) -> float:
    match = re.fullmatch(r"([0-9]+(?:\.[0-9]*)?)(s|min|h|d)?", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"must be a time such as 30s, 10min, 1h or 1d (got {text!r})")
    return float(match[1]) * _UNITS_S[match[2] or ""]


def _moment(text: str) -> float:
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"must be a time such as 2026-05-01T12:30:00 (got {text!r})"
        ) from None
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()
