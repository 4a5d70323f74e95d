"""A made-up ocean on a real coast: smooth in space and time, the same for the same seed.

Salinity is a sum of what surveys off California meet: saltier water upwelled along the shore, a meandering
front that eddies have stirred, the eddies themselves, and fresher water from a river. Everything is an
analytic function of place and time, so that it can be asked anywhere; features circle slowly about where they
were born, so that it stays bounded for any length of time.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage
from scipy.interpolate import RectBivariateSpline

from sim.advection import Transport
from sim.coast import coast
from sim.currents import Speeds, coastal_current
from sim.field import FieldInfo, MaskedField
from sim.field_grid import METRES_PER_DEGREE, BoolArray, Bounds, FloatArray, LandMask, RectilinearGrid
from sim.moving import MovingField, Supply
from sim.waves import Swarm

BIGHT = Bounds(south=31.9, north=35.0, west=-121.0, east=-117.0)
BIGHT_SHAPE = (351, 391)
PATCH_CENTRE = (33.982, -118.795)  # Point Dume: a headland between two bays
PATCH_SIDE_M = 15_000.0
PATCH_CELL_M = 100.0
MOVING_CELL_M = 150.0

_DAY_S = 86_400.0
_MARGIN_DEG = 0.25  # of coast beyond the edges, for its distance
_BASE = 33.45
_SWIRL = 0.9  # radians by which an eddy has turned the water at its centre


@dataclass(frozen=True)
class Scales:
    """Sizes of the features of one piece of sea; salinities are amplitudes, without unit."""

    upwelling: float
    upwelling_width_km: float
    front: float
    front_width_km: float
    meander_km: float
    eddies: int
    eddy: float
    eddy_radius_km: tuple[float, float]
    plume: float
    plume_radius_km: tuple[float, float]
    wander_km: float
    wander_days: tuple[float, float]


BIGHT_SCALES = Scales(
    upwelling=0.22,
    upwelling_width_km=28.0,
    front=0.11,
    front_width_km=9.0,
    meander_km=22.0,
    eddies=34,
    eddy=0.11,
    eddy_radius_km=(13.0, 32.0),  # about 30 to 80 km across
    plume=0.0,
    plume_radius_km=(1.0, 1.0),
    wander_km=25.0,
    wander_days=(14.0, 40.0),
)
PATCH_SCALES = Scales(
    upwelling=0.22,
    upwelling_width_km=2.5,
    front=0.10,
    front_width_km=1.1,
    meander_km=1.0,
    eddies=14,
    eddy=0.11,
    eddy_radius_km=(1.1, 2.2),
    plume=0.28,
    plume_radius_km=(3.4, 1.7),
    wander_km=0.25,
    wander_days=(3.0, 8.0),
)

# Three quarters of the moving sea's variance are locked to coast and inflow; what drifts is gone in two days.
MOVING_SCALES = replace(PATCH_SCALES, upwelling=0.35, upwelling_width_km=3.5, front=0.3, eddy=0.0)
MOVING_SPEEDS = Speeds(
    mean_mps=0.03,
    swing_mps=0.02,
    swing_s=5.0 * _DAY_S,
    tide_mps=0.06,
    eddy_mps=0.04,
    eddy_m=1800.0,
    eddy_s=(4.0 * _DAY_S, 12.0 * _DAY_S),
    waves=24,
    shore_m=1200.0,
)
MOVING_STRANGE = Swarm(deviation=0.10, size_m=2000.0, period_s=(3.0 * _DAY_S, 10.0 * _DAY_S), waves=24)
MOVING_RETURN_S = 1.5 * _DAY_S
MOVING_SUPPLY_S = 0.25 * _DAY_S
MOVING_DIFFUSIVITY_M2PS = 1.0


@dataclass(frozen=True)
class _Blobs:
    """Gaussian bumps, each circling: all arrays of shape (n,), or (n, 2) for places and radii."""

    amplitude: FloatArray
    place_km: FloatArray
    radius_km: FloatArray
    heading: FloatArray
    wander_km: FloatArray
    rate_per_s: FloatArray
    phase: FloatArray

    def value(
        self, x_km: FloatArray, y_km: FloatArray, time_s: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Sum of the bumps, and where the water at each point was before the eddies stirred it (x, y)."""
        angle = self.phase + self.rate_per_s * time_s
        # Measured from time zero's place, so that features start where they were put.
        shift_x = self.wander_km * (np.cos(angle) - np.cos(self.phase))
        shift_y = self.wander_km * (np.sin(angle) - np.sin(self.phase))
        dx = x_km[..., None] - (self.place_km[:, 0] + shift_x)
        dy = y_km[..., None] - (self.place_km[:, 1] + shift_y)
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        along, across = dx * cos + dy * sin, dy * cos - dx * sin
        squared = (along / self.radius_km[:, 0]) ** 2 + (across / self.radius_km[:, 1]) ** 2
        near = np.exp(-0.5 * squared)
        swirl = near * np.sign(self.amplitude) * _SWIRL
        return near @ self.amplitude, x_km - (swirl * dy).sum(axis=-1), y_km + (swirl * dx).sum(axis=-1)


@dataclass(frozen=True)
class _Front:
    """A step in salinity across a line that meanders and drifts to and fro."""

    amplitude: float
    width_km: float
    meander_km: float
    normal: tuple[float, float]
    offset_km: float
    wavelength_km: float
    phase: float
    period_s: float

    def value(self, x_km: FloatArray, y_km: FloatArray, time_s: float) -> FloatArray:
        across = x_km * self.normal[0] + y_km * self.normal[1] - self.offset_km
        along = y_km * self.normal[0] - x_km * self.normal[1]
        drift = 2.0 * math.pi * time_s / self.period_s
        wave = 2.0 * math.pi * along / self.wavelength_km + self.phase
        meander = np.sin(wave + 0.5 * math.sin(drift)) + 0.4 * np.sin(1.7 * wave + 1.0)
        return np.asarray(self.amplitude * np.tanh((across - self.meander_km * meander) / self.width_km))


class SyntheticField(MaskedField):
    """Salinity of a made-up sea; changes for ever, so `times_s` ends at infinity."""

    def __init__(
        self,
        info: FieldInfo,
        mask: LandMask,
        shore_km: RectBivariateSpline,
        scales: Scales,
        rng: np.random.Generator,
    ) -> None:
        """Draw the features.

        Args:
            info: what the field is.
            mask: its land.
            shore_km: distance from the shore as a function of (lat, lon), kilometres.
            scales: sizes of the features.
            rng: where the features are drawn from.
        """
        super().__init__(info, mask, (0.0, math.inf))
        self._shore_km = shore_km
        self._scales = scales
        self._lat0, self._lon0 = self.bounds.centre
        self._km_per_degree = METRES_PER_DEGREE / 1000.0
        width_m, height_m = self.bounds.size_m
        half_km = np.array([width_m, height_m]) / 2000.0
        self._upwelling_phase = rng.uniform(0.0, 2.0 * math.pi, 2)
        self._front = _draw_front(scales, half_km, rng)
        self._blobs = _draw_blobs(scales, half_km, self._shore_point(rng), rng)

    def value(self, lat_deg: ArrayLike, lon_deg: ArrayLike, time_s: float) -> FloatArray:
        """Values at positions of any one shape; NaN on land and outside the field."""
        lat, lon = np.asarray(lat_deg, dtype=float), np.asarray(lon_deg, dtype=float)
        water = self.mask.is_water(*self.mask.grid.locate(lat, lon))
        # Elsewhere the formula is evaluated at the centre, only to be thrown away.
        lat, lon = np.where(water, lat, self._lat0), np.where(water, lon, self._lon0)
        x_km, y_km = self._plane(lat, lon)
        bumps, stirred_x_km, stirred_y_km = self._blobs.value(x_km, y_km, time_s)
        front = self._front.value(stirred_x_km, stirred_y_km, time_s)
        salinity = _BASE + self._upwelled(lat, lon, x_km, y_km) + front + bumps
        return np.where(water, salinity, np.nan)

    def usual(self) -> tuple[FloatArray, FloatArray]:
        """On the cells of the mask, land included: the field at time zero, and how near each is to its sources, 0 to 1.

        The sources are the shore and the river.
        """
        rows, columns = self.mask.land.shape
        lat, lon = self.mask.grid.positions(*np.indices((rows, columns)))
        values = self.value(lat, lon, 0.0)
        x_km, y_km = self._plane(lat, lon)
        river_km = self._blobs.place_km[-1]
        from_river_km = np.hypot(x_km - river_km[0], y_km - river_km[1])
        shore_km = np.maximum(self._shore_km(lat, lon, grid=False), 0.0)
        near = np.exp(-((from_river_km / self._scales.plume_radius_km[1]) ** 2)) + np.exp(
            -((shore_km / 0.5) ** 2)
        )
        return np.where(self.mask.land, np.nanmean(values), values), np.minimum(1.0, near)

    def _plane(self, lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
        narrowing = math.cos(math.radians(self._lat0))
        return (lon - self._lon0) * self._km_per_degree * narrowing, (lat - self._lat0) * self._km_per_degree

    def _upwelled(self, lat: FloatArray, lon: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Salty water along the shore, here stronger and there weaker."""
        scales = self._scales
        shore_km = np.maximum(self._shore_km(lat, lon, grid=False), 0.0)
        wave = 2.0 * math.pi / (9.0 * scales.upwelling_width_km)
        pulse = np.sin(wave * x + self._upwelling_phase[0]) * np.cos(wave * y + self._upwelling_phase[1])
        strength = scales.upwelling * (1.0 + 0.5 * pulse)
        # Flat at the shore and exponential offshore: a smooth field has no kink along islands.
        scaled = shore_km / scales.upwelling_width_km
        return np.asarray(strength * np.exp(1.0 - np.sqrt(1.0 + scaled * scaled)))

    def _shore_point(self, rng: np.random.Generator) -> FloatArray:
        """A cell of water beside the land, in kilometres: where a river runs out. Shape (2,)."""
        land = self.mask.land
        beside = np.argwhere(ndimage.binary_dilation(land) & ~land)
        row, column = beside[rng.integers(len(beside))]
        return np.stack(self._plane(*self.mask.grid.positions(float(row), float(column))))


def _draw_front(scales: Scales, half_km: FloatArray, rng: np.random.Generator) -> _Front:
    bearing = math.radians(rng.uniform(200.0, 250.0))  # saltier offshore side to the south-west or so
    return _Front(
        amplitude=scales.front,
        width_km=scales.front_width_km,
        meander_km=scales.meander_km,
        normal=(math.sin(bearing), math.cos(bearing)),
        offset_km=float(rng.uniform(0.1, 0.4) * half_km.mean()),
        wavelength_km=float(rng.uniform(0.9, 1.3) * half_km.mean()),
        phase=float(rng.uniform(0.0, 2.0 * math.pi)),
        period_s=scales.wander_days[1] * _DAY_S,
    )


def _draw_blobs(
    scales: Scales, half_km: FloatArray, river_km: FloatArray, rng: np.random.Generator
) -> _Blobs:
    """Eddies spread evenly over the sea, of either sign, and one plume of fresher water."""
    count = scales.eddies
    sign = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    radius = rng.uniform(*scales.eddy_radius_km, count)
    stretch = rng.uniform(0.8, 1.2, count)
    plume = np.array([-scales.plume])
    days = rng.uniform(*scales.wander_days, count + 1)
    return _Blobs(
        amplitude=np.concatenate([sign * scales.eddy * rng.uniform(0.6, 1.3, count), plume]),
        place_km=np.vstack([_spread(count, half_km, rng), river_km]),
        radius_km=np.vstack([np.stack([radius * stretch, radius], axis=1), scales.plume_radius_km]),
        heading=rng.uniform(0.0, math.pi, count + 1),
        wander_km=scales.wander_km * rng.uniform(0.5, 1.0, count + 1),
        rate_per_s=rng.choice([-1.0, 1.0], count + 1) * 2.0 * math.pi / (days * _DAY_S),
        phase=rng.uniform(0.0, 2.0 * math.pi, count + 1),
    )


def _spread(count: int, half_km: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Places far from one another (the best of a few candidates each time), shape (count, 2)."""
    places = rng.uniform(-half_km, half_km, (1, 2))
    while len(places) < count:
        candidates = rng.uniform(-half_km, half_km, (12, 2))
        gaps = np.linalg.norm(candidates[:, None] - places, axis=-1).min(axis=1)
        places = np.vstack([places, candidates[np.argmax(gaps)]])
    return places


def bight(seed: int = 0) -> SyntheticField:
    """The whole Southern California Bight, 31.9-35.0 N, 121-117 W, on 351 x 391 cells of about 1 km."""
    lat = np.linspace(BIGHT.south, BIGHT.north, BIGHT_SHAPE[0])
    lon = np.linspace(BIGHT.west, BIGHT.east, BIGHT_SHAPE[1])
    mask = LandMask(RectilinearGrid(lat, lon), coast(_widened(BIGHT)).nearest(lat, lon))
    return _synthetic("synthetic ocean, Southern California Bight", BIGHT, mask, BIGHT_SCALES, seed)


def patch(seed: int = 0) -> SyntheticField:
    """A piece of the same coast, 15 km x 15 km about Point Dume, on cells of 100 m."""
    bounds, mask = _patch_mask(PATCH_CELL_M)
    return _synthetic("synthetic ocean, Point Dume", bounds, mask, PATCH_SCALES, seed)


def moving_patch(seed: int = 0) -> MovingField:
    """The same piece, on cells of 150 m, with a current that carries the salinity along.

    What the sea returns to is a still one without eddies: soon at the shore, where water wells up, and at the river's
    mouth (`MOVING_SUPPLY_S`), slowly far from both (`MOVING_RETURN_S`).
    """
    bounds, mask = _patch_mask(MOVING_CELL_M)
    rng = np.random.default_rng(seed)
    still = SyntheticField(
        _info("synthetic ocean", seed),
        mask,
        _shore_distance(bounds),
        MOVING_SCALES,
        rng,
    )
    usual, supplied = still.usual()
    current = coastal_current(mask.land, MOVING_CELL_M, MOVING_SPEEDS, rng)
    rows, columns = mask.land.shape
    strange = MOVING_STRANGE.draw((rows + 2, columns + 2), MOVING_CELL_M, rng)
    supply = Supply(usual, 1.0 / MOVING_RETURN_S + supplied / MOVING_SUPPLY_S, strange)
    transport = Transport(mask.land, MOVING_CELL_M, MOVING_DIFFUSIVITY_M2PS)
    return MovingField(_info("moving synthetic ocean, Point Dume", seed), mask, current, transport, supply)


def _synthetic(place: str, bounds: Bounds, mask: LandMask, scales: Scales, seed: int) -> SyntheticField:
    return SyntheticField(
        _info(place, seed), mask, _shore_distance(bounds), scales, np.random.default_rng(seed)
    )


def _info(place: str, seed: int) -> FieldInfo:
    return FieldInfo("salinity", "sea surface salinity", "PSU", f"{place}, seed {seed}")


def _patch_mask(cell_m: float) -> tuple[Bounds, LandMask]:
    bounds = _patch_bounds()
    cells = round(PATCH_SIDE_M / cell_m)
    lat = np.linspace(bounds.south, bounds.north, cells + 1)
    lon = np.linspace(bounds.west, bounds.east, cells + 1)
    land = _without_ponds(coast(_widened(bounds)).smooth(lat, lon))
    return bounds, LandMask(RectilinearGrid(lat, lon), land)


@lru_cache(maxsize=2)
def _shore_distance(bounds: Bounds) -> RectBivariateSpline:
    return coast(_widened(bounds)).distance_km()


def _patch_bounds() -> Bounds:
    lat, lon = PATCH_CENTRE
    half_lat = 0.5 * PATCH_SIDE_M / METRES_PER_DEGREE
    half_lon = half_lat / math.cos(math.radians(lat))
    return Bounds(lat - half_lat, lat + half_lat, lon - half_lon, lon + half_lon)


def _widened(bounds: Bounds) -> Bounds:
    return Bounds(
        bounds.south - _MARGIN_DEG,
        bounds.north + _MARGIN_DEG,
        bounds.west - _MARGIN_DEG,
        bounds.east + _MARGIN_DEG,
    )


def _without_ponds(land: BoolArray) -> BoolArray:
    """Only the largest water stays: a vessel cannot get into the others."""
    labels, _ = ndimage.label(~land)
    largest = np.argmax(np.bincount(labels.ravel())[1:]) + 1
    return np.asarray(labels != largest)
