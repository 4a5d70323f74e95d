"""Colour maps that are even to the eye and told apart by the colour-blind."""

from functools import cache
from importlib.metadata import distribution

import matplotlib
import numpy as np

COLOURS = 256
_CMOCEAN = distribution("cmocean")
_NAMES = ("haline", "thermal", "dense", "oxy", "algae", "turbid")
_OTHERS = ("viridis", "cividis", "magma")


@cache
def colormaps() -> dict[str, list[list[int]]]:
    """By name: 256 colours of red, green and blue from 0 to 255."""
    # Read, not imported: cmocean brings all of pyplot with it, 40 MB that nobody here draws with.
    tables = {name: np.loadtxt(str(_CMOCEAN.locate_file(f"cmocean/rgb/{name}-rgb.txt"))) for name in _NAMES}
    share = np.linspace(0.0, 1.0, COLOURS)
    tables |= {name: matplotlib.colormaps[name](share)[:, :3] for name in _OTHERS}
    return {name: np.rint(255.0 * table).astype(int).tolist() for name, table in tables.items()}
