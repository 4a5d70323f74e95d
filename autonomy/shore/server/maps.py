"""The nowcast on a grid of latitudes and longitudes, fast enough to follow a mouse."""

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray, LocalFrame
from autonomy.learning.field_model import FieldModel
from autonomy.learning.prediction import Prediction
from autonomy.learning.spatial import SquaredExponential
from autonomy.shore.server import chebyshev
from autonomy.wire import ModelSnapshot

Float32Array = NDArray[np.float32]
BoolArray = NDArray[np.bool_]

_TOLERANCE = 1e-6
"""Of a map, in standard deviations and variances of the field: what is drawn is a hundred times as coarse."""
_CHECKS = 100
_MOST_POINTS = 0.3
"""Of the cells: with more points than this, interpolation saves nothing."""
_PROJECTION = (16, 16)
_NEAR_M = 1e-3


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

    @property
    def size_bytes(self) -> int:
        """Of both."""
        return self.mean.nbytes + self.sd.nbytes


def frame_of(snapshot: ModelSnapshot) -> LocalFrame:
    """Local metres of a snapshot's survey, made once per thread: PROJ's handles are costly, and not for several."""
    return _frame(snapshot.origin_lat_deg, snapshot.origin_lon_deg, threading.get_ident())


@lru_cache(maxsize=512)
def _frame(lat_deg: float, lon_deg: float, _thread: int) -> LocalFrame:
    return LocalFrame(lat_deg, lon_deg)


def predict(snapshot: ModelSnapshot, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """Mean and standard deviation at one position, in the variable's units."""
    prediction = snapshot.model.predict(frame_of(snapshot).to_local([lat_deg], [lon_deg]))
    return float(prediction.mean[0]), math.sqrt(max(0.0, float(prediction.variance[0])))


def is_outside(snapshot: ModelSnapshot, lat_deg: float, lon_deg: float) -> bool:
    """Whether a position lies outside the survey's rectangle, where `evaluate` has no values either."""
    ((x, y),) = frame_of(snapshot).to_local([lat_deg], [lon_deg]).tolist()
    x_min, y_min, x_max, y_max = snapshot.bounds_m
    return not (x_min <= x <= x_max and y_min <= y <= y_max)


def evaluate(snapshot: ModelSnapshot, extent: Extent, land: BoolArray | None = None) -> FieldMap:
    """The map of a snapshot: NaN outside the survey's rectangle, and where `land` (rows, columns) is true."""
    lat, lon = extent.latitudes, extent.longitudes
    rows, columns = _window(snapshot, lat, lon)
    mean, sd = np.full((2, len(lat), len(lon)), np.nan, dtype=np.float32)
    if rows.stop > rows.start and columns.stop > columns.start:
        local, prediction = _values(snapshot, lat[rows], lon[columns])
        x_min, y_min, x_max, y_max = snapshot.bounds_m
        x, y = local
        hidden = (x < x_min) | (x > x_max) | (y < y_min) | (y > y_max)
        if land is not None:
            hidden |= land[rows, columns]
        mean[rows, columns] = np.where(hidden, np.nan, prediction.mean)
        sd[rows, columns] = np.where(hidden, np.nan, np.sqrt(np.maximum(prediction.variance, 0.0)))
    return FieldMap(mean, sd)


def _window(snapshot: ModelSnapshot, lat: FloatArray, lon: FloatArray) -> tuple[slice, slice]:
    """The rows and columns that the survey's rectangle reaches into."""
    south, west, north, east = bounds_deg(snapshot)
    return _within(lat, south, north), _within(lon, west, east)


def _within(axis: FloatArray, low: float, high: float) -> slice:
    inside = np.flatnonzero((axis >= low) & (axis <= high))
    return slice(int(inside[0]), int(inside[-1]) + 1) if len(inside) else slice(0, 0)


def bounds_deg(snapshot: ModelSnapshot) -> tuple[float, float, float, float]:
    """South, west, north, east of the smallest rectangle of degrees around the survey's rectangle of metres."""
    x_min, y_min, x_max, y_max = snapshot.bounds_m
    x, y = np.linspace(x_min, x_max, 17), np.linspace(y_min, y_max, 17)
    edge = [(a, b) for a in x for b in (y_min, y_max)] + [(a, b) for a in (x_min, x_max) for b in y]
    degrees = frame_of(snapshot).to_geodetic(edge)
    (south, west), (north, east) = degrees.min(axis=0).tolist(), degrees.max(axis=0).tolist()
    return south, west, north, east


def _values(snapshot: ModelSnapshot, lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, Prediction]:
    """Local metres (2, rows, columns) and the prediction, at every cell."""
    model, frame = snapshot.model, frame_of(snapshot)
    local = _interpolated(
        lambda a, b: frame.to_local(a, b).T, lat, lon, _PROJECTION, np.array([_NEAR_M, _NEAR_M])
    )
    if local is None:
        local = np.moveaxis(frame.to_local(*np.meshgrid(lat, lon, indexing="ij")), -1, 0)
    latent = None
    if all(isinstance(each.space, SquaredExponential) for each in model.kernel.components):
        variance = model.kernel.signal_variance
        latent = _interpolated(
            lambda a, b: _latent(model, frame.to_local(a, b)),
            lat,
            lon,
            _counts(model, local),
            _TOLERANCE * np.array([math.sqrt(variance), variance]),
        )
    if latent is None:
        latent = _latent(model, local.reshape(2, -1).T).reshape(2, len(lat), len(lon))
    return local, Prediction(latent[0], latent[1], model.transform)


def _latent(model: FieldModel, points_m: FloatArray) -> FloatArray:
    """Mean and variance as the model is Gaussian in them, shape (2, n)."""
    prediction = model.predict(points_m)
    return np.stack([prediction.latent_mean, prediction.latent_variance])


def _interpolated(
    function: Callable[[FloatArray, FloatArray], FloatArray],
    lat: FloatArray,
    lon: FloatArray,
    counts: tuple[int, int],
    allowed: FloatArray,
) -> FloatArray | None:
    """Functions on the grid, from few places; None where that saves nothing, or is further out than allowed."""
    if counts[0] * counts[1] + _CHECKS > _MOST_POINTS * len(lat) * len(lon) or min(len(lat), len(lon)) < 2:
        return None
    values, errors = chebyshev.on_grid(function, lat, lon, counts, _CHECKS)
    return values if bool((errors <= allowed).all()) else None


def _counts(model: FieldModel, local_m: FloatArray) -> tuple[int, int]:
    """Chebyshev's points along rows and columns of a map of squared-exponential components.

    The variance is made of products of two correlations: of Gaussians with the length-scale l, those have the spectrum
    exp(−(ωl)²/4), which is below e⁻²⁰ from ω = √80/l on. A polynomial on an interval of half-width h needs ωh
    terms for waves of frequency ω, and a few more.
    """
    scales = np.array([each.space.lengthscales_m for each in model.kernel.components]).min(axis=0)
    half_m = 0.5 * np.ptp(local_m, axis=(1, 2))
    east, north = np.ceil(math.sqrt(80.0) * half_m / scales + 12.0).astype(int).tolist()
    return north, east
