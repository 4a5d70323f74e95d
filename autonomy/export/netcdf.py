"""What both NetCDF files have in common; the library netCDF4 writes them (extra `shore`)."""

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import netCDF4

from autonomy.export.attributes import Value
from autonomy.export.outputs import told_as_os_error

COMPRESSION: dict[str, Any] = {"compression": "zlib", "complevel": 4, "shuffle": True}
EPOCH = "seconds since 1970-01-01T00:00:00Z"

_TAKEN = ("time", "lat", "lon", "depth", "crs", "trajectory", "obs", "component")

STANDARD_NAMES = frozenset(
    {
        "air_pressure",
        "air_temperature",
        "mass_concentration_of_chlorophyll_a_in_sea_water",
        "mass_concentration_of_chlorophyll_in_sea_water",
        "mass_concentration_of_oxygen_in_sea_water",
        "mass_concentration_of_suspended_matter_in_sea_water",
        "mole_concentration_of_dissolved_molecular_oxygen_in_sea_water",
        "mole_concentration_of_nitrate_in_sea_water",
        "moles_of_oxygen_per_unit_mass_in_sea_water",
        "partial_pressure_of_carbon_dioxide_in_sea_water",
        "sea_floor_depth_below_sea_surface",
        "sea_surface_salinity",
        "sea_surface_temperature",
        "sea_water_absolute_salinity",
        "sea_water_conservative_temperature",
        "sea_water_density",
        "sea_water_electrical_conductivity",
        "sea_water_ph_reported_on_total_scale",
        "sea_water_potential_temperature",
        "sea_water_practical_salinity",
        "sea_water_preformed_salinity",
        "sea_water_pressure",
        "sea_water_salinity",
        "sea_water_sigma_t",
        "sea_water_speed",
        "sea_water_temperature",
        "sea_water_turbidity",
    }
)
"""What a boat may measure, of the names in the CF Standard Name Table; another name is told as a long name alone."""


@contextmanager
def creating(path: Path) -> Iterator[netCDF4.Dataset]:
    """A new NetCDF-4 file, closed at the end. OSError if it can't be written."""
    with told_as_os_error(path, "NetCDF:"), netCDF4.Dataset(path, "w", format="NETCDF4") as dataset:
        yield dataset


def name_of(variable: str) -> str:
    """A variable's name in a file: what the vehicle calls it, with the letters that every program takes."""
    name = re.sub(r"\W+", "_", variable, flags=re.ASCII).strip("_")
    return name if name[:1].isalpha() and name not in _TAKEN else f"measured_{name}"


def measured(variable: str, units: str, suffix: str = "") -> dict[str, Value]:
    """Attributes of what was measured: standard name, if it is one that we know, long name and units."""
    words = f"{variable} {suffix}".replace("_", " ").strip()
    described: dict[str, Value] = {"long_name": words, "units": units}
    if variable in STANDARD_NAMES:
        described["standard_name"] = f"{variable} {suffix}" if suffix else variable
    return described


def add(
    dataset: netCDF4.Dataset | netCDF4.Group,
    name: str,
    kind: str,
    dimensions: tuple[str, ...],
    attributes: Mapping[str, Any],
    **options: Any,
) -> "netCDF4.Variable[Any]":
    """A new variable with attributes; those of more than one value are compressed."""
    if dimensions:
        options = {**COMPRESSION, **options}
    variable = dataset.createVariable(name, kind, dimensions, **options)
    variable.setncatts(attributes)
    return variable


def add_grid_mapping(dataset: netCDF4.Dataset) -> str:
    """The variable that says what latitude and longitude are of; its name."""
    add(
        dataset,
        "crs",
        "i4",
        (),
        {
            "grid_mapping_name": "latitude_longitude",
            "long_name": "WGS 84",
            "semi_major_axis": 6378137.0,
            "inverse_flattening": 298.257223563,
            "longitude_of_prime_meridian": 0.0,
            "epsg_code": "EPSG:4326",
        },
    )
    return "crs"


def add_depth(dataset: netCDF4.Dataset, depth_m: float | None) -> str:
    """The scalar coordinate that says how deep the probe is, if that was said; its name, empty if there is none."""
    if depth_m is None:
        return ""
    attributes = {
        "standard_name": "depth",
        "long_name": "depth of the probe",
        "units": "m",
        "positive": "down",
        "axis": "Z",
    }
    add(dataset, "depth", "f8", (), attributes)[...] = depth_m
    return "depth"


TIME = {"standard_name": "time", "long_name": "time", "units": EPOCH, "calendar": "standard", "axis": "T"}
LATITUDE = {"standard_name": "latitude", "long_name": "latitude", "units": "degrees_north", "axis": "Y"}
LONGITUDE = {"standard_name": "longitude", "long_name": "longitude", "units": "degrees_east", "axis": "X"}
FILL = float(netCDF4.default_fillvals["f4"])
FILL_DOUBLE = float(netCDF4.default_fillvals["f8"])
