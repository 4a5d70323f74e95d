"""The nowcast over time as NetCDF: CF-1.8 on a regular grid of latitudes and longitudes."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np

from autonomy.export.archive import Archive
from autonomy.export.attributes import About, Extent, Value, global_attributes, resolution
from autonomy.export.grid import MapGrid
from autonomy.export.netcdf import (
    FILL,
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
from autonomy.export.values import DatedModel, Subject
from autonomy.learning.description import describe
from autonomy.learning.kernel import Kernel

_KERNEL_LETTERS = 120

_SERIES: Mapping[str, tuple[str, dict[str, Value]]] = {
    "samples": ("i4", {"long_name": "readings learnt", "units": "1"}),
    "basis_size": ("i4", {"long_name": "basis vectors of the model", "units": "1"}),
    "rho": ("f8", {"long_name": "share of basis vectors added since the last re-estimate", "units": "1"}),
    "stated_error_of_mean": (
        "f8",
        {
            "long_name": "how far the mean is from the vehicle's own at most, about, for what the link took off it, "
            "over the standard deviation of the field",
            "units": "1",
        },
    ),
    "stated_error_of_standard_error": (
        "f8",
        {"long_name": "the same of the standard error", "units": "1"},
    ),
    "prior_mean": (
        "f8",
        {"long_name": "mean of the field far from all readings, in the model's latent units"},
    ),
    "noise_standard_deviation": (
        "f8",
        {"long_name": "standard deviation of a reading's noise, in the model's latent units"},
    ),
}
_COMPONENTS: Mapping[str, dict[str, Value]] = {
    "component_standard_deviation": {
        "long_name": "standard deviation of a component of the field, in the model's latent units"
    },
    "component_lengthscale_east": {"long_name": "correlation length to the east", "units": "m"},
    "component_lengthscale_north": {"long_name": "correlation length to the north", "units": "m"},
    "component_timescale": {
        "long_name": "correlation time; missing for a component that does not change",
        "units": "s",
    },
}


def write_map(path: Path, archive: Archive, subject: Subject, grid: MapGrid, about: About) -> int:
    """Write the maps of all models, one in memory at a time; returns how many.

    Raises:
        OSError: the file can't be written.
    """
    with creating(path) as dataset:
        writer = _Writer(dataset, archive, subject, grid, about)
        for row, model in enumerate(archive.models()):
            writer.put(row, model)
        writer.describe()
        return len(writer.times_s)


class _Writer:
    """One file being written."""

    def __init__(
        self, dataset: netCDF4.Dataset, archive: Archive, subject: Subject, grid: MapGrid, about: About
    ) -> None:
        self._dataset, self._subject, self._grid, self._about = dataset, subject, grid, about
        self.times_s: list[float] = []
        self._precisions: set[str] = set()
        components = archive.most_components()
        sizes = {"time": None, "lat": len(grid.lat_deg), "lon": len(grid.lon_deg), "component": components}
        for name, size in sizes.items():
            dataset.createDimension(name, size)
        dataset.createDimension("kernel_strlen", _KERNEL_LETTERS)
        self._time = add(dataset, "time", "f8", ("time",), TIME, chunksizes=(512,))
        add(dataset, "lat", "f8", ("lat",), LATITUDE)[:] = grid.lat_deg
        add(dataset, "lon", "f8", ("lon",), LONGITUDE)[:] = grid.lon_deg
        mapping = add_grid_mapping(dataset)
        self._mean, self._error = self._maps(mapping, add_depth(dataset, about.depth_m))
        # In a group of its own: none of it is a field of the sea, and none has a standard name.
        group = dataset.createGroup("model")
        self._series = {
            name: add(group, name, kind, ("time",), attributes, chunksizes=(512,))
            for name, (kind, attributes) in _SERIES.items()
        }
        options: dict[str, Any] = {"fill_value": FILL_DOUBLE, "chunksizes": (512, components)}
        self._components = {
            name: add(group, name, "f8", ("time", "component"), attributes, **options)
            for name, attributes in _COMPONENTS.items()
        }
        words = {"long_name": "components of the field in words"}
        letters = ("time", "kernel_strlen")
        self._kernel = add(group, "kernel", "S1", letters, words, chunksizes=(64, _KERNEL_LETTERS))
        self._last: DatedModel | None = None

    def _maps(self, mapping: str, depth: str) -> tuple["netCDF4.Variable[Any]", "netCDF4.Variable[Any]"]:
        variable, units = self._subject.variable, self._subject.units
        name = name_of(variable)
        shape = (1, len(self._grid.lat_deg), len(self._grid.lon_deg))
        common = {
            "grid_mapping": mapping,
            "cell_methods": "time: point",
            "coverage_content_type": "modelResult",
        }
        if depth:
            common["coordinates"] = depth
        options: dict[str, Any] = {"fill_value": FILL, "chunksizes": shape}
        axes = ("time", "lat", "lon")
        error_name = f"{name}_standard_error"
        attributes = {**measured(variable, units), "ancillary_variables": error_name, **common}
        mean = add(self._dataset, name, "f4", axes, attributes, **options)
        common["coverage_content_type"] = "qualityInformation"
        attributes = {**measured(variable, units, "standard_error"), **common}
        return mean, add(self._dataset, error_name, "f4", axes, attributes, **options)

    def put(self, row: int, dated: DatedModel) -> None:
        """The map of one model, and what the model is."""
        snapshot, model = dated.snapshot, dated.snapshot.model
        self.times_s.append(dated.utc_s)
        self._last = dated
        self._precisions.add(snapshot.precision)
        prediction = model.predict(self._grid.points_m)
        self._time[row] = dated.utc_s
        self._mean[row] = self._grid.spread(prediction.mean)
        self._error[row] = self._grid.spread(np.sqrt(np.maximum(prediction.variance, 0.0)))
        kernel = snapshot.kernel
        figures: tuple[float, ...] = (snapshot.samples, len(model), snapshot.rho, *snapshot.stated_error)
        figures += (model.prior_mean, math.sqrt(kernel.noise_variance))
        for variable, figure in zip(self._series.values(), figures, strict=True):
            variable[row] = figure
        self._put_kernel(row, kernel)

    def _put_kernel(self, row: int, kernel: Kernel) -> None:
        figures = np.full((len(self._components), self._dataset.dimensions["component"].size), FILL_DOUBLE)
        for i, component in enumerate(kernel.components):
            scale_s = component.time.timescale_s
            east, north = component.space.lengthscales_m
            figures[:, i] = (
                math.sqrt(component.variance),
                east,
                north,
                scale_s if math.isfinite(scale_s) else FILL_DOUBLE,
            )
        for variable, values in zip(self._components.values(), figures, strict=True):
            variable[row] = values
        letters = describe(kernel).encode("ascii", "replace")[:_KERNEL_LETTERS].ljust(_KERNEL_LETTERS, b"\0")
        self._kernel[row] = np.frombuffer(letters, dtype="S1")

    def describe(self) -> None:
        """The global attributes."""
        assert self._last is not None
        about = self._about
        snapshot, grid = self._last.snapshot, self._grid
        step_lat, step_lon = (axis[1] - axis[0] for axis in (grid.lat_deg, grid.lon_deg))
        # Of the cells' middles: what checkers hold against the coordinates.
        extent = Extent(
            grid.lat_deg[0],
            grid.lat_deg[-1],
            grid.lon_deg[0],
            grid.lon_deg[-1],
            self.times_s[0],
            self.times_s[-1],
        )
        words = self._subject.variable.replace("_", " ")
        summary = (
            f"{words} as the vehicle {about.vehicle} believed it to be at each moment, the nowcast of a sparse online "
            "Gaussian process of all its readings until then, and the standard error of that belief (of the field, "
            "without a reading's noise). Nothing is smoothed backwards in time."
        )
        outside = (
            "Cells that are land, closed or outside the survey area are missing."
            if grid.masked
            else ("Where the land is was not recorded: nothing is missing, the land is not.")
        )
        more: dict[str, Value] = {
            "cdm_data_type": "Grid",
            "processing_level": "Nowcast gridded from in-situ observations (level 4)",
            "time_coverage_resolution": resolution(self.times_s),
            "geospatial_lat_resolution": f"{step_lat:.7f} degree",
            "geospatial_lon_resolution": f"{step_lon:.7f} degree",
            "grid_resolution_m": grid.resolution_m,
            "land": outside,
            "latent_transform": snapshot.model.transform.name,
            "precision": ", ".join(sorted(self._precisions)),
        }
        attributes = global_attributes(about, "nowcast", summary, self._subject.variable, extent, more)
        self._dataset.setncatts(attributes)
