"""Colour maps that are even to the eye and told apart by the colour-blind."""

from functools import cache

import cmocean
import matplotlib
import numpy as np

_COLOURS = 256


@cache
def colormaps() -> dict[str, list[list[int]]]:
    """By name: 256 colours of red, green and blue from 0 to 255."""
    maps = {
        "haline": cmocean.cm.haline,
        "thermal": cmocean.cm.thermal,
        "dense": cmocean.cm.dense,
        "oxy": cmocean.cm.oxy,
        "algae": cmocean.cm.algae,
        "turbid": cmocean.cm.turbid,
        "viridis": matplotlib.colormaps["viridis"],
        "cividis": matplotlib.colormaps["cividis"],
        "magma": matplotlib.colormaps["magma"],
    }
    share = np.linspace(0.0, 1.0, _COLOURS)
    return {
        name: np.rint(255.0 * colours(share)[:, :3]).astype(int).tolist() for name, colours in maps.items()
    }
