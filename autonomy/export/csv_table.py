"""The readings as a table: CSV, RFC 4180."""

import csv
import math
from pathlib import Path

from autonomy.export.archive import Archive
from autonomy.export.values import Readings, iso_utc
from autonomy.quality import Check


def write_csv(path: Path, archive: Archive, variable: str, units: str) -> int:
    """Write all readings, some thousands in memory at a time; returns how many.

    Columns: time (ISO 8601, UTC), latitude and longitude in degrees, the value with its units in the heading (empty
    where the probe sent no number), the QARTOD flag and those of the single tests.

    Raises:
        OSError: the file can't be written.
    """
    count = 0
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        tests = [f"qartod_{check.name.lower()}" for check in Check]
        table.writerow(
            ["time_utc", "latitude_deg", "longitude_deg", f"{variable} [{units}]", "qartod_flag", *tests]
        )
        for part in archive.readings():
            table.writerows(map(_row, *_columns(part)))
            count += len(part)
    return count


def _columns(part: Readings) -> tuple[list[object], ...]:
    names = ("utc_s", "lat_deg", "lon_deg", "value", "flag", "checks")
    return tuple(getattr(part, name).tolist() for name in names)


def _row(utc_s: float, lat: float, lon: float, value: float, flag: int, checks: list[int]) -> list[object]:
    return [iso_utc(utc_s), lat, lon, "" if math.isnan(value) else value, flag, *checks]
