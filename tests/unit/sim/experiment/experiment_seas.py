"""A small sea for experiments: ten kilometres of waves, with an island and a cape."""

import numpy as np

from sim.field import FieldInfo, GriddedField
from sim.field_grid import LandMask, RectilinearGrid


def small_sea(south=33.0, north=33.1, west=-118.1, east=-118.0, instants_s=(0.0,)):
    """Still, or drifting east by a tenth of its width a week."""
    lat, lon = np.linspace(south, north, 41), np.linspace(west, east, 41)
    v, u = np.meshgrid(np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, 41), indexing="ij")
    land = (np.hypot(u - 0.35, v - 0.6) < 0.08) | (v > 0.9 + 0.1 * np.cos(9.0 * u))
    frames = [33.5 + 0.2 * np.sin(9.0 * (u - t / 6_048_000.0)) * np.cos(7.0 * v) for t in instants_s]
    info = FieldInfo("salinity", "salinity", "PSU", "waves about an island")
    return GriddedField(
        info, LandMask(RectilinearGrid(lat, lon), land), np.array(instants_s), np.array(frames)
    )
