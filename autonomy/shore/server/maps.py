"""The nowcast on a grid of latitudes and longitudes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray, LocalFrame
from autonomy.wire import ModelSnapshot

Float32Array = NDArray[np.float32]


@dataclass(frozen=True)
class Extent:
    """A rectangle of degrees and the cells it is cut into; the values are those at the cells' centres."""

    south: float
    west: float
    north: float
    east: float
    rows: int
    columns: int

    @property
    def latitudes(self) -> FloatArray:
        """Of the rows' centres, shape (rows,), the northernmost first."""
        step = (self.north - self.south) / self.rows
        centres: FloatArray = self.north - step * (np.arange(self.rows, dtype=np.float64) + 0.5)
        return centres

    @property
    def longitudes(self) -> FloatArray:
        """Of the columns' centres, shape (columns,), the westernmost first."""
        step = (self.east - self.west) / self.columns
        centres: FloatArray = self.west + step * (np.arange(self.columns, dtype=np.float64) + 0.5)
        return centres


@dataclass(frozen=True, eq=False)
class FieldMap:
    """Mean and standard deviation, each of shape (rows, columns), in the variable's units; NaN where nothing is."""

    mean: Float32Array
    sd: Float32Array


def evaluate(snapshot: ModelSnapshot, extent: Extent) -> FieldMap:
    """The map of a snapshot: NaN outside the survey's area."""
    frame = LocalFrame(snapshot.origin_lat_deg, snapshot.origin_lon_deg)
    lat, lon = np.meshgrid(extent.latitudes, extent.longitudes, indexing="ij")
    points = frame.to_local(lat, lon)
    x_min, y_min, x_max, y_max = snapshot.bounds_m
    x, y = points[..., 0], points[..., 1]
    inside = (x >= x_min) & (x <= x_max) & (y >= y_min) & (y <= y_max)
    mean, sd = np.full((2, *inside.shape), np.nan, dtype=np.float32)
    prediction = snapshot.model.predict(points[inside])
    mean[inside] = prediction.mean
    sd[inside] = np.sqrt(np.maximum(prediction.variance, 0.0))
    return FieldMap(mean, sd)
