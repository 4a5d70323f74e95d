"""The real coast of the Southern California Bight, from global-land-mask (NOAA GLOBE, 30 arc-seconds)."""

import importlib.util
import zipfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

from sim.field import FieldError
from sim.field_grid import METRES_PER_DEGREE, BoolArray, Bounds, FloatArray

CELLS_PER_DEGREE = 120
_GLOBE_SHAPE = (180 * CELLS_PER_DEGREE, 360 * CELLS_PER_DEGREE)


@dataclass(frozen=True)
class Coast:
    """Land on a window of the globe: axes ascending, cell centres in degrees; `land` (latitudes, longitudes).

    `first_row` is the window's northernmost row on the globe, counted from the north pole, `first_column` its
    westernmost column, counted from the date line.
    """

    first_row: int
    first_column: int
    lat_deg: FloatArray
    lon_deg: FloatArray
    land: BoolArray

    def nearest(self, lat_axis_deg: FloatArray, lon_axis_deg: FloatArray) -> BoolArray:
        """Land of the cells that contain the points of a lattice, shape (latitudes, longitudes)."""
        rows = self.first_row + len(self.lat_deg) - 1 - _from_north(lat_axis_deg)
        columns = _from_west(lon_axis_deg) - self.first_column
        return np.asarray(self.land[np.ix_(rows, columns)])

    def smooth(
        self, lat_axis_deg: FloatArray, lon_axis_deg: FloatArray, blur_cells: float = 0.8
    ) -> BoolArray:
        """Land on a finer lattice: the steps of the 1 km cells rounded off into a shoreline."""
        share = ndimage.gaussian_filter(self.land.astype(float), blur_cells)
        spline = RectBivariateSpline(self.lat_deg, self.lon_deg, share)
        return np.asarray(spline(lat_axis_deg, lon_axis_deg) > 0.5)

    def distance_km(self) -> RectBivariateSpline:
        """Signed distance from the shore (negative on land), kilometres, a smooth function of (lat, lon)."""
        cell_km = METRES_PER_DEGREE / CELLS_PER_DEGREE / 1000.0
        spacing = (cell_km, cell_km * np.cos(np.radians(self.lat_deg.mean())))
        away = ndimage.distance_transform_edt(~self.land, spacing)
        inland = ndimage.distance_transform_edt(self.land, spacing)
        return RectBivariateSpline(self.lat_deg, self.lon_deg, ndimage.gaussian_filter(away - inland, 1.0))


@lru_cache(maxsize=4)
def coast(bounds: Bounds) -> Coast:
    """The coast in a box that does not cross the date line.

    The package would unpack the whole globe, close to a gigabyte, and keep it; its rows are therefore read
    one after another from its file, and only the window is kept.

    Raises:
        FieldError: global-land-mask is not installed or not the one known here.
    """
    first_row, last_row = (int(_from_north(np.array(lat))) for lat in (bounds.north, bounds.south))
    first_column, last_column = (int(_from_west(np.array(lon))) for lon in (bounds.west, bounds.east))
    rows, columns = last_row + 1 - first_row, last_column + 1 - first_column
    ocean = _ocean_rows(first_row, rows)[::-1, first_column : first_column + columns]
    return Coast(
        first_row=first_row,
        first_column=first_column,
        lat_deg=90.0 - (first_row + np.arange(rows)[::-1] + 0.5) / CELLS_PER_DEGREE,
        lon_deg=-180.0 + (first_column + np.arange(columns) + 0.5) / CELLS_PER_DEGREE,
        land=~ocean,
    )


# The arithmetic is the package's own, to the last bit: some lattices lie exactly on the edges of its cells.
_NORTHERNMOST_DEG = (90.0, 90.0 - 1.0 / CELLS_PER_DEGREE)
_WESTERNMOST_DEG = (-180.0, -180.0 + 1.0 / CELLS_PER_DEGREE)


def _from_north(lat_deg: FloatArray) -> NDArray[np.int64]:
    return ((lat_deg - _NORTHERNMOST_DEG[0]) / (_NORTHERNMOST_DEG[1] - _NORTHERNMOST_DEG[0])).astype(np.int64)


def _from_west(lon_deg: FloatArray) -> NDArray[np.int64]:
    return ((lon_deg - _WESTERNMOST_DEG[0]) / (_WESTERNMOST_DEG[1] - _WESTERNMOST_DEG[0])).astype(np.int64)


def _ocean_rows(first: int, count: int) -> NDArray[np.bool_]:
    """Rows of the globe's ocean mask, from the north, all longitudes."""
    package = importlib.util.find_spec("global_land_mask")
    if package is None or package.origin is None:
        raise FieldError(
            "the synthetic ocean needs the package global-land-mask: pip install 'halocline[sim]'"
        )
    path = Path(package.origin).parent / "globe_combined_mask_compressed.npz"
    try:
        with zipfile.ZipFile(path) as archive, archive.open("mask.npy") as stream:
            np.lib.format.read_magic(stream)
            shape, by_columns, dtype = np.lib.format.read_array_header_1_0(stream)
            if shape != _GLOBE_SHAPE or by_columns or dtype != np.bool_:
                raise FieldError(f"{path}: the land mask is {shape} {dtype}, not {_GLOBE_SHAPE} bool")
            for _ in range(first):
                stream.read(shape[1])
            wanted = stream.read(count * shape[1])
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise FieldError(f"{path}: not the land mask of global-land-mask 1.0 ({error})") from error
    return np.frombuffer(wanted, dtype=np.bool_).reshape(count, shape[1])
