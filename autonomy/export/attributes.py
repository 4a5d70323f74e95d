"""The global attributes of the NetCDF files: the Attribute Convention for Data Discovery, ACDD-1.3."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from autonomy import __version__
from autonomy.export.values import iso_utc

Value = str | int | float

CONVENTIONS = "CF-1.8, ACDD-1.3"
VOCABULARY = "CF Standard Name Table v93"
NO_LICENCE = "No licence was stated; ask the institution that operated the vehicle."


@dataclass(frozen=True)
class Extent:
    """Where and when: degrees, seconds since 1970."""

    south: float
    north: float
    west: float
    east: float
    start_s: float
    end_s: float


@dataclass(frozen=True)
class About:
    """What a file says of itself beyond its variables.

    Attributes:
        vehicle: name of the vehicle.
        source: name of the recording or journal.
        survey: name of the survey, empty if it has none.
        software_version: of the vehicle's software, empty if unknown.
        configuration_hash: of its configuration, empty if unknown.
        created: when the file is made.
        command: what makes it.
        dated_by_arrival: whether times come from the clock of the receiver.
        depth_m: of the probe below the surface; None if that was not said.
        given: attributes that the user gives; they replace ours.
    """

    vehicle: str
    source: str
    survey: str
    software_version: str
    configuration_hash: str
    created: datetime
    command: str
    dated_by_arrival: bool
    depth_m: float | None
    given: Mapping[str, Value]


def global_attributes(
    about: About, kind: str, summary: str, variable: str, extent: Extent, more: Mapping[str, Value]
) -> dict[str, Value]:
    """All global attributes of a file.

    Args:
        about: what all files of an export have in common.
        kind: "nowcast" or "trajectory", part of title and id.
        summary: what is in the file.
        variable: what was measured.
        extent: where and when.
        more: of this file alone.
    """
    created = about.created.astimezone(UTC).isoformat(timespec="seconds").replace("+00:00", "Z")
    words = variable.replace("_", " ")
    name = about.survey or about.vehicle
    return {
        "Conventions": CONVENTIONS,
        "title": f"{words}: {kind} of {name}",
        "summary": summary,
        "keywords": f"{variable}, uncrewed surface vehicle, {kind}",
        "id": f"{about.vehicle}_{kind}_{_compact(extent.start_s)}_{_compact(extent.end_s)}",
        "standard_name_vocabulary": VOCABULARY,
        "source": f"uncrewed surface vehicle {about.vehicle}, halocline {about.software_version}".rstrip(),
        "platform": about.vehicle,
        "history": f"{created} {about.command} (halocline {__version__}, from {about.source})",
        "date_created": created,
        "date_modified": created,
        "date_issued": created,
        "date_metadata_modified": created,
        "product_version": __version__,
        "vehicle_software_version": about.software_version,
        "configuration_hash": about.configuration_hash,
        "license": NO_LICENCE,
        "comment": _times(dated_by_arrival=about.dated_by_arrival),
        "geospatial_lat_min": extent.south,
        "geospatial_lat_max": extent.north,
        "geospatial_lat_units": "degrees_north",
        "geospatial_lon_min": extent.west,
        "geospatial_lon_max": extent.east,
        "geospatial_lon_units": "degrees_east",
        "geospatial_bounds": _box(extent),
        "geospatial_bounds_crs": "EPSG:4326",
        "time_coverage_start": iso_utc(extent.start_s),
        "time_coverage_end": iso_utc(extent.end_s),
        "time_coverage_duration": duration(extent.end_s - extent.start_s),
        **_vertical(about.depth_m),
        **more,
        **about.given,
    }


def duration(seconds: float) -> str:
    """ISO 8601, to the millisecond: PT1H30M5S, PT1.5S."""
    minutes, milliseconds = divmod(round(1e3 * seconds), 60_000)
    hours, minutes = divmod(minutes, 60)
    text = (f"{hours}H" if hours else "") + (f"{minutes}M" if minutes else "")
    return f"PT{text}{milliseconds / 1e3:g}S" if milliseconds or not text else f"PT{text}"


def resolution(times_s: Sequence[float]) -> str:
    """The usual time between moments, as ISO 8601 has it."""
    return duration(float(np.median(np.diff(times_s)))) if len(times_s) > 1 else "PT0S"


def _vertical(depth_m: float | None) -> dict[str, Value]:
    if depth_m is None:
        return {}
    return {
        "geospatial_vertical_min": depth_m,
        "geospatial_vertical_max": depth_m,
        "geospatial_vertical_positive": "down",
        "geospatial_vertical_units": "m",
        # EPSG's "instantaneous water level depth".
        "geospatial_bounds_vertical_crs": "EPSG:5831",
    }


def _times(*, dated_by_arrival: bool) -> str:
    if dated_by_arrival:
        return (
            "The vehicle did not know UTC all the time: where it did not, times are those of the arrival of what it "
            "told, by the receiver's clock, less what the least delayed took."
        )
    return "Times are the vehicle's clock, which its autopilot sets to UTC."


def _box(extent: Extent) -> str:
    """The extent as well-known text; EPSG:4326 has latitude first."""
    south, north, west, east = (
        f"{value:.6f}" for value in (extent.south, extent.north, extent.west, extent.east)
    )
    corners = ((south, west), (south, east), (north, east), (north, west), (south, west))
    return f"POLYGON (({', '.join(' '.join(corner) for corner in corners)}))"


def _compact(utc_s: float) -> str:
    return datetime.fromtimestamp(utc_s, UTC).strftime("%Y%m%dT%H%M%SZ")
