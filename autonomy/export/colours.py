"""Colours for maps in viewers that have no good ones themselves."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import FloatArray
from autonomy.shore.server.colours import COLOURS, colormaps

_BY_WORD = {
    "salinity": "haline",
    "temperature": "thermal",
    "chlorophyll": "algae",
    "oxygen": "oxy",
    "density": "dense",
    "turbidity": "turbid",
}


def colormap_of(variable: str) -> str:
    """The colour map that oceanographers know a variable by; viridis for others."""
    return next((name for word, name in _BY_WORD.items() if word in variable), "viridis")


@dataclass(frozen=True)
class Colours:
    """A colour map between two values."""

    name: str
    low: float
    high: float

    def of(self, values: FloatArray) -> NDArray[np.uint8]:
        """Red, green and blue of values (...), shape (..., 3); those beyond the ends have the ends' colours."""
        share = (values - self.low) / max(self.high - self.low, 1e-30)
        rows = np.rint(np.clip(share, 0.0, 1.0) * (COLOURS - 1)).astype(int)
        return np.asarray(self._table[rows])

    @cached_property
    def _table(self) -> NDArray[np.uint8]:
        return np.array(colormaps()[self.name], dtype=np.uint8)

    def __str__(self) -> str:
        return f"{self.name} from {self.low:.6g} to {self.high:.6g}"
