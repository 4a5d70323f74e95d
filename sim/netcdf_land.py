"""The land of a NetCDF file by its own mask."""

from typing import Any

import numpy as np

from sim.field_grid import BoolArray
from sim.netcdf_values import decode

SEA_MASKS = ("mask_rho", "mask_u", "mask_v", "mask_psi", "tmask", "wet", "sea_mask", "ocean_mask")
LAND_MASKS = ("land", "land_mask", "landmask", "lsm")
_LAND_WORDS = ("land", "on_land")


def land_mask(dataset: Any, data: Any, horizontal: tuple[str, str]) -> BoolArray | None:
    """Land by the file's own mask on the same grid; None when it has none."""
    for name, mask in dataset.variables.items():
        if not set(horizontal) <= set(mask.dimensions) or name == data.name:
            continue
        land = _read_mask(name, mask, horizontal)
        if land is not None:
            return land
    return None


def _read_mask(name: str, mask: Any, horizontal: tuple[str, str]) -> BoolArray | None:
    standard_name = getattr(mask, "standard_name", "")
    selection = tuple(slice(None) if d in horizontal else 0 for d in mask.dimensions)
    meanings = str(getattr(mask, "flag_meanings", "")).split()
    is_sea_mask = name in SEA_MASKS or standard_name == "sea_binary_mask"
    is_land_mask = name in LAND_MASKS or standard_name == "land_binary_mask"
    by_bits = name == "mask" and hasattr(mask, "flag_masks") and "land" in meanings
    by_flags = name == "mask" and hasattr(mask, "flag_values") and any(w in _LAND_WORDS for w in meanings)
    if not (is_sea_mask or is_land_mask or by_bits or by_flags):
        return None
    raw = np.asarray(mask[selection])
    if [d for d in mask.dimensions if d in horizontal] != list(horizontal):
        raw = raw.T
    if by_bits:
        bit = int(np.atleast_1d(mask.flag_masks)[meanings.index("land")])
        return np.asarray((raw.astype(np.int64) & bit) != 0)
    if by_flags:
        values = np.atleast_1d(mask.flag_values)
        of_land = [v for v, word in zip(values, meanings, strict=True) if word in _LAND_WORDS]
        return np.isin(raw, of_land)
    values = decode(mask, raw)
    # Missing means not 1: some masks are written for one side only. Packed ones are 0 and 1 only nearly.
    return np.asarray(~(values > 0.5) if is_sea_mask else values > 0.5)
