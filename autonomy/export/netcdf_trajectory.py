"""The readings with their QARTOD flags as NetCDF: a CF-1.8 trajectory."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from autonomy.export.archive import Archive
from autonomy.export.attributes import About, Extent, Value, global_attributes, resolution
from autonomy.export.netcdf import (
    FILL_DOUBLE,
    LATITUDE,
    LONGITUDE,
    TIME,
    add,
    add_depth,
    add_grid_mapping,
    creating,
    measured,
    name_of,
)
from autonomy.export.values import ExportError, Readings, Subject
from autonomy.quality import Check, Flag

_CHUNK = 4096
_FEW_TIMES = 10_000
"""Times from which the usual time between readings is taken."""

_FLAGS: dict[str, Any] = {
    "flag_values": np.array(
        [Flag.GOOD, Flag.NOT_EVALUATED, Flag.SUSPECT, Flag.FAIL, Flag.MISSING], dtype=np.int8
    ),
    "flag_meanings": "PASS NOT_EVALUATED SUSPECT FAIL MISSING",
    "references": "https://ioos.noaa.gov/project/qartod/",
    "coverage_content_type": "qualityInformation",
}
_STANDARD_NAMES: Mapping[Check, str] = {
    Check.TIMING: "gap_test_quality_flag",
    Check.SYNTAX: "syntax_test_quality_flag",
    Check.GROSS_RANGE: "gross_range_test_quality_flag",
    Check.LOCATION: "location_test_quality_flag",
    Check.SPIKE: "spike_test_quality_flag",
    Check.RATE_OF_CHANGE: "rate_of_change_test_quality_flag",
    Check.FLAT_LINE: "flat_line_test_quality_flag",
}


def write_trajectory(path: Path, archive: Archive, subject: Subject, about: About) -> int:
    """Write all readings, some thousands in memory at a time; returns how many.

    Raises:
        ExportError: there are none.
        OSError: the file can't be written.
    """
    with creating(path) as dataset:
        writer = _Writer(dataset, subject, about)
        for part in archive.readings():
            writer.put(part)
        if not writer.count:
            raise ExportError(f"there is no observation of {archive.vehicle} in what is to be exported")
        writer.describe()
        return writer.count


class _Writer:
    """One file being written."""

    def __init__(self, dataset: netCDF4.Dataset, subject: Subject, about: About) -> None:
        variable, units = subject.variable, subject.units
        self._dataset, self._variable, self._about = dataset, variable, about
        self.count = 0
        self._extent = Extent(math.inf, -math.inf, math.inf, -math.inf, math.inf, -math.inf)
        self._times_s: list[float] = []
        # Longitudes go on past 180 where the survey lies across it, as those of its map.
        self._east_of = subject.frame.origin_lon_deg - 180.0
        dataset.createDimension("obs", None)
        letters = about.vehicle.encode()
        dataset.createDimension("trajectory_strlen", len(letters))
        identity = {"cf_role": "trajectory_id", "long_name": "name of the vehicle"}
        trajectory = add(dataset, "trajectory", "S1", ("trajectory_strlen",), identity)
        trajectory[:] = np.frombuffer(letters, dtype="S1")
        mapping = add_grid_mapping(dataset)
        self._columns = {
            "utc_s": self._column("time", "f8", TIME),
            "lat_deg": self._column("lat", "f8", LATITUDE),
            "lon_deg": self._column("lon", "f8", LONGITUDE),
        }
        coordinates = f"time lat lon {add_depth(dataset, about.depth_m)}".strip()
        name = name_of(variable)
        aggregate = f"{name}_qartod_aggregate"
        tests = {check: f"{name}_qartod_{check.name.lower()}" for check in Check}
        attributes: dict[str, Any] = {
            **measured(variable, units),
            "ancillary_variables": " ".join([aggregate, *tests.values()]),
            "coordinates": coordinates,
            "grid_mapping": mapping,
            "coverage_content_type": "physicalMeasurement",
        }
        self._columns["value"] = self._column(name, "f8", attributes, fill_value=FILL_DOUBLE)
        words = "QARTOD flag of a reading: the worst of its tests'"
        self._columns["flag"] = self._flags(aggregate, "aggregate_quality_flag", words)
        self._tests = {
            check: self._flags(
                tests[check], standard, f"QARTOD flag of the test {check.name.lower().replace('_', ' ')}"
            )
            for check, standard in _STANDARD_NAMES.items()
        }

    def _flags(self, name: str, standard_name: str, long_name: str) -> "netCDF4.Variable[Any]":
        attributes = {
            "standard_name": standard_name,
            "long_name": long_name,
            **_FLAGS,
            "coordinates": "time lat lon",
        }
        return self._column(name, "i1", attributes)

    def _column(
        self, name: str, kind: str, attributes: Mapping[str, Any], **options: Any
    ) -> "netCDF4.Variable[Any]":
        return add(self._dataset, name, kind, ("obs",), attributes, chunksizes=(_CHUNK,), **options)

    def put(self, part: Readings) -> None:
        """Some more readings."""
        rows = slice(self.count, self.count + len(part))
        for name, variable in self._columns.items():
            values = getattr(part, name)
            if name == "value":
                values = np.ma.masked_invalid(values)
            elif name == "lon_deg":
                values = values - 360.0 * np.floor((values - self._east_of) / 360.0)
                self._widen(part, values)
            variable[rows] = values
        for check, variable in self._tests.items():
            variable[rows] = part.checks[:, check]
        self.count += len(part)
        self._times_s.extend(part.utc_s[: max(0, _FEW_TIMES - len(self._times_s))].tolist())

    def _widen(self, part: Readings, lon_deg: Any) -> None:
        old = self._extent
        self._extent = Extent(
            min(old.south, float(part.lat_deg.min())),
            max(old.north, float(part.lat_deg.max())),
            min(old.west, float(lon_deg.min())),
            max(old.east, float(lon_deg.max())),
            min(old.start_s, float(part.utc_s.min())),
            max(old.end_s, float(part.utc_s.max())),
        )

    def describe(self) -> None:
        """The global attributes."""
        words = self._variable.replace("_", " ")
        summary = (
            f"Readings of {words} along the track of the vehicle {self._about.vehicle}, each with the flags of the "
            "QARTOD tests that it went through when it was made. Those that its model learnt from, and those that it "
            "would have if their quality were better."
        )
        more: dict[str, Value] = {
            "featureType": "trajectory",
            "cdm_data_type": "Trajectory",
            "processing_level": "Quality-controlled in-situ observations, flagged in real time on board (level 2)",
            "time_coverage_resolution": resolution(self._times_s),
        }
        attributes = global_attributes(self._about, "trajectory", summary, self._variable, self._extent, more)
        self._dataset.setncatts(attributes)
